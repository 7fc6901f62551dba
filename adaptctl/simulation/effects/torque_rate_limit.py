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
    """Limit of a drive's torque rate: the torque changes by at most `rate` (N m/s, N/s of a prismatic joint; one number
    or (r,), infinity for no limit), as the supply voltage over the winding's inductance limits it.

    `rank` 2: after a delay and a torque limit; `mark` is the name under which a rollout marks the periods in which it
    changed a torque. A `Plant` raises `InputError` for rates that are negative, NaN or do not fit its r joints.
    """

    rate: ArrayLike

    rank: ClassVar[int] = 2
    mark: ClassVar[str | None] = "rate_limited"

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless the rate (N m/s, N/s for a prismatic joint) is a number of at least 0, or one for
        each of `dof` (r) joints; it may be infinite, and links and control period (s) any."""
        at_least_zero(self.rate, dof, "torque rate limit")

    def start(self, torque: Array, control_period: float) -> Array:
        """The memory (..., r): the torque (..., r) that held the joints, N m (N for a prismatic joint), whatever the
        control period (s)."""
        return torque

    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The torque (r,) nearest to the one asked (r,), N m (N for a prismatic joint), that differs from the last one,
        `memory` (r,), by at most the rate times the control period (s); it is the memory after it too. Raises
        `InputError` for rates that do not fit r joints."""
        steps = (at_least_zero(self.rate, len(torque), "torque rate limit") * control_period).tolist()
        given = Column(clip(x, y - step, y + step) for x, y, step in zip(torque, memory, steps, strict=True))
        return given, given
