"""One control period of a plant over scalars of any kind: limits, drives, the motion under held torques, and sensors.

`Plant.step` is this on arrays; `ClosedLoop` has a controller's law before it, a vector environment's step facts after.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import outlined
from adaptctl.description.transforms import joint_frame_parameters, with_joint_frames
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.equations import Equations
from adaptctl.errors import AdaptctlError
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.scalars import Column, Scalar, absolute, clip, where
from adaptctl.simulation.effects import JointEffect, PlantEffects
from adaptctl.simulation.effects.plant_effects import differs
from adaptctl.simulation.integrator import Integrator
from adaptctl.simulation.transmission import Motors, Transmission

LONGEST = 12
"""Links of a mechanism whose basis is looked for, which takes longer than is saved for more."""


class FundamentalMotion(NamedTuple):
    """A mechanism's equations of motion in fewer operations: in its fundamental (base) parameters, and with each link's
    frame at its joint. Regrouping the P inertial parameters onto the fundamental ones leaves many of the m parameters
    of these equations zero.

    `equations` are the equations, of m parameters. `sums` has for each of the m a tuple of pairs (index, weight): the
    parameter is the sum of the mechanism's own parameters (P,), SI units, at these zero-based indices, times their
    weights; the tuple is empty where it is zero. Nothing is checked.
    """

    equations: Equations
    sums: tuple[tuple[tuple[int, float], ...], ...]

    def parameters(self, true: Column) -> Column:
        """The m parameters, a Column (vector) (m,), SI units, of a mechanism's equations of motion on its fundamental
        (base) parameters: weighted sums of its own P inertial and friction parameters `true` (P,), zero where
        regrouping leaves none. Scalars are of any kind (floats, arrays, or symbols to be compiled). Raises `IndexError`
        where `true` is too short."""

        def total(terms: tuple[tuple[int, float], ...]) -> Scalar:
            (i, weight), *rest = terms
            return sum((w * true[j] for j, w in rest), weight * true[i])

        return Column(total(terms) if terms else 0.0 for terms in self.sums)


def fundamental_motion(mechanism: Mechanism) -> FundamentalMotion | None:
    """The equations of motion of a `mechanism` on its fundamental (base) parameters, a `FundamentalMotion`, or None.
    These parameters are the combinations of inertial parameters that the motion depends on, and take fewer operations
    than all.

    None is returned for a mechanism of more than LONGEST (12) links, for a subclass of `Mechanism`, as one with
    constraints on its parameters is, and where no such basis can be certified. Nothing is raised.
    """
    if type(mechanism) is not Mechanism or len(mechanism.links) > LONGEST:
        return None
    turned = Mechanism(with_joint_frames(mechanism.description))
    try:
        model = ReducedModel(turned, fundamental_basis(essential_space(turned, near_singular="as_is")))
    except AdaptctlError:
        return None
    matrix = np.zeros((len(turned.parameter_names), len(mechanism.parameter_names)))
    matrix[list(model.columns)] = model.regrouping @ joint_frame_parameters(mechanism.description)
    return FundamentalMotion(turned.equations, tuple(_terms(row) for row in matrix))


def _terms(row: np.ndarray) -> tuple[tuple[int, float], ...]:
    places = np.flatnonzero(np.abs(row) > 1e-14 * np.abs(row).max())
    return tuple((int(i), float(row[i])) for i in places)


HeldMotion: TypeAlias = Callable[[Column, Column, Column, Column], tuple[Column, Column]]
"""From q (n,), v (r,), torque (r,) and parameters (P,) to the q and v a control period later; behind springs q has the
motors' positions (r,) at its end, and v their velocities."""

STILL = 1e-9
"""rad/s (m/s): at smaller speeds the secant of friction is its slope at rest"""


class Bodies(NamedTuple):
    """Equations of motion of a mechanism under a torque, as an integrator takes them: three functions over Columns,
    vectors of scalars of any kind (floats, arrays, or symbols to be compiled), `rates(q, v)`, `moved(q, v, torque,
    parameters)` and `projected(q)`. Nothing is checked.

    Their columns are q (n,), rad (m if prismatic), positions of the spanning tree's n joints, and v (r,), rad/s (m/s),
    velocities of the r primary (independent) joints; with elastic joints each is followed by the motors' (r,). A prime
    is a time derivative. `rates` gives q' (n,), rad/s (m/s), from q and v. `moved` gives q' and the accelerations v'
    (r,), rad/s^2 (m/s^2), from q, v, the torque (r,), N m (N), and the P inertial and friction parameters (P,), SI
    units, in the order of `Mechanism.parameter_names`. Where it is for the links alone and an implicit integrator, it
    may be given one more column (r,), N m s/rad (N s/m), the decrease of the torque for every rad/s (m/s) that v gains
    in the step. `projected` gives from q a configuration whose loops are closed more exactly, q itself for a tree.
    """

    rates: Callable[[Column, Column], Column]
    moved: Callable[..., tuple[Column, Column]]
    projected: Callable[[Column], Column]


def held_motion(
    mechanism: Mechanism,
    control_period: float,
    substeps: int,
    integrator: Integrator,
    friction: Sequence[JointEffect] = (),
    transmission: Transmission | None = None,
) -> HeldMotion:
    """The motion of a `mechanism` over one `control_period` (s) under a held torque, a function (q, v, torque,
    parameters) that returns q and v at the period's end. Its arguments are columns (n,), (r,), (r,) and (P,), vectors
    of scalars of any kind (floats, arrays, or symbols to be compiled).

    q, rad (m if prismatic), are positions of all n joints of the spanning tree, v, rad/s (m/s), velocities of the r
    primary (independent) joints, the torque is in N m (N), the inertial and friction parameters are in SI units, in the
    order of `Mechanism.parameter_names`. The period is integrated by `integrator` in `substeps` equal steps. `friction`
    are effects that brake the joints, none by default; `transmission` has the springs of elastic joints, None for rigid
    ones: with it q is (n + r,), the joints' positions and then the motors', and v is (2r,), the joints' velocities and
    then the motors'. Kinematic loops are closed again in every step. Nothing is checked here.
    """
    dt, several = control_period / substeps, integrator.stages > 1
    fewer = fundamental_motion(mechanism) if transmission is None else None
    bodies = _rigid(mechanism.equations if fewer is None else fewer.equations, integrator, friction, dt)
    if transmission is not None:
        bodies = behind_springs(bodies, transmission, dt if integrator.implicit else 0.0)

    def substep(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        rates = (lambda q, v: bodies.moved(q, v, torque, parameters)[0]) if several else bodies.rates
        q, v = integrator.step(lambda q, v: bodies.moved(q, v, torque, parameters)[1], q, v, dt, rates)
        return bodies.projected(q), v

    repeated = outlined(substep) if substeps > 1 else substep

    def advanced(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        known = parameters if fewer is None else fewer.parameters(parameters)
        for _ in range(substeps):
            q, v = repeated(q, v, torque, known)
        return q, v

    return advanced


def _rigid(equations: Equations, integrator: Integrator, friction: Sequence[JointEffect], dt: float) -> Bodies:
    """The links, with what brakes the joints."""

    def explicit(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        """Rates of the configuration and of the velocities: together, for loops need their Jacobian for both."""
        return equations.rates(q, v), equations.forward_dynamics(q, v, torque, parameters)

    shared = outlined(explicit) if integrator.stages > 1 else explicit

    def moved(q: Column, v: Column, torque: Column, parameters: Column, *firm: Column) -> tuple[Column, Column]:
        braked = torque
        for effect in friction:
            braked = braked - effect.torque(v)
        if not integrator.implicit:
            return shared(q, v, braked, parameters)
        secants = [*([_secants(friction, v)] if friction else []), *firm]
        more = tuple(sum(secants[1:], secants[0])) if secants else ()
        return equations.rates(q, v), equations.damped_dynamics(q, v, braked, parameters, dt, more)

    return Bodies(equations.rates, moved, equations.projected)


def behind_springs(links: Bodies, transmission: Transmission, dt: float) -> Bodies:
    """The equations of motion, a `Bodies`, of links and motors together, from `links`, those of the links alone, and
    the springs between them, `transmission`. Their configuration is the n positions of the spanning tree's joints, rad
    (m if prismatic), then the r of the motors; their velocities are those of the r primary (independent) joints, rad/s
    (m/s), then the motors'. `dt` (s) is the step of an implicit integrator, whose springs' torque is taken at its end,
    and 0 for an explicit one. Nothing is checked."""
    r = len(transmission.primary)

    def parted(both: Column) -> tuple[Column, Column]:
        return Column(both.of[:-r]), Column(both.of[-r:])

    def rates(x: Column, u: Column) -> Column:
        (q, _), (v, w) = parted(x), parted(u)
        return joined(links.rates(q, v), w)

    def moved(x: Column, u: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        (q, theta), (v, w) = parted(x), parted(u)
        springs = transmission.springs(q, v, Motors(theta, w, transmission.motors(parameters)), torque, dt)
        q_rates, a = links.moved(q, v, springs.torque, transmission.links(parameters), springs.firm)
        return joined(q_rates, w), joined(a, springs.spin(v + dt * a))

    def projected(x: Column) -> Column:
        q, theta = parted(x)
        return joined(links.projected(q), theta)

    return Bodies(rates, moved, projected)


def joined(links: Column, motors: Column) -> Column:
    """The concatenated column (vector) (a + b,) of the a numbers of `links` (a,), such as positions, and the b of
    `motors` (b,), in the units that they have. Nothing is checked."""
    return Column((*links, *motors))


def _secants(friction: Sequence[JointEffect], v: Column) -> Column:
    """Friction of the effects over velocity (r,), N m s/rad."""
    total = sum((effect.torque(v) for effect in friction), Column.zeros(len(v)))
    steepest = np.sum([effect.max_slope(len(v)) for effect in friction], axis=0)
    moving = [absolute(x) > STILL for x in v]
    speeds = (where(moves, x, 1.0) for moves, x in zip(moving, v, strict=True))
    pairs = zip(moving, total, speeds, steepest.tolist(), strict=True)
    return Column(where(moves, torque / speed, slope) for moves, torque, speed, slope in pairs)


class PlantState(NamedTuple):
    """State of an arm of r primary (independent) joints at one `time` (s), what was measured of it, and the internal
    states of its drives' and sensors' effects; for many arms, arrays have leading axes. Nothing is checked.

    Positions `p` (r,) of the primary joints and `q` (n,) of all n joints of the spanning tree (p itself without loops),
    rad (m if prismatic); velocities `v` (r,), rad/s (m/s); `measured_p` and `measured_v` (r,), in the same units: the
    true ones if there are no sensors, the motors' where encoders sit on these.

    Of the last control period: `applied` (r,), N m (N), the torques that reached the joints, at time zero those that
    held them if there are actuator effects or springs, else 0; `clipped`, True if the torque commanded was beyond the
    plant's limits; `flags` (h,), one for each of the h effects named in `Plant.flags`, 1 if it changed a torque, else
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
    flags: Array
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
    beyond the plant's limits, else 0; `flags` (h,), named in `Plant.flags`, are 1 where that actuator effect changed a
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
    flags: Column


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
        drives, flags, springs = columns["drives"], Column(()), 2 * len(v) if self.effects.elastic is not None else 0
        drives, motors = Column(drives.of[: len(drives) - springs]), Column(drives.of[len(drives) - springs :])
        if self.effects.actuators:
            driven, drives, flags = self.effects.driven(limited, drives, self.length)
            applied = self.limited(driven)
        q, v, motors = self._moved(q, v, motors, applied, columns["parameters"])
        motor_side = (Column(motors.of[: len(v)]), Column(motors.of[len(v) :])) if self.effects.senses_motors else None
        p = Column(q[i] for i in self.primary)
        measured = self.effects.measured(*(motor_side or (p, v)), columns["noise"], columns["sensors"], self.length)
        drives = joined(drives, motors)
        clipped = Column((differs(torque, limited),))
        return PeriodOutcome(q, v, drives, measured[2], *measured[:2], applied, clipped, flags)

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
