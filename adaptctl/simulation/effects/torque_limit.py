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
    """Limit of a drive's torque: at most `limit` (N m, N of a prismatic joint; one number or (r,)), whatever is asked
    of it.

    The environment's own limits are those of its actions, which a controller can know; these are the plant's.
    """

    limit: ArrayLike

    rank: ClassVar[int] = 1
    mark: ClassVar[str | None] = "torque_limited"

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless the limit is a number of at least 0, or one a joint."""
        at_least_zero(self.limit, dof, "torque limit")

    def start(self, torque: Array, control_period: float) -> Array:
        """An empty memory (0,)."""
        return np.zeros(0)

    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The nearest torque (r,) N m within the limits, and the empty memory."""
        limits = at_least_zero(self.limit, len(torque), "torque limit").tolist()
        return Column(clip(x, -most, most) for x, most in zip(torque, limits, strict=True)), memory
