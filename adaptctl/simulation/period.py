"""One control period of a plant over scalars of any kind: limits, drives, motion and sensors in turn.

`Plant.step` is this on arrays; `ClosedLoop` has a controller's law before it, a vector environment's step facts after.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from adaptctl.scalars import Column, clip
from adaptctl.simulation.effects import PlantEffects
from adaptctl.simulation.effects.plant_effects import differs
from adaptctl.simulation.held_motion import HeldMotion


class PeriodOutcome(NamedTuple):
    """A control period's results in columns: first the four that are passed on to the next."""

    q: Column
    """(n,) the tree's joints"""
    v: Column
    """(r,) velocities"""
    drives: Column
    """memory of the actuator effects"""
    sensors: Column
    """memory of the sensor effects"""
    measured_p: Column
    """(r,) measured positions"""
    measured_v: Column
    """(r,) measured velocities"""
    applied: Column
    """(r,) N m (N), the torques that reached the joints"""
    clipped: Column
    """(1,) 1 where the torque commanded was beyond the plant's limits, else 0"""
    marks: Column
    """(m,) 1 for each of `Plant.marks` that held a torque back, else 0"""


@dataclass(frozen=True, eq=False)
class ControlPeriod:
    """A control period of `length` s: torques are clipped to `limits` (r,), pass the drives, move the mechanism, and
    `primary` picks the joints that are measured among the tree's."""

    motion: HeldMotion
    effects: PlantEffects
    limits: tuple[float, ...]
    primary: tuple[int, ...]
    length: float

    def __call__(self, columns: Mapping[str, Column]) -> PeriodOutcome:
        """The outcome, from the columns q (n,), v (r,), drives, sensors, torque (r,), noise (2r,), which may be empty
        without sensors, and parameters (P,); others are left alone."""
        q, v, torque = columns["q"], columns["v"], columns["torque"]
        applied = limited = self.limited(torque)
        drives, marks = columns["drives"], Column(())
        if self.effects.actuators:
            driven, drives, marks = self.effects.driven(limited, drives, self.length)
            applied = self.limited(driven)
        q, v = self.motion(q, v, applied, columns["parameters"])
        p = Column(q[i] for i in self.primary)
        measured = self.effects.measured(p, v, columns["noise"], columns["sensors"], self.length)
        clipped = Column((differs(torque, limited),))
        return PeriodOutcome(q, v, drives, measured[2], *measured[:2], applied, clipped, marks)

    def limited(self, torque: Column) -> Column:
        """The torque (r,) clipped to the limits."""
        return Column(clip(x, -bound, bound) for x, bound in zip(torque, self.limits, strict=True))
