"""One control period of a plant over scalars of any kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import outlined
from adaptctl.description.transforms import joint_frame_parameters, with_joint_frames
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.equations import Equations
from adaptctl.errors import AdaptctlError
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.scalars import Column, Scalar, clip
from adaptctl.simulation.effects import JointEffect, PlantEffects
from adaptctl.simulation.effects.plant_effects import differs
from adaptctl.simulation.integrator import Integrator
from adaptctl.simulation.transmission import Motors, Transmission

MAX_FUNDAMENTAL_LINKS = 12
"""links up to which finding a basis pays"""


class FundamentalMotion(NamedTuple):
    """Equations of motion in base parameters, with fewer operations."""

    equations: Equations
    sums: tuple[tuple[tuple[int, float], ...], ...]

    def parameters(self, true: Column) -> Column:
        """Base parameters (m,) of full ones (P,)."""

        def total(terms: tuple[tuple[int, float], ...]) -> Scalar:
            (i, weight), *rest = terms
            return sum((w * true[j] for j, w in rest), weight * true[i])

        return Column(total(terms) if terms else 0.0 for terms in self.sums)


def fundamental_motion(mechanism: Mechanism) -> FundamentalMotion | None:
    """Equations of motion in base parameters, None without a certified basis."""
    if type(mechanism) is not Mechanism or len(mechanism.links) > MAX_FUNDAMENTAL_LINKS:
        return None
    turned = Mechanism(with_joint_frames(mechanism.description))
    try:
        model = ReducedModel(turned, fundamental_basis(essential_space(turned, as_written=True)))
    except AdaptctlError:
        return None
    matrix = np.zeros((len(turned.parameter_names), len(mechanism.parameter_names)))
    matrix[list(model.columns)] = model.regrouping @ joint_frame_parameters(mechanism.description)
    return FundamentalMotion(turned.equations, tuple(_terms(row) for row in matrix))


def _terms(row: np.ndarray) -> tuple[tuple[int, float], ...]:
    places = np.flatnonzero(np.abs(row) > 1e-14 * np.abs(row).max())
    return tuple((int(i), float(row[i])) for i in places)


HeldMotion: TypeAlias = Callable[[Column, Column, Column, Column], tuple[Column, Column]]
"""From q (n,), v (r,), torque (r,) and parameters (P,) to q and v a period later, motors (r,) appended."""

Resistance: TypeAlias = Callable[[Column], tuple[Column, Column]]
"""From velocities (r,) to torques (r,) and slopes (r,) of friction near these"""


class Bodies(NamedTuple):
    """Equations of motion for an integrator."""

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
    """Motion over one control period under a held torque."""
    dt, several = control_period / substeps, integrator.stages > 1
    fewer = fundamental_motion(mechanism) if transmission is None else None
    stateless = [effect for effect in friction if not effect.has_state]
    bodies = _rigid(mechanism.equations if fewer is None else fewer.equations, integrator, stateless, dt)
    for effect in friction:
        if effect.has_state:
            bodies = with_state(bodies, effect, mechanism.dof, 0.5 * dt)
    if transmission is not None:
        bodies = behind_springs(bodies, transmission, dt if integrator.implicit else 0.0)

    def substep(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        rates = (lambda q, v: bodies.moved(q, v, torque, parameters)[0]) if several else bodies.rates
        q, v = integrator.step(lambda q, v: bodies.moved(q, v, torque, parameters)[1], q, v, dt, rates)
        return bodies.projected(q), v

    repeated = outlined(substep) if several or substeps > 1 else substep  # which shares terms with a controller

    def advanced(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        known = parameters if fewer is None else fewer.parameters(parameters)
        for _ in range(substeps):
            q, v = repeated(q, v, torque, known)
        return q, v

    return advanced


def _rigid(equations: Equations, integrator: Integrator, friction: Sequence[JointEffect], dt: float) -> Bodies:
    def explicit(q: Column, v: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        return equations.joint_velocities(q, v), equations.forward_dynamics(q, v, torque, parameters)

    shared = outlined(explicit) if integrator.stages > 1 else explicit

    def moved(q: Column, v: Column, torque: Column, parameters: Column, *more: Resistance) -> tuple[Column, Column]:
        if not integrator.implicit:
            resisting = sum((effect.torque(v, torque) for effect in friction), Column.zeros(len(v)))
            return shared(q, v, torque - resisting, parameters)

        def resisted(speed: Column) -> tuple[Column, Column]:
            each = [effect.resistance(Column(()), speed, torque, dt) for effect in friction]
            each += [one(speed) for one in more]
            none = Column.zeros(len(v))
            return sum((fixed for fixed, _ in each), none), sum((slope for _, slope in each), none)

        return equations.joint_velocities(q, v), equations.damped_dynamics(q, v, torque, parameters, dt, resisted)

    return Bodies(equations.joint_velocities, moved, equations.nearest_closed)


def behind_springs(links: Bodies, transmission: Transmission, dt: float) -> Bodies:
    """Equations of motion of links and motors coupled by springs."""
    parted = partial(parted_at, len(transmission.primary))

    def rates(x: Column, u: Column) -> Column:
        (q, _), (v, w) = parted(x), parted(u)
        return joined(links.rates(q, v), w)

    def moved(x: Column, u: Column, torque: Column, parameters: Column) -> tuple[Column, Column]:
        (q, theta), (v, w) = parted(x), parted(u)
        springs = transmission.springs(q, v, Motors(theta, w, transmission.motors(parameters)), torque, dt)
        firm = springs.firm
        # What the springs take at v is in their torque already.
        q_rates, a = links.moved(q, v, springs.torque, transmission.links(parameters), lambda s: (-(firm * v), firm))
        return joined(q_rates, w), joined(a, springs.spin(v + dt * a))

    def projected(x: Column) -> Column:
        q, theta = parted(x)
        return joined(links.projected(q), theta)

    return Bodies(rates, moved, projected)


def with_state(links: Bodies, friction: JointEffect, r: int, half: float) -> Bodies:
    """Equations of motion of links and of an effect's state, over half an implicit step."""
    parted = partial(parted_at, r)

    def rates(x: Column, v: Column) -> Column:
        q, z = parted(x)
        return joined(links.rates(q, v), (1.0 / half) * (friction.moved_state(z, v, half) - z))

    def moved(x: Column, v: Column, torque: Column, parameters: Column, *more: Resistance) -> tuple[Column, Column]:
        q, z = parted(x)
        return links.moved(q, v, torque, parameters, lambda s: friction.resistance(z, s, torque, half), *more)

    def projected(x: Column) -> Column:
        q, z = parted(x)
        return joined(links.projected(q), z)

    return Bodies(rates, moved, projected)


def parted_at(last: int, both: Column) -> tuple[Column, Column]:
    """Column without its last entries, and these."""
    return Column(both.of[: len(both) - last]), Column(both.of[len(both) - last :])


def joined(links: Column, motors: Column) -> Column:
    """Concatenated column of links and motors."""
    return Column((*links, *motors))


class PlantState(NamedTuple):
    """
    State of a simulated robot; many robots have leading axes.

    Parameters
    ----------
    time : float
        Time in s.
    p, v : ndarray
        Positions in rad (m if prismatic) and velocities in rad/s (m/s) of the primary joints, (r,).
    q : ndarray
        Positions (n,) of the spanning tree's joints in rad (m); p itself without loops.
    measured_p, measured_v : ndarray
        Measured positions in rad (m) and velocities in rad/s (m/s), (r,); the motors' where encoders sit on these.
    applied_torque : ndarray
        Torque (r,) that reached the joints in the last period, N m (N).
    clipped : bool
        True if the commanded torque was beyond the plant's limits.
    flags : ndarray
        Numbers (f,), 1 or 0 without a unit, one for each name in `Plant.flags`.
    drives : ndarray
        Internal states (d,) of the actuator effects in SI units; with elastic joints the motors' positions and
        velocities (2r,) follow.
    sensors : ndarray
        Internal states (s,) of the sensor effects in SI units.

    Examples
    --------
    >>> plant.init(p, v).time
    0.0
    """

    time: float
    p: Array
    v: Array
    q: Array
    measured_p: Array
    measured_v: Array
    applied_torque: Array
    clipped: bool
    flags: Array
    drives: Array
    sensors: Array


class PeriodOutcome(NamedTuple):
    """Result of one control period: next state, measurements, applied torque and flags."""

    q: Column
    v: Column
    drives: Column
    sensors: Column
    measured_p: Column
    measured_v: Column
    applied_torque: Column
    clipped: Column
    flags: Column


@dataclass(frozen=True, eq=False)
class ControlPeriod:
    """Function from named Columns to the `PeriodOutcome` of a control period."""

    motion: HeldMotion
    effects: PlantEffects
    limits: tuple[float, ...]
    primary: tuple[int, ...]
    length: float

    def __call__(self, columns: Mapping[str, Column]) -> PeriodOutcome:
        """Outcome of the columns "q", "v", "drives", "sensors", "torque", "noise" and "parameters"."""
        q, v, torque = columns["q"], columns["v"], columns["torque"]
        applied = limited = self.clip_torque(torque)
        flags = Column(())
        drives, moved = parted_at(self.effects.moved_size(len(v)), columns["drives"])
        if self.effects.actuators:
            driven, drives, flags = self.effects.driven(limited, drives, self.length)
            applied = self.clip_torque(driven)
        q, v, moved = self._moved(q, v, moved, applied, columns["parameters"])
        motor_side = parted_at(len(v), Column(moved.of[-2 * len(v) :])) if self.effects.senses_motors else None
        p = Column(q[i] for i in self.primary)
        measured = self.effects.measured(*(motor_side or (p, v)), columns["noise"], columns["sensors"], self.length)
        drives = joined(drives, moved)
        clipped = Column((differs(torque, limited),))
        return PeriodOutcome(q, v, drives, measured[2], *measured[:2], applied, clipped, flags)

    def _moved(
        self, q: Column, v: Column, moved: Column, torque: Column, parameters: Column
    ) -> tuple[Column, Column, Column]:
        """The next q and v, and the next deflections of bristles, positions and velocities of motors, as far as any."""
        z, w = parted_at(len(v) if self.effects.elastic is not None else 0, moved)
        x, u = self.motion(joined(q, z), joined(v, w), torque, parameters)
        (q, z), (v, w) = parted_at(len(z), x), parted_at(len(w), u)
        return q, v, joined(z, w)

    def clip_torque(self, torque: Column) -> Column:
        """Torque (r,) clipped to the limits."""
        return Column(clip(x, -bound, bound) for x, bound in zip(torque, self.limits, strict=True))
