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
    """Torque limit (saturation) of the drives: each joint's torque is at most `limit` in magnitude, N m (N of a
    prismatic joint), whatever is asked of it; one number or one a joint (r,), infinity for no limit.

    An environment's own torque limits are those of its actions, which a controller can know; this one is hidden in the
    plant. `rank` is 1, the effect's position in the order from the controller to the joints: after a delay. `mark` is
    the name under which a rollout flags the control periods in which the limit cut a torque. The class itself checks
    nothing; a `Plant` raises `InputError` for limits that are no numbers, negative, NaN or do not fit its r joints.
    """

    limit: ArrayLike

    rank: ClassVar[int] = 1
    mark: ClassVar[str | None] = "torque_limited"

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless the limit, N m (N for a prismatic joint), is one number of at least 0 or one for
        each of `dof` (r) joints; infinity is allowed. The names `links` and `control_period` (s) are not used."""
        at_least_zero(self.limit, dof, "torque limit")

    def start(self, torque: Array, control_period: float) -> Array:
        """An empty internal state (0,), one for all arms: a limit keeps nothing from one control period to the next.
        The `torque` (..., r) on the r joints and `control_period` (s) are not used. Nothing is raised."""
        return np.zeros(0)

    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The torque (r,) of r joints clipped to the limits, N m (N for a prismatic joint), from the `torque` (r,)
        asked for, and the `memory` (0,) as it was. `control_period` (s) is not used. Vectors are Columns of scalars
        of any kind: floats, arrays, or symbols to be compiled. Raises `InputError` for limits that are negative, NaN or
        do not fit r joints."""
        limits = at_least_zero(self.limit, len(torque), "torque limit").tolist()
        return Column(clip(x, -most, most) for x, most in zip(torque, limits, strict=True)), memory
