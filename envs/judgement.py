"""Judgement of a control period of tracking: its reward, and whether an error passes its bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.compilation import Kernel, compile_function
from adaptctl.envs.reward import RewardWeights
from adaptctl.scalars import Column, Scalar, absolute, where


class Judged(NamedTuple):
    """Judgement of a control period, one scalar each of any kind (float, array over periods or arms, or symbol to be
    compiled): `reward`, no unit, without what the end of an episode costs, and `lost`, 1.0 if a joint's position error
    passed its bound, else 0.0. Nothing is checked."""

    reward: Scalar
    lost: Scalar


@dataclass(frozen=True, eq=False)
class Judgement:
    """Judgement of the control periods of r joints that track a reference, as an equation over scalars of any kind
    (floats, arrays, or symbols) and as native code: rewards by the `RewardWeights` `weights`, and whether a joint's
    position error passes its `error_bound` (r,), rad (m if prismatic). `torque_limits` (r,), N m (N for a prismatic
    joint), are what torques are measured by. Nothing is checked.
    """

    weights: RewardWeights
    error_bound: Array
    torque_limits: Array

    def equation(self, p: Column, v: Column, reference_p: Column, reference_v: Column, torque: Column) -> Judged:
        """The judgement of a period, as `Judged` has it, from Columns (r,), vectors of scalars of any kind: the
        positions `p`, rad (m if prismatic), and velocities `v`, rad/s (m/s), that were reached, the reference's there,
        and the torques that were applied before, N m (N for a prismatic joint). Nothing is checked."""
        error, rate = p - reference_p, v - reference_v
        relative = Column(x / limit for x, limit in zip(torque, self.torque_limits.tolist(), strict=True))
        return Judged(-self.weights.cost(error @ error, rate @ rate, relative @ relative), self._lost(error))

    @cached_property
    def kernel(self) -> Kernel:
        """The native code of the equation, a `Kernel`: called with arrays (r,) in its order and units it returns a
        `Judged` of two floats; its `map` takes arrays (m, r) of m periods, and returns one of two arrays (m,)."""
        names = ("p", "v", "reference_p", "reference_v", "torque")
        return compile_function(self.equation, dict.fromkeys(names, len(self.error_bound)), name="judgement")

    def _lost(self, error: Column) -> Scalar:
        lost: Scalar = 0.0
        for x, bound in zip(error, self.error_bound.tolist(), strict=True):
            lost = where(absolute(x) > bound, 1.0, lost)
        return lost
