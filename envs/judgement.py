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
    """Reward and termination of a control period, one scalar each of any kind (float, array over periods or arms, or
    symbol to be compiled): `reward`, unitless, without the penalty for an episode's end, and `lost`, 1.0 if a joint's
    position error passed its bound, else 0.0. Nothing is checked."""

    reward: Scalar
    lost: Scalar


@dataclass(frozen=True, eq=False)
class Judgement:
    """Reward and termination rule of control periods in which r joints track a reference, as an equation over scalars
    of any kind (floats, arrays, or symbols) and as native code. Rewards have the `RewardWeights` `weights`; an episode
    ends where a joint's position error is greater in magnitude than its `error_bound` (r,), rad (m if prismatic).
    Torques count relative to `torque_limits` (r,), N m (N for a prismatic joint). Nothing is checked."""

    weights: RewardWeights
    error_bound: Array
    torque_limits: Array

    def equation(self, p: Column, v: Column, reference_p: Column, reference_v: Column, torque: Column) -> Judged:
        """The reward and the termination flag of one control period, a `Judged`, from Columns (r,), vectors of scalars
        of any kind. These are the positions `p`, rad (m if prismatic), and velocities `v`, rad/s (m/s), reached at the
        period's end, the reference's positions `reference_p` and velocities `reference_v` then, and the `torque`
        applied over the period, N m (N). The reward is minus the weighted sums over the joints of squared position
        errors, squared velocity errors and (torque/limit)^2. Nothing is checked."""
        error, rate = p - reference_p, v - reference_v
        relative = Column(x / limit for x, limit in zip(torque, self.torque_limits.tolist(), strict=True))
        return Judged(-self.weights.cost(error @ error, rate @ rate, relative @ relative), self._lost(error))

    @cached_property
    def kernel(self) -> Kernel:
        """Native code of the method `equation`, a `Kernel`, made at the first use. Called with arrays (r,) for `p`,
        `v`, `reference_p`, `reference_v` and `torque`, in that equation's units, it returns a `Judged` of two floats;
        its method `map` takes arrays (m, r) of m periods, and returns a `Judged` of two arrays (m,). Raises
        `InputError` for other shapes."""
        names = ("p", "v", "reference_p", "reference_v", "torque")
        return compile_function(self.equation, dict.fromkeys(names, len(self.error_bound)), name="judgement")

    def _lost(self, error: Column) -> Scalar:
        lost: Scalar = 0.0
        for x, bound in zip(error, self.error_bound.tolist(), strict=True):
            lost = where(absolute(x) > bound, 1.0, lost)
        return lost
