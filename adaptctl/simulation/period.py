"""One control period of a plant over scalars of any kind: limits, drives, motion and sensors in turn.

`Plant.step` is this on arrays; `ClosedLoop` has a controller's law before it, a vector environment's step facts after.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from adaptctl.arrays import Array
from adaptctl.scalars import Column, clip
from adaptctl.simulation.effects import PlantEffects
from adaptctl.simulation.effects.plant_effects import differs
from adaptctl.simulation.held_motion import HeldMotion, joined


class PlantState(NamedTuple):
    """State of an arm of r primary (independent) joints at one `time` (s), what was measured of it, and the internal
    states of its drives' and sensors' effects; for many arms, arrays have leading axes. Nothing is checked.

    Positions `p` (r,) of the primary joints and `q` (n,) of all n joints of the spanning tree (p itself without loops),
    rad (m if prismatic); velocities `v` (r,), rad/s (m/s); `measured_p` and `measured_v` (r,), in the same units: the
    true ones if there are no sensors, the motors' where encoders sit on these.

    Of the last control period: `applied` (r,), N m (N), the torques that reached the joints, at time zero those that
    held them if there are actuator effects or springs, else 0; `clipped`, True if the torque commanded was beyond the
    plant's limits; `marks` (h,), one for each of the h effects named in `Plant.marks`, 1 if it changed a torque, else
    0.

    `drives` (d,) are the internal states of the actuator effects, one after the other, followed, with `ElasticJoints`,
    by the motors' positions (r,), rad (m), and velocities (r,), rad/s (m/s); `sensors` (s,) are those of the sensor
    effects. The lengths d and s are in `Plant.sizes`.
    """

    time: float
    p: Array
    v: Array
    q: Array
    measured_p: Array
    measured_v: Array
    applied: Array
    clipped: bool
    marks: Array
    drives: Array
    sensors: Array


class PeriodOutcome(NamedTuple):
    """The outcome of one control period of a plant, as Columns, vectors of scalars of any kind (floats, arrays, or
    symbols to be compiled); the first four are passed on to the next period. Nothing is checked.

    `q` (n,), rad (m if prismatic), are positions of all n joints of the spanning tree, and `v` (r,), rad/s (m/s),
    velocities of the r primary (independent) joints, at the period's end. `drives` (d,) is the internal state of the
    actuator effects, followed, with elastic joints, by the motors' positions (r,) and velocities (r,); `sensors` (s,)
    is that of the sensor effects. `measured_p` and `measured_v` (r,) are what the sensors measure at the end, in rad
    (m) and rad/s (m/s). `applied` (r,), N m (N), reached the joints; `clipped` (1,) is 1 where the torque commanded was
    beyond the plant's limits, else 0; `marks` (h,), named in `Plant.marks`, are 1 where that actuator effect changed a
    torque, else 0.
    """

    q: Column
    v: Column
    drives: Column
    sensors: Column
    measured_p: Column
    measured_v: Column
    applied: Column
    clipped: Column
    marks: Column


@dataclass(frozen=True, eq=False)
class ControlPeriod:
    """One control period of a plant, a function from a mapping of named Columns, vectors of scalars of any kind
    (floats, arrays, or symbols to be compiled), to a `PeriodOutcome`: the state after it and what was measured and
    applied. Torques are clipped to the limits, pass the actuator effects and move the mechanism, whose joints are then
    measured.

    The mapping has "q" (n,), rad (m if prismatic), "v" (r,), rad/s (m/s), "torque" (r,), N m (N), "parameters" (P,),
    the inertial ones in SI units, in the order of `Mechanism.parameter_names`, "noise" (2r,), standard normal numbers,
    the positions' first, empty without sensors, and the internal states "drives", of the actuator effects, followed by
    positions (r,) and velocities (r,) of the motors if joints are elastic, and "sensors", of the sensor effects; a
    missing one raises `KeyError`. `motion` moves the joints over the period under a held torque; `effects` are those
    between controller and joints; `limits` (r,), N m (N), bound the torques' magnitudes; `primary` are the indices,
    from 0, of the r primary (independent) joints among the spanning tree's n; `length` is the period's, s. Nothing is
    checked at construction.
    """

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
        """The torque (r,) of r joints, N m (N if prismatic), clipped to plus and minus the period's `limits`, a
        `Column`, which is a vector of scalars of any kind (floats, arrays, or symbols to be compiled). Raises
        `ValueError` for another number of joints."""
        return Column(clip(x, -bound, bound) for x, bound in zip(torque, self.limits, strict=True))
