"""Limits of a joint."""

from __future__ import annotations

import math
from dataclasses import dataclass

from adaptctl.arrays import real_number
from adaptctl.errors import InputError


@dataclass(frozen=True)
class Limits:
    """Limits of a joint: its position range `lower` to `upper` (rad, or m if prismatic), greatest speed `velocity`
    (rad/s, or m/s) and greatest torque or force `effort` (N m, or N), each infinite, so no limit, by default. Raises
    `InputError` for a limit that is no real number, and unless lower < upper and the others are positive."""

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "velocity", "effort"):
            object.__setattr__(self, name, real_number(getattr(self, name), f"limits: {name}"))
        if not self.lower < self.upper:
            raise InputError(f"position limits: expected lower < upper, got {self.lower} and {self.upper}")
        if not (self.velocity > 0.0 and self.effort > 0.0):
            raise InputError(f"limits: expected positive velocity and effort, got {self.velocity}, {self.effort}")
