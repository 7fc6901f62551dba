"""Drives whose torque cannot jump."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.scalars import Column, clip
from adaptctl.simulation.effects.effect import ActuatorEffect, at_least_zero


@dataclass(frozen=True, eq=False)
class TorqueRateLimit(ActuatorEffect):
    """Limit of a drive's torque rate: the torque changes by at most `rate` (N m/s, one number or (r,)), supply voltage
    over inductance."""

    rate: ArrayLike

    rank: ClassVar[int] = 2
    mark: ClassVar[str | None] = "rate_limited"

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless the rate is a number of at least 0, or one a joint."""
        at_least_zero(self.rate, dof, "torque rate limit")

    def start(self, torque: Array, control_period: float) -> Array:
        """The memory (r,): the torque now, N m."""
        return torque

    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The torque (r,) N m nearest to the one asked that is within reach of the last one; it is the memory too."""
        steps = (at_least_zero(self.rate, len(torque), "torque rate limit") * control_period).tolist()
        given = Column(clip(x, y - step, y + step) for x, y, step in zip(torque, memory, steps, strict=True))
        return given, given
