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
    """Delay of the torque: it takes effect `ticks` control periods after it was commanded, by computing and
    communication.

    Sampling and hold alone delay by half a period; a controller that needs the period to compute delays by one more
    (Astrom and Wittenmark, Computer-Controlled Systems, 1997, section 2.3). Before the first torque arrives, the joints
    get what held them. Raises `InputError` unless `ticks` is a whole number from 0 to 64.
    """

    ticks: int

    rank: ClassVar[int] = 0

    def __post_init__(self) -> None:
        if not isinstance(self.ticks, int | np.integer) or self.ticks < 0:
            raise InputError(f"control delay: expected a whole number of control periods, got {self.ticks!r}")
        if self.ticks > BUFFER:
            raise InputError(
                f"control delay: {self.ticks} control periods are longer than the buffer, which holds {BUFFER}: "
                "delay less, or lengthen the control period"
            )

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise nothing: a delay fits any joints, links and control period (s)."""

    def start(self, torque: Array, control_period: float) -> Array:
        """The memory (..., ticks r), whatever the control period (s): the torques on their way, the oldest first, all
        as the torque (..., r) that held the joints, N m (N for a prismatic joint)."""
        return np.tile(torque, self.ticks)

    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The torque (r,) commanded `ticks` periods ago, N m (N for a prismatic joint), and the memory (ticks r,) with
        the one commanded now (r,) at its end, whatever the control period (s)."""
        if self.ticks == 0:
            return torque, memory
        dof = len(torque)
        return Column(memory.of[:dof]), Column((*memory.of[dof:], *torque))
