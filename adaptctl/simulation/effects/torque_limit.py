"""Drives that are weaker than the controller believes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.scalars import Column, clip
from adaptctl.simulation.effects.effect import ActuatorEffect, at_least_zero


@dataclass(frozen=True, eq=False)
class TorqueLimit(ActuatorEffect):
    """Limit of a drive's torque: at most `limit` in magnitude (N m, N of a prismatic joint; one number or (r,),
    infinity for no limit), whatever is asked of it.

    The environment's own limits are those of its actions, which a controller can know; these are the plant's. `rank` 1:
    after a delay; `mark` is the name under which a rollout marks the periods in which it cut a torque. A `Plant` raises
    `InputError` for limits that are negative, NaN or do not fit its r joints.
    """

    limit: ArrayLike

    rank: ClassVar[int] = 1
    mark: ClassVar[str | None] = "torque_limited"

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless the limit (N m, N for a prismatic joint) is a number of at least 0, or one for each
        of `dof` (r) joints; it may be infinite, and links and control period (s) any."""
        at_least_zero(self.limit, dof, "torque limit")

    def start(self, torque: Array, control_period: float) -> Array:
        """An empty memory (0,), one for all arms, for any torque (..., r) and control period (s)."""
        return np.zeros(0)

    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The torque (r,) within the limits nearest to the one asked (r,), N m (N for a prismatic joint), and the empty
        memory (0,), whatever the control period (s). Raises `InputError` for limits that do not fit r joints."""
        limits = at_least_zero(self.limit, len(torque), "torque limit").tolist()
        return Column(clip(x, -most, most) for x, most in zip(torque, limits, strict=True)), memory
