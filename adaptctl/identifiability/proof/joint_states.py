"""Random joint positions and velocities over the prime field."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.description import Description
from adaptctl.description.loops import Coupling
from adaptctl.dynamics.recursion.segment import Placement, Segment
from adaptctl.identifiability.proof.exact_geometry import ExactGeometry
from adaptctl.identifiability.proof.prime_field import modular, random_residues
from adaptctl.identifiability.proof.simplest import simplest_rational, turn
from adaptctl.scalars import Column


@dataclass(frozen=True)
class Coordinate:
    """A joint's position at `samples` random states over the prime field (integers modulo 2^31 - 1): the `cosine` and
    the `sine` of its angle, for revolute joints, and its `length`, for prismatic ones, each a `Modular` scalar. Angle
    and length are drawn independently of each other, though a joint uses only one. Nothing is checked."""

    cosine: Any
    sine: Any
    length: Any

    def placed(self, link: Segment) -> Placement:
        """The pose in its parent link, as a `Placement`, of a link of geometry `link` whose joint is at this position:
        by its cosine and sine where the joint turns, else by its length. Nothing is checked."""
        return link.placed((self.cosine, self.sine) if link.turns else (self.length,))

    def followed(self, coupling: Coupling, parts: int, angle: float) -> Coordinate:
        """The position of a joint that follows this one, the leader, by a `coupling`: follower = ratio * leader +
        offset.

        This one's `cosine` and `sine` must be those of the leader's angle divided by `parts`, a whole number that makes
        ratio times `parts` whole too; its `length`, for prismatic joints, is the leader's. `angle`, in rad, is the
        follower's where the leader's is zero. Nothing is checked.
        """
        ratio = simplest_rational(coupling.ratio)
        c, s = _power((self.cosine, self.sine), int(ratio * parts))
        ahead = _numbers(angle)
        offset = modular(simplest_rational(coupling.offset))
        cosine, sine = _product((c, s), ahead)
        return Coordinate(cosine, sine, self.length * ratio + offset)

    def whole(self, parts: int) -> Coordinate:
        """The joint position whose angle is `parts` times this one's, `parts` a whole number, by its cosine and sine:
        the whole angle where this one has a `parts`-th of it. The length stays. Nothing is checked."""
        return Coordinate(*_power((self.cosine, self.sine), parts), self.length)


def random_places(
    description: Description, geometry: ExactGeometry, samples: int, rng: np.random.Generator
) -> list[Placement]:
    """The poses of a tree's links in their parents at `samples` random states, one `Placement` for each link, in the
    links' order, whose scalars have all samples.

    Joint coordinates are drawn with NumPy's `rng`, uniform among the nonzero residues modulo the prime 2^31 - 1 (half
    tangents for angles). `description` is the tree's, `geometry` its geometry, exact and in residues. Joints that
    follow others by couplings are where their leaders put them. Nothing is checked.
    """
    couplings = () if description.loops is None else description.loops.couplings
    index = {name: i for i, name in enumerate(description.joint_names)}
    links, shifts = geometry.links, geometry.shifts
    followers = {index[c.follower]: c for c in couplings}
    parts = [1] * len(links)
    for c in couplings:
        parts[index[c.leader]] = math.lcm(parts[index[c.leader]], simplest_rational(c.ratio).denominator)
    free = [_random(samples, rng) for _ in links]
    out = []
    for i, link in enumerate(links):
        if i in followers:
            c = followers[i]
            leader = index[c.leader]
            angle = c.offset + shifts[i] - c.ratio * shifts[leader]
            place = free[leader].followed(c, parts[leader], angle)
        else:
            place = free[i].whole(parts[i])
        out.append(place.placed(link))
    return out


def random_rates(description: Description, samples: int, rng: np.random.Generator) -> Column:
    """The velocities of a tree's N joints, in the links' order, at `samples` random states: a `Column` (N,), a vector
    of scalars, each a `Modular` of all samples. They are drawn with NumPy's `rng`, uniform among the nonzero residues
    modulo the prime 2^31 - 1. Joints that follow others by couplings of the `description` have their ratio times the
    leader's. Nothing is checked."""
    rates = [random_residues(samples, rng) for _ in description.links]
    index = {name: i for i, name in enumerate(description.joint_names)}
    for c in () if description.loops is None else description.loops.couplings:
        rates[index[c.follower]] = rates[index[c.leader]] * simplest_rational(c.ratio)
    return Column(rates)


def _random(samples: int, rng: np.random.Generator) -> Coordinate:
    t, length = random_residues(samples, rng), random_residues(samples, rng)
    square = t * t
    over = 1.0 / (1.0 + square)
    return Coordinate((1.0 - square) * over, 2.0 * t * over, length)


def _product(one: tuple[Any, Any], other: tuple[Any, Any]) -> tuple[Any, Any]:
    """Cosine and sine of the sum of two angles."""
    (a, b), (c, d) = one, other
    return a * c - b * d, a * d + b * c


def _power(turn: tuple[Any, Any], times: int) -> tuple[Any, Any]:
    """Cosine and sine of so many times an angle."""
    if times < 0:
        c, s = _power(turn, -times)
        return c, -s
    out: tuple[Any, Any] = (1.0, 0.0)
    while times:
        if times & 1:
            out = _product(out, turn)
        turn, times = _product(turn, turn), times >> 1
    return out


def _numbers(angle: float) -> tuple[Any, Any]:
    c, s = turn(angle).cosine_and_sine
    return modular(c), modular(s)
