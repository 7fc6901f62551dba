"""Loops in a plane that close by two links, in closed form: two joints follow from a triangle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics.loops.constraint import Closing, ClosureSide, Follower, Loop, Reach, reach
from adaptctl.dynamics.recursion.segment import Placement, Segment
from adaptctl.scalars import Scalar, Vec, angle, cos, dot, maximum, sin, sqrt, where

PARALLEL = 1e-12
"""Sine of the largest angle between axes that count as parallel."""


class Flat(NamedTuple):
    """A vector in a plane, m."""

    x: Any
    y: Any

    def minus(self, other: Flat) -> Flat:
        """The difference."""
        return Flat(self.x - other.x, self.y - other.y)

    def turned(self, cosine: Any, sine: Any) -> Flat:
        """The vector turned to the left by an angle, its length times a factor that both are multiplied by."""
        return Flat(cosine * self.x - sine * self.y, cosine * self.y + sine * self.x)

    def dot(self, other: Flat) -> Any:
        """The inner product: of lengths and the cosine of the angle between."""
        return self.x * other.x + self.y * other.y

    def cross(self, other: Flat) -> Any:
        """The outer product: of lengths and the sine of the angle from this vector to the other."""
        return self.x * other.y - self.y * other.x


class Links(NamedTuple):
    """A dyad's two links in the plane: an outer pivot of each, and the ways from there over the links, m."""

    pivot: Flat
    over: Flat
    """from the first pivot to the middle one"""
    other_pivot: Flat
    other_over: Flat
    """where the loop is cut at the middle pivot, from the second one to it; else from it to the second one"""

    @classmethod
    def of(cls, one: Reach, other: Reach, plane: tuple[Vec, Vec], is_cut_in_the_middle: bool) -> Links:
        """The links of a dyad where the sides of its closure reach."""
        if is_cut_in_the_middle:
            points = one.hinges[-1].origin, one.origin, other.hinges[-1].origin, other.origin
        else:
            points = one.hinges[-2].origin, one.hinges[-1].origin, other.origin, one.origin
        pivot, middle, other_pivot, end = (Flat(*(dot(u, point) for u in plane)) for point in points)
        start = other_pivot if is_cut_in_the_middle else middle
        return cls(pivot, middle.minus(pivot), other_pivot, end.minus(start))


@dataclass(frozen=True)
class Dyad:
    """A dyad of turning joints (RRR): two links between three pivots, whose axes are parallel, of which one is where
    the loop is cut.

    Where other joints have put the outer pivots, the links' lengths fix the middle one but for the side it is on, which
    is that of a configuration nearby.
    """

    sides: tuple[ClosureSide, ClosureSide]
    """the loop's: each ends with a link of the dyad, or the first with both"""
    joints: tuple[int, int]
    """those that follow"""
    plane: tuple[Vec, Vec]
    """unit vectors across the axes, in the common link's axes"""
    squares: tuple[float, float]
    """squared lengths of the links, m^2"""
    sense: float
    """1 where the second joint turns to the left in the plane, as the first one does, else -1"""

    @property
    def is_cut_in_the_middle(self) -> bool:
        """True if the loop is cut at the middle pivot, False if it is at an outer one."""
        return self.joints[1] not in self.sides[0].links

    def followed(
        self, places: Mapping[int, Placement], links: Sequence[Segment], q: Sequence[Scalar]
    ) -> tuple[Scalar, ...]:
        """The two joints' angles (rad) that close the loop, within half a turn of those of q (n,), on whose side the
        middle pivot is.

        `places` has the placements of the other links. Where the loop cannot close, the angles leave it open, and a
        traced angle's sine and cosine are not of length 1.
        """
        zero = {**places, **{joint: links[joint].placed((1.0, 0.0)) for joint in self.joints}}
        one, other = (reach(zero, side) for side in self.sides)
        at_zero = Links.of(one, other, self.plane, self.is_cut_in_the_middle)
        way = at_zero.other_pivot.minus(at_zero.pivot)
        apart, (square, other_square) = way.dot(way), self.squares
        along = 0.5 * apart + 0.5 * (square - other_square)  # times the distance of the outer pivots, like the next
        aside = sqrt(maximum(square * apart - along * along, 0.0))
        nearby = at_zero.over.turned(cos(q[self.joints[0]]), sin(q[self.joints[0]]))
        aside, inverse = where(way.cross(nearby) < 0.0, -aside, aside), 1.0 / apart
        over = way.turned(inverse * along, inverse * aside)
        cosine, sine = _turn(at_zero.over, over, square)
        if self.is_cut_in_the_middle:
            other_cosine, other_sine = _turn(at_zero.other_over, over.minus(way), other_square)
        else:
            other_cosine, other_sine = _turn(at_zero.other_over.turned(cosine, sine), way.minus(over), other_square)
        i, j = self.joints
        return angle(sine, cosine, q[i]), angle(self.sense * other_sine, other_cosine, q[j])


def _turn(before: Flat, after: Flat, square: float) -> tuple[Any, Any]:
    """Cosine and sine of the angle between two vectors of one squared length."""
    return 1.0 / square * before.dot(after), 1.0 / square * before.cross(after)


Rule: TypeAlias = Dyad | Follower
"""A rule by which dependent joints follow in closed form."""


def rules(closing: Closing, links: Sequence[Segment], reference: Array) -> tuple[Rule, ...]:
    """The rules by which all dependent joints follow, each after those that it needs; empty where some have none.

    `reference` (n,) closes all loops.
    """
    places = {i: link.at(x) for i, (link, x) in enumerate(zip(links, reference.tolist(), strict=True))}
    known, found = set(closing.primary), list[Rule]()
    left: list[Loop | Follower] = [*closing.loops, *closing.followers]
    while left:
        ready = ((item, rule) for item in left if (rule := _rule(item, known, places)) is not None)
        item, rule = next(ready, (None, None))
        if item is None or rule is None:
            return ()
        left.remove(item)
        known.update(rule.joints)
        found.append(rule)
    return tuple(found) if len(known) == len(links) else ()


def _rule(item: Loop | Follower, known: set[int], places: Mapping[int, Placement]) -> Rule | None:
    """The rule of a coupling whose leader is known, or of a loop in a plane of which all but a dyad is; else None."""
    if isinstance(item, Follower):
        return item if item.leader in known and item.follower not in known else None
    pairs = (item.first, item.second), (item.second, item.first)
    for sides in pairs:
        one, other = (list(side.links) for side in sides)
        for joints, rest in (((*one[-1:], *other[-1:]), one[:-1] + other[:-1]), (tuple(one[-2:]), one[:-2] + other)):
            if len(joints) == 2 and known.issuperset(rest) and not known.intersection(joints):
                return _dyad(sides, (joints[0], joints[1]), places)
    return None


def _dyad(
    sides: tuple[ClosureSide, ClosureSide], joints: tuple[int, int], places: Mapping[int, Placement]
) -> Dyad | None:
    """The dyad of two joints, placed; None where they or joints that turn before them are not parallel, or what slides
    leaves their plane."""
    reached = reach(places, sides[0]), reach(places, sides[1])
    hinges = {hinge.link: hinge for one in reached for hinge in one.hinges}
    axes = {link: np.array([*hinge.axis], dtype=np.float64) for link, hinge in hinges.items()}
    normal = axes[joints[0]]
    if not all(hinges[joint].turns for joint in joints):
        return None
    for link, axis in axes.items():
        leaving = np.cross(normal, axis) if hinges[link].turns else normal @ axis
        if np.abs(leaving).max() > PARALLEL:
            return None
    plane, sense = _across(normal), math.copysign(1.0, float(normal @ axes[joints[1]]))
    found = Links.of(*reached, plane, joints[1] not in sides[0].links)
    squares = float(found.over.dot(found.over)), float(found.other_over.dot(found.other_over))
    return Dyad(sides, joints, plane, squares, sense)


def _across(normal: Array) -> tuple[Vec, Vec]:
    """Two unit vectors across a third, the second to the left of the first; axes of the frame where that is one."""
    away = np.roll(np.eye(3)[np.abs(normal).argmax()], 1)
    first = away - (away @ normal) * normal
    first /= np.linalg.norm(first)
    return Vec(*(first + 0.0).tolist()), Vec(*(np.cross(normal, first) + 0.0).tolist())
