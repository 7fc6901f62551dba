"""Planar loops closed by two links, in closed form."""

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

PARALLEL_TOLERANCE = 1e-12
"""sine of the angle between axes that count as parallel"""


class Flat(NamedTuple):
    """Vector (2,) in a loop's plane, in m."""

    x: Any
    y: Any

    def minus(self, other: Flat) -> Flat:
        """Difference to another vector."""
        return Flat(self.x - other.x, self.y - other.y)

    def turned(self, cosine: Any, sine: Any) -> Flat:
        """Vector rotated by an angle's cosine and sine."""
        return Flat(cosine * self.x - sine * self.y, cosine * self.y + sine * self.x)

    def dot(self, other: Flat) -> Any:
        """Inner product with another vector, m^2."""
        return self.x * other.x + self.y * other.y

    def cross(self, other: Flat) -> Any:
        """Cross product with another vector, m^2."""
        return self.x * other.y - self.y * other.x


class Links(NamedTuple):
    """Geometry of a dyad in its plane."""

    pivot: Flat
    over: Flat
    other_pivot: Flat
    other_over: Flat

    @classmethod
    def of(cls, one: Reach, other: Reach, plane: tuple[Vec, Vec], is_cut_in_the_middle: bool) -> Links:
        """Geometry of a dyad, from the loop's sides."""
        if is_cut_in_the_middle:
            points = one.hinges[-1].origin, one.origin, other.hinges[-1].origin, other.origin
        else:
            points = one.hinges[-2].origin, one.hinges[-1].origin, other.origin, one.origin
        pivot, middle, other_pivot, end = (Flat(*(dot(u, point) for u in plane)) for point in points)
        start = other_pivot if is_cut_in_the_middle else middle
        return cls(pivot, middle.minus(pivot), other_pivot, end.minus(start))


@dataclass(frozen=True)
class Dyad:
    """Closed form of a planar RRR loop."""

    sides: tuple[ClosureSide, ClosureSide]
    joints: tuple[int, int]
    plane: tuple[Vec, Vec]
    squares: tuple[float, float]
    sense: float

    @property
    def is_cut_in_the_middle(self) -> bool:
        """True if the loop is cut at the middle pivot."""
        return self.joints[1] not in self.sides[0].links

    def followed(
        self, places: Mapping[int, Placement], links: Sequence[Segment], q: Sequence[Scalar]
    ) -> tuple[Scalar, ...]:
        """Angles of the two dependent joints."""
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
    return 1.0 / square * before.dot(after), 1.0 / square * before.cross(after)


Rule: TypeAlias = Dyad | Follower
"""Closed-form rule of dependent joints."""


def rules(closing: Closing, links: Sequence[Segment], reference: Array) -> tuple[Rule, ...]:
    """Closed-form rules of all dependent joints, in order."""
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
    reached = reach(places, sides[0]), reach(places, sides[1])
    hinges = {hinge.link: hinge for one in reached for hinge in one.hinges}
    axes = {link: np.array([*hinge.axis], dtype=np.float64) for link, hinge in hinges.items()}
    normal = axes[joints[0]]
    if not all(hinges[joint].turns for joint in joints):
        return None
    for link, axis in axes.items():
        leaving = np.cross(normal, axis) if hinges[link].turns else normal @ axis
        if np.abs(leaving).max() > PARALLEL_TOLERANCE:
            return None
    plane, sense = _across(normal), math.copysign(1.0, float(normal @ axes[joints[1]]))
    found = Links.of(*reached, plane, joints[1] not in sides[0].links)
    squares = float(found.over.dot(found.over)), float(found.other_over.dot(found.other_over))
    return Dyad(sides, joints, plane, squares, sense)


def _across(normal: Array) -> tuple[Vec, Vec]:
    away = np.roll(np.eye(3)[np.abs(normal).argmax()], 1)
    first = away - (away @ normal) * normal
    first /= np.linalg.norm(first)
    return Vec(*(first + 0.0).tolist()), Vec(*(np.cross(normal, first) + 0.0).tolist())
