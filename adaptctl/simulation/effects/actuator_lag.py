"""Drives that follow a torque slowly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from adaptctl.arrays import Array
from adaptctl.scalars import Column
from adaptctl.simulation.effects.effect import ActuatorEffect, require_positive


@dataclass(frozen=True)
class ActuatorLag(ActuatorEffect):
    """First-order lag of a drive's torque x behind the one commanded, u (N m): time_constant x' = u - x, as of a
    current loop. `time_constant` is in s.

    Under a u held over a period x is an exponential. The joints get its mean over the period, so that the impulse is
    exact: what is left out is of third order in the period. Raises `InputError` for a time constant that is not
    positive and finite.
    """

    time_constant: float

    rank: ClassVar[int] = 3

    def __post_init__(self) -> None:
        require_positive(self.time_constant, "actuator lag", "s")

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise nothing: a lag fits any joints, links and control period (s)."""

    def start(self, torque: Array, control_period: float) -> Array:
        """The memory (..., r): the torque (..., r) that held the joints, N m (N for a prismatic joint), whatever the
        control period (s)."""
        return torque

    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The mean torque (r,), N m (N for a prismatic joint), over the control period (s), and as memory the torque
        (r,) at its end; of the torque commanded (r,) and the memory (r,) before."""
        ratio = control_period / self.time_constant
        mean = -math.expm1(-ratio) / ratio
        behind = memory - torque
        return torque + mean * behind, torque + math.exp(-ratio) * behind
