"""Target inertias that a sampled loop carries."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import GainError
from adaptctl.optional_packages import needed

SHARES = np.array([0.0, *np.geomspace(1e-2, 1.0, 5)])
"""stiffnesses of the surroundings for which a loop is checked, relative to the greatest"""
SCALES = 2.0 ** (0.25 * np.arange(1, 25))
"""factors of an inertia that are tried where it is refused"""
MARGIN = 1e-9


@dataclass(frozen=True)
class FeltForce:
    """Way of a force into a law: corner frequency in rad/s of its filters, their number, 1 or 2, and periods late."""

    cutoff: float
    stages: int
    delay: int


@dataclass(frozen=True)
class DrivenLoop:
    """Arms in S postures at rest, driven by what they feel of springs: matrices (S, r, r), a period in s."""

    mass: Array
    inertia: Array
    damping: Array
    stiffness: Array
    touched: Sequence[Array]
    period: float
    force: FeltForce

    def radius(self, scale: float, surroundings: float) -> float:
        """Greatest modulus of the loops' eigenvalues with so many times the inertia, and springs up to a stiffness."""
        springs = (k * one for one in self.touched for k in surroundings * SHARES)
        return max(float(np.abs(np.linalg.eigvals(self._step(scale, one))).max()) for one in springs)

    def _step(self, scale: float, spring: Array) -> Array:
        """Matrices (S, m, m) of a period: position, velocity, the target's, force in two stages, torques to come."""
        S, r = self.mass.shape[:2]
        late, keep = self.force.delay, math.exp(-min(self.force.cutoff * self.period, 700.0))
        x, v, target, first, second, *torques = self._parts(S, r, 5 + late)
        moved, pushed = self._held(spring)
        felt = -spring @ x
        one = keep * first + (1.0 - keep) * felt
        two = keep * second + (1.0 - keep) * one if self.force.stages == 2 else one
        force = second if self.force.stages == 2 else one
        wanted = np.linalg.solve(scale * self.inertia, force - self.damping @ v - self.stiffness @ x)
        torque = self.mass @ wanted - self.damping @ (v - target) - force
        torques.append(torque)
        after = moved @ np.concatenate((x, v), axis=1) + pushed @ torques[0]
        return np.concatenate((after, target + self.period * wanted, one, two, *torques[1:]), axis=1)

    @staticmethod
    def _parts(S: int, r: int, count: int) -> list[Array]:
        """Rows (S, r, m) that take a part of the state each."""
        whole = np.broadcast_to(np.eye(count * r), (S, count * r, count * r))
        return [whole[:, i * r : (i + 1) * r] for i in range(count)]

    def _held(self, spring: Array) -> tuple[Array, Array]:
        """Change (S, 2r, 2r) of positions and velocities between springs, and by a held torque (S, 2r, r)."""
        with needed("a target inertia"):
            from scipy.linalg import expm

        S, r = self.mass.shape[:2]
        rates = np.zeros((S, 3 * r, 3 * r))
        rates[:, :r, r : 2 * r] = np.eye(r)
        rates[:, r : 2 * r, :r] = -np.linalg.solve(self.mass, spring)
        rates[:, r : 2 * r, 2 * r :] = np.linalg.inv(self.mass)
        whole = expm(self.period * rates)
        return whole[:, : 2 * r, : 2 * r], whole[:, : 2 * r, 2 * r :]


def validate_inertia(arm: str, loop: DrivenLoop, surroundings: float) -> None:
    """Raise `GainError` for a target inertia with which an arm would not come to rest between springs."""

    def rests(scale: float) -> bool:
        return loop.radius(scale, surroundings) < 1.0 + MARGIN

    if rests(1.0):
        return
    more, less = (next((s for s in scales if rests(s)), None) for scales in (SCALES, 1.0 / SCALES))
    uses = [f"at {word} {s:.3g} times this inertia" for word, s in (("least", more), ("most", less)) if s is not None]
    raise GainError(
        f"{arm}: inertia: at springs of up to {surroundings:g} N m/rad (N/m) it would swing by itself, with a control "
        f"period of {loop.period:g} s and forces through filters of {loop.force.cutoff:g} rad/s; use "
        f"{' or '.join([*uses, 'more damping'])}, or softer `surroundings`"
    )
