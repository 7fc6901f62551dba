"""Planned stop."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import StoppedReference
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.hardware.resting import StoppingDistance
from adaptctl.hardware.touch_reaction import Retreat

HOLD = 0.5
"""s for which an arm is held after a stop"""
PATIENCE = 2.0
"""s after that, in which it must have come to rest"""


@dataclass(frozen=True)
class PlannedStop:
    """Path to rest, its end in s, the state of the controller that follows it, or yields to a touch, or still feels."""

    path: Reference
    end: float
    state: Any
    reason: str
    yields: bool = False
    feels: bool = False

    @classmethod
    def back(
        cls, path: Reference, time: float, v: Array, state: Any, reason: str, stopping: StoppingDistance
    ) -> PlannedStop:
        """Retreat along the path it came."""
        way = Retreat(path, time, float(stopping.duration(v)))
        return cls(way, way.end, state, reason)

    def retreat(self, time: float, v: Array, stopping: StoppingDistance) -> PlannedStop:
        """Way back from where this stop has ended, of something that is clamped."""
        way = Retreat(self.path, self.end, float(stopping.duration(v)), time - self.end)
        return replace(self, path=way, end=way.end, reason=f"{self.reason}, and clamped", feels=False)

    @classmethod
    def along(
        cls, path: Reference, time: float, v: Array, state: Any, reason: str, stopping: StoppingDistance
    ) -> PlannedStop:
        """Stop on a path that is followed with velocities v (r,)."""
        seconds = float(stopping.duration(v))
        return cls(StoppedReference(path, time, seconds), time + seconds, state, reason)

    @classmethod
    def ahead(cls, p: Array, time: float, v: Array, state: Any, reason: str, stopping: StoppingDistance) -> PlannedStop:
        """Stop straight on from measured positions and velocities (r,)."""
        return cls.along(_Straight(p, v, time), time, v, state, reason, stopping)


@dataclass(frozen=True, eq=False)
class _Straight:
    """Motion at constant velocity."""

    p: Array
    v: Array
    time: float

    def __call__(self, t: Any) -> ReferencePoint:
        passed = np.asarray(t, dtype=np.float64)[..., None] - self.time
        rest = np.zeros_like(passed * self.v)
        return ReferencePoint(self.p + passed * self.v, rest + self.v, rest)
