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
from adaptctl.simulation.held_motion import HeldMotion, joined


class PeriodOutcome(NamedTuple):
    """Outcome of a control period in columns: first the four that are passed on to the next."""

    q: Column
    """(n,) the tree's joints"""
    v: Column
    """(r,) velocities"""
    drives: Column
    """memory of the actuator effects, then the motors' positions and velocities behind springs"""
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
        drives, marks, springs = columns["drives"], Column(()), 2 * len(v) if self.effects.elastic is not None else 0
        drives, motors = Column(drives.of[: len(drives) - springs]), Column(drives.of[len(drives) - springs :])
        if self.effects.actuators:
            driven, drives, marks = self.effects.driven(limited, drives, self.length)
            applied = self.limited(driven)
        q, v, motors = self._moved(q, v, motors, applied, columns["parameters"])
        motor_side = (Column(motors.of[: len(v)]), Column(motors.of[len(v) :])) if self.effects.senses_motors else None
        p = Column(q[i] for i in self.primary)
        measured = self.effects.measured(*(motor_side or (p, v)), columns["noise"], columns["sensors"], self.length)
        drives = joined(drives, motors)
        clipped = Column((differs(torque, limited),))
        return PeriodOutcome(q, v, drives, measured[2], *measured[:2], applied, clipped, marks)

    def _moved(
        self, q: Column, v: Column, motors: Column, torque: Column, parameters: Column
    ) -> tuple[Column, Column, Column]:
        """The joints, and the motors behind springs (2r,), at the end."""
        if self.effects.elastic is None:
            return *self.motion(q, v, torque, parameters), motors
        n, r = len(q), len(v)
        x, u = self.motion(joined(q, Column(motors.of[:r])), joined(v, Column(motors.of[r:])), torque, parameters)
        return Column(x.of[:n]), Column(u.of[:r]), joined(Column(x.of[n:]), Column(u.of[r:]))

    def limited(self, torque: Column) -> Column:
        """The torque (r,) N m clipped to the limits."""
        return Column(clip(x, -bound, bound) for x, bound in zip(torque, self.limits, strict=True))
