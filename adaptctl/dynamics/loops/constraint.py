"""Loop closure equations and their derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from adaptctl.description.loops import ClosureKind
from adaptctl.dynamics.recursion.motion import AXES, GROUND
from adaptctl.dynamics.recursion.segment import Placement
from adaptctl.scalars import ZERO, Column, Mat, Scalar, Vec, cross, product


@dataclass(frozen=True)
class ClosureSide:
    """One side of a loop closure."""

    links: tuple[int, ...]
    rotation: Mat
    origin: Vec


@dataclass(frozen=True)
class Loop:
    """Closed kinematic loop of a tree."""

    first: ClosureSide
    second: ClosureSide
    kind: ClosureKind


class Hinge(NamedTuple):
    """Loop joint at one configuration, in the common link's axes."""

    link: int
    turns: bool
    axis: Vec
    origin: Vec


class Reach(NamedTuple):
    """Side of a loop closure, in the common link's axes."""

    hinges: list[Hinge]
    rotation: Mat
    origin: Vec


def reach(places: Sequence[Placement] | Mapping[int, Placement], side: ClosureSide) -> Reach:
    """One side of a loop closure at one configuration."""
    rotation, origin, hinges = AXES, ZERO, []
    for i in side.links:
        place = places[i]
        joint = origin + rotation @ place.near
        rotation = Mat(*(place.down(row) for row in (rotation.x, rotation.y, rotation.z)))
        hinges.append(Hinge(i, place.segment.turns, rotation @ place.segment.axis, joint))
        origin = joint + rotation @ place.shift
    return Reach(hinges, product(rotation, side.rotation), origin + rotation @ side.origin)


class Constraint:
    """Loop closure at one configuration: residual and derivatives."""

    def __init__(self, places: Sequence[Placement], loop: Loop) -> None:
        self.kind = loop.kind
        self.first, self.second = reach(places, loop.first), reach(places, loop.second)
        self._seen = self.first.rotation.T

    def residual(self) -> list[Scalar]:
        """Closure residual of 3 (POINT), 5 (AXIS) or 6 (WELD) scalars."""
        gap = self._seen @ (self.second.origin - self.first.origin)
        turn = product(self._seen, self.second.rotation)
        attitude = {
            ClosureKind.POINT: (),
            ClosureKind.AXIS: (-turn.y.z, turn.x.z),
            ClosureKind.WELD: (
                0.5 * (turn.z.y - turn.y.z),
                0.5 * (turn.x.z - turn.z.x),
                0.5 * (turn.y.x - turn.x.y),
            ),
        }[self.kind]
        return [*gap, *attitude]

    def rates(self) -> dict[int, list[Scalar]]:
        """Derivatives of the residual by the loop's joints."""
        outward = {h.link: self._seen_rows(*self._unit(h)) for h in self.second.hinges}
        inward = {h.link: [-x for x in self._seen_rows(*self._unit(h))] for h in self.first.hinges}
        return outward | inward

    def bias(self, u: Column, w: Column) -> list[Scalar]:
        """Second derivative of the residual along velocities u and w (n,)."""
        one, other = _carried(self.first, u, w), _carried(self.second, u, w)
        turning = other.alpha - one.alpha
        if self.kind is ClosureKind.AXIS:
            # The sides turn against each other about the axis, so its rows turn under that motion with the first.
            turning = turning - 0.5 * (cross(one.omega, other.rho - one.rho) + cross(one.rho, other.omega - one.omega))
        return self._seen_rows(turning, other.acc - one.acc)

    def _unit(self, hinge: Hinge) -> tuple[Vec, Vec]:
        if hinge.turns:
            return hinge.axis, cross(hinge.axis, self.second.origin - hinge.origin)
        return ZERO, hinge.axis

    def _seen_rows(self, turning: Vec, moving: Vec) -> list[Scalar]:
        rows: list[Scalar] = [*(self._seen @ moving)]
        if self.kind is not ClosureKind.POINT:
            attitude = self._seen @ turning
            rows += [attitude.x, attitude.y] if self.kind is ClosureKind.AXIS else [*attitude]
        return rows


class Carried(NamedTuple):
    """Motion of a closing frame under two joint velocities."""

    omega: Vec
    rho: Vec
    alpha: Vec
    acc: Vec


def _carried(reached: Reach, u: Column, w: Column) -> Carried:
    omega, rho, alpha, acc = ZERO, ZERO, ZERO, ZERO
    if not reached.hinges:  # The closing frame is on the common link, or on the ground.
        return Carried(ZERO, ZERO, ZERO, ZERO)
    ends = [hinge.origin for hinge in reached.hinges[1:]] + [reached.origin]
    for hinge, end in zip(reached.hinges, ends, strict=True):
        spin = 0.5 * (cross(w[hinge.link] * omega, hinge.axis) + cross(u[hinge.link] * rho, hinge.axis))
        if hinge.turns:
            omega, rho = omega + u[hinge.link] * hinge.axis, rho + w[hinge.link] * hinge.axis
            alpha = alpha + spin
        else:
            acc = acc + 2.0 * spin
        arm = end - hinge.origin
        acc = acc + cross(alpha, arm) + 0.5 * (cross(omega, cross(rho, arm)) + cross(rho, cross(omega, arm)))
    return Carried(omega, rho, alpha, acc)


@dataclass(frozen=True)
class Follower:
    """Coupled joint: q[follower] = ratio * q[leader] + offset."""

    follower: int
    leader: int
    ratio: float
    offset: float

    @property
    def joints(self) -> tuple[int]:
        """Index of the following joint, in a tuple."""
        return (self.follower,)

    def followed(self, _places: object, _links: object, q: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Position of the following joint, in a tuple."""
        return (self.ratio * q[self.leader] + self.offset,)


@dataclass(frozen=True)
class Closing:
    """Loop closure conditions of a tree, with dependent joints."""

    loops: tuple[Loop, ...]
    followers: tuple[Follower, ...]
    rows: tuple[int, ...]
    primary: tuple[int, ...]
    dependent: tuple[int, ...]

    @property
    def looped(self) -> tuple[bool, ...]:
        """True for each primary joint that moves a loop."""
        links = {link for loop in self.loops for side in (loop.first, loop.second) for link in side.links}
        links |= {c.leader for c in self.followers if c.follower in links}
        return tuple(joint in links for joint in self.primary)

    def residual(self, places: Sequence[Placement], q: Column) -> Column:
        """Closure residual (c,) of loops, then couplings, in m and rad."""
        rows = [x for loop in self.loops for x in Constraint(places, loop).residual()]
        rows += [q[c.follower] - c.ratio * q[c.leader] - c.offset for c in self.followers]
        return Column(rows[i] for i in self.rows)

    def jacobian(self, places: Sequence[Placement]) -> list[Column]:
        """Jacobian (c, n) of the residual, as n columns."""
        n, columns, above = len(places), [dict[int, Scalar]() for _ in places], 0
        for loop in self.loops:
            for joint, rates in Constraint(places, loop).rates().items():
                columns[joint] |= {above + i: rate for i, rate in enumerate(rates)}
            above += loop.kind.rows
        for i, c in enumerate(self.followers):
            columns[c.follower][above + i] = 1.0
            columns[c.leader][above + i] = -c.ratio
        return [Column(columns[j].get(i, 0.0) for i in self.rows) for j in range(n)]

    def bias(self, places: Sequence[Placement], u: Column, w: Column) -> Column:
        """Second derivative (c,) of the residual along two velocities (n,)."""
        rows = [x for loop in self.loops for x in Constraint(places, loop).bias(u, w)]
        rows += [0.0] * len(self.followers)
        return Column(rows[i] for i in self.rows)


def common_ancestor(parents: Sequence[int], first: int, second: int) -> int:
    """Last common link of two branches, or -1 for the ground."""
    above = {GROUND, *ancestry(parents, first)}
    while second not in above:
        second = parents[second]
    return second


def ancestry(parents: Sequence[int], link: int) -> list[int]:
    """Link indices from the ground to a link, inclusive."""
    chain: list[int] = []
    while link != GROUND:
        chain.append(link)
        link = parents[link]
    return chain[::-1]
