"""Drives that follow a torque slowly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation.effects.effect import ActuatorEffect, require_positive


@dataclass(frozen=True)
class ActuatorLag(ActuatorEffect):
    """First-order lag of a drive's torque x behind the commanded torque u, both N m (N for a prismatic joint), as of a
    current loop: time_constant dx/dt = u - x. `time_constant` is in s, one number for all joints.

    While u is held over a control period, x is an exponential. The joints get its mean over the period, so that the
    impulse is exact; the error of doing so is of third order in the period. `rank` 3: the lag comes last, after a
    delay, a torque limit and a rate limit. It has no flag in a rollout. Raises `InputError` unless `time_constant` is a
    positive finite number and not a bool.
    """

    time_constant: float

    rank: ClassVar[int] = 3

    def __post_init__(self) -> None:
        if isinstance(self.time_constant, bool):
            raise InputError(f"actuator lag: expected a positive number of s, got {self.time_constant}")
        require_positive(self.time_constant, "actuator lag", "s")

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise nothing: a lag fits any number of joints `dof`, any `links` and any control period (s)."""

    def start(self, torque: Array, control_period: float) -> Array:
        """The initial internal state (..., r) of the lag, the torques of r drives, N m (N for a prismatic joint):
        `torque` (..., r) itself, not a copy, the torque that held the joints. `control_period` (s) is not used. Nothing
        is checked."""
        return torque

    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The mean torque (r,) that r joints get over one `control_period` (s), and the lag's internal state (r,) after
        it, the drives' torque x at the period's end; all N m (N for a prismatic joint). `torque` (r,) is the commanded
        torque u, held over the period, and `memory` (r,) is x at its start: time_constant dx/dt = u - x. Vectors are
        Columns of scalars of any kind: floats, arrays, or symbols to be compiled. Raises `ValueError` where these
        differ in length. The period, which must be positive, is not checked."""
        ratio = control_period / self.time_constant
        mean = -math.expm1(-ratio) / ratio
        behind = memory - torque
        return torque + mean * behind, torque + math.exp(-ratio) * behind
