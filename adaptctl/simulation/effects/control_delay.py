"""Torques that arrive late."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation.effects.effect import ActuatorEffect

BUFFER = 64
"""Control periods of torques that are kept."""


@dataclass(frozen=True)
class ControlDelay(ActuatorEffect):
    """Pure delay (dead time) of the commanded torque: it reaches the joints `ticks` control periods after it was
    commanded, by computing and communication.

    Sampling and hold alone delay by half a period; a controller that needs the period to compute delays by one more
    (Astrom and Wittenmark, Computer-Controlled Systems, 1997, section 2.3). Before the first torque arrives, the joints
    get the torque that held them. `rank` 0: the delay comes first of the actuator effects. It has no flag in a rollout.
    Raises `InputError` unless `ticks` (unitless) is an integer from 0 to 64 and not a bool.
    """

    ticks: int

    rank: ClassVar[int] = 0

    def __post_init__(self) -> None:
        if isinstance(self.ticks, bool) or not isinstance(self.ticks, int | np.integer) or self.ticks < 0:
            raise InputError(f"control delay: expected a whole number of control periods, got {self.ticks!r}")
        if self.ticks > BUFFER:
            raise InputError(
                f"control delay: {self.ticks} control periods are longer than the buffer, which holds {BUFFER}: "
                "delay less, or lengthen the control period"
            )

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise nothing: a delay fits any number of joints `dof`, any `links` and any control period (s)."""

    def start(self, torque: Array, control_period: float) -> Array:
        """The initial internal state (..., ticks r) of the delay, the torques on their way to the r joints, the oldest
        first: `torque` (..., r), the torque that held the joints, N m (N for a prismatic joint), repeated `ticks`
        times, the delay's number of control periods. `control_period` (s) is not used. Nothing is checked."""
        return np.tile(torque, self.ticks)

    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The torque (r,) of r joints that was commanded so many control periods ago as the delay's `ticks`, and the
        internal state (ticks r,) after this period: the torques commanded since, the oldest first and `torque` (r,),
        the one commanded now, last. All are in N m (N for a prismatic joint).

        `memory` (ticks r,) is the internal state before this period; its length is not checked. With `ticks` 0 both
        arguments are returned as they are. `control_period` (s) is not used. Vectors are Columns of scalars of any
        kind: floats, arrays, or symbols to be compiled.
        """
        if self.ticks == 0:
            return torque, memory
        dof = len(torque)
        return Column(memory.of[:dof]), Column((*memory.of[dof:], *torque))
