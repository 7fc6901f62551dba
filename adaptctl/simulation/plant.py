"""The physical arm: equations of motion under a torque held over each control period, and what real arms add."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import KW_ONLY, dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, checked, positive_number, same_samples, stacked, vectors, whole_number
from adaptctl.caching import cached_property
from adaptctl.compilation.kernel import native_or_floats
from adaptctl.control.gains.gains import torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NonFiniteError, validate_kind
from adaptctl.scalars import Column, Scalar, Structure, Tunable, column
from adaptctl.simulation.effects import Effect, LoadEffect, PlantEffects
from adaptctl.simulation.effects.plant_effects import listed
from adaptctl.simulation.integrator import Integrator, RungeKutta4, validate_integrator, validate_substeps
from adaptctl.simulation.period import ControlPeriod, PlantState, held_motion
from adaptctl.simulation.transmission import Motors, Transmission

_DOUBLE = np.dtype(np.float64)

MOST_SUBSTEPS = 1_000_000
"""steps of the integrator in one control period"""


@dataclass(frozen=True, eq=False)
class Plant(Tunable):
    """Simulated arm: r primary (independent) joints of a `mechanism`, driven by torques, N m (N if prismatic), each
    held over a control period.

    `control_period` (s) is integrated in `substeps` equal steps of the `integrator`; `torque_limits`, N m (N), one
    number or one a joint (r,), bound the torques' magnitudes, infinity meaning no bound, None the mechanism's effort
    limits. `effects`, in any order, none by default, are what real arms have besides rigid links and drives: delays and
    limits of torques, friction and springs in the joints, sensors, and loads. Joints have no stops.

    Parameters are an argument of `step`, so one plant serves an arm with any payload; so is sensors' noise: equal calls
    give equal bits. Up to 100 links run as native code, more in Python. Raises `InputError` for a period not positive
    and finite, limits not positive, `substeps` not a whole number from 1 to 1000000 or too few for elastic joints, no
    integrator, links without mass that move none with mass, and effects that do not fit.
    """

    mechanism: Mechanism
    control_period: float
    substeps: int = 1
    integrator: Integrator = RungeKutta4()  # noqa: RUF009  # frozen
    torque_limits: ArrayLike | None = None
    _: KW_ONLY
    effects: Iterable[Effect] = ()

    def __post_init__(self) -> None:
        validate_kind(self.mechanism, Mechanism, "plant", "as load(...) gives one")
        period = positive_number(self.control_period, "control_period: expected a positive time in s")
        object.__setattr__(self, "control_period", period)
        whole_number(self.substeps, "substeps", 1, MOST_SUBSTEPS)
        validate_integrator(self.integrator)
        self.mechanism.validate_mass()
        object.__setattr__(self, "torque_limits", torque_limits(self.mechanism, self.torque_limits))
        object.__setattr__(self, "effects", listed(self.effects))
        self._effects.validate(self.dof, self._links, self.control_period)
        if self.loads:
            validate_ten_a_link(self.mechanism)
        if self._transmission is not None and not self.integrator.implicit:
            validate_substeps(self.mechanism, self._transmission, self.control_period, self.substeps)

    @property
    def dof(self) -> int:
        """Number r of the mechanism's primary (independent) joints; of a tree, without loops, all its joints."""
        return self.mechanism.dof

    @cached_property
    def loads(self) -> tuple[LoadEffect, ...]:
        """The effects that change the inertial parameters in mid-motion, such as `PayloadHeld`, in the order given."""
        return self._effects.loads

    @property
    def flags(self) -> tuple[str, ...]:
        """Names of the flags, such as "torque_limited", that actuator effects set in periods in which they act."""
        return self._effects.flags

    @cached_property
    def noise_size(self) -> int:
        """Number of standard normal numbers that sensors of r joints take a control period: 2r, positions' first, or 0
        without sensor effects and without encoders on motors of elastic joints."""
        return 2 * self.dof if self._effects.sensors or self._effects.senses_motors else 0

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Lengths of the columns (vectors) passed from one control period to the next, by name: "q", the n joints of
        the spanning tree; "v", the r primary (independent) ones; "drives", the actuator effects' internal states and,
        with elastic joints, 2r numbers of the motors; "sensors", the sensor effects'."""
        still, period = np.zeros(self.dof), self.control_period
        memories = self._effects.drive_memory(still, period), self._effects.sensor_memory(still, still, period)
        joints, motors = {"q": self.mechanism.equations.joints, "v": self.dof}, 2 * self.dof if self.is_elastic else 0
        return joints | {"drives": len(memories[0]) + motors, "sensors": len(memories[1])}

    def parameters(self, own: Array, time: float) -> Array:
        """True inertial and friction parameters (..., P) at `time` (s), SI, ordered as `Mechanism.parameter_names`:
        `own` (..., P), of arms alone, plus effects' loads. Raises `InputError` for too few for a payload's link."""
        return self._effects.loaded(own, self._links, time)

    def next_change_time(self, time: float) -> float:
        """Time, s, until which the true parameters stay as at `time` (s), at least `time`; infinity for ever."""
        return min((load.next_change_time(time) for load in self.loads), default=math.inf)

    def payload(self, time: float) -> float:
        """The total mass of the effects' loads, such as payloads, at `time` (s), kg; 0 without loads."""
        return sum(load.mass(time) for load in self.loads)

    def init(
        self, p: ArrayLike, v: ArrayLike, parameters: ArrayLike | None = None, noise: ArrayLike | None = None
    ) -> PlantState:
        """State of one arm or many at time zero, at positions `p`, rad (m if prismatic), and velocities `v`, rad/s
        (m/s), (..., r). Its last torque holds the r joints at rest against gravity for the P true inertial and friction
        `parameters` (..., P), SI, ordered as `Mechanism.parameter_names`, None for the mechanism's own with loads; it
        stretches elastic joints' springs, whose motors move as fast as the links. `noise` (..., 2r) is the first
        measurement's, standard normal, positions' first, None for zero. Raises `SingularityError` where loops cannot be
        followed to p, `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity; parameters are used only with
        actuator effects or elastic joints, noise only with sensors."""
        p = vectors(p, self.dof, f"{self.mechanism.name}: p")
        v = vectors(v, self.dof, f"{self.mechanism.name}: v")
        shape = *same_samples(p=p, v=v), self.dof
        p, v = np.broadcast_to(p, shape).copy(), np.broadcast_to(v, shape).copy()
        q, arms = self.mechanism.configuration(p), p.shape[:-1]
        held = np.zeros_like(p)
        if self._effects.actuators or self.is_elastic:
            held = self._holding(q, self._true(0.0) if parameters is None else parameters)
        drives = self._effects.drive_memory(held, self.control_period)
        theta = p if self._transmission is None else p + held / self._transmission.stiffness
        drives = np.concatenate((drives, theta, v), axis=-1) if self.is_elastic else drives
        sensed = theta if self._effects.senses_motors else p
        sensors = self._effects.sensor_memory(sensed, v, self.control_period)
        measured = self._measured(sensed, v, self._silence if noise is None else noise, sensors)
        flags = np.zeros((*arms, len(self.flags)))
        return PlantState(0.0, p, v, q, *measured[:2], held, False, flags, drives, measured[2])

    def step(
        self,
        state: PlantState,
        torque: ArrayLike,
        parameters: ArrayLike | None = None,
        noise: ArrayLike | None = None,
    ) -> PlantState:
        """State of one arm a control period after `state`; the `torque` (r,) of r joints, N m (N), is clipped and held.
        `parameters` (P,), SI, ordered as `Mechanism.parameter_names`, are the true inertial and friction ones, None for
        the mechanism's own with loads as at the state's time. `noise` (2r,) is the sensors', standard normal,
        positions' first, None for zero, not checked. Raises `InputError` on a wrong shape and `NonFiniteError` on NaN
        or infinity in positions, velocities, torque or parameters, or in the motion."""
        true = self._true(state.time) if parameters is None else parameters
        moving = state.q, state.v, self._finite(torque), true
        if self._chained:
            kept = state.drives, state.sensors, self._silence if noise is None else noise
            q, v, applied, clipped, *chained = self._advance(*moving, *kept)
        else:
            (q, v, applied, clipped), chained = self._advance(*moving), None
        if not math.isfinite(q.dot(q) + v.dot(v)):
            self._blame(state, true)
        p = q if self._primary is None else q[self._primary]
        measured_p, measured_v, flags, drives, sensors = chained or (p, v, state.flags, state.drives, state.sensors)
        time = state.time + self.control_period
        return PlantState(time, p, v, q, measured_p, measured_v, applied, clipped > 0.0, flags, drives, sensors)

    def limited(self, torque: ArrayLike) -> Array:
        """The torque (r,) of r joints, N m (N if prismatic), clipped to plus and minus `torque_limits`. Raises
        `InputError` on a wrong shape and `NonFiniteError` on NaN or infinity."""
        return np.minimum(np.maximum(self._finite(torque), -self._limits), self._limits)

    def energy(self, state: PlantState, parameters: ArrayLike | None = None) -> float:
        """Kinetic plus potential energy of one arm, J, gravity's zero at the base's origin, with elastic joints'
        springs and motors; `parameters` (P,), SI, inertial and friction, are ordered as `Mechanism.parameter_names`,
        None for the mechanism's own with loads. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or
        infinity."""
        true = self._true(state.time) if parameters is None else parameters
        motors = (state.drives,) if self.is_elastic else ()
        ((energy,),) = self._energy(state.q, state.v, true, *motors)
        if not math.isfinite(energy):
            self._blame(state, true)
        return float(energy)

    def compile(self) -> None:
        """Compile a control period and the energy to native code now, not at their first use."""
        _ = self._advance, self._energy

    def positions(self, q: Array) -> Array:
        """Positions (..., r), rad (m), of the r primary (independent) joints among all n of the tree, q (..., n)."""
        return q if self._primary is None else q[..., self._primary]

    def is_valid_configuration(self, q: Array) -> NDArray[np.bool_]:
        """Mask (...) of configurations q (..., n), rad (m), of the tree's n joints: True where the loops' regularity is
        at least 0.05 and primary joints are within the description's bounds; True for a tree. Nothing is checked."""
        if self.mechanism.continuation is None:
            return np.ones(q.shape[:-1], dtype=np.bool_)
        inside = self.mechanism.description.within_conditions(self.positions(q))
        return np.asarray(inside & self.mechanism.continuation.is_regular(q))

    @cached_property
    def equation(self) -> ControlPeriod:
        """Equation of a control period, a `ControlPeriod`, which makes of a mapping of Columns, vectors of scalars of
        any kind (SI units), a `PeriodOutcome`: the next state, measurements and torques applied. The mapping has "q"
        (n,), the tree's n joints, "v" and "torque" (r,), of the r primary (independent) ones, "parameters" (P,),
        inertial and friction, "noise" (2r,), standard normal, empty without sensors, and the effects' internal states
        "drives" and "sensors"; a missing one raises `KeyError`."""
        settings = self.control_period, self.substeps, self.integrator
        motion = held_motion(self.mechanism, *settings, self._effects.joints, self._transmission)
        primary = tuple(self.mechanism.description.primary)
        return ControlPeriod(motion, self._effects, tuple(self._limits.tolist()), primary, self.control_period)

    def energy_equation(self, q: Column, v: Column, parameters: Column, drives: Column) -> Scalar:
        """Kinetic plus potential energy, J, with springs and motors, a scalar. Columns, vectors of scalars of any kind,
        are q (n,), rad (m), of the spanning tree's n joints, v (r,), rad/s (m/s), of the r primary (independent) ones,
        true `parameters` (P,), inertial and friction, SI, ordered as `Mechanism.parameter_names`, and `drives`, used
        for elastic joints alone, which ends in their motors' positions and velocities (2r,). Nothing is checked."""
        regressor, springs = self.mechanism.equations.energy_regressor(q, v), self._transmission
        if springs is None:
            rigid: Scalar = regressor @ parameters
            return rigid
        theta, w = (Column(drives.of[len(drives) - k * self.dof :][: self.dof]) for k in (2, 1))
        motors = Motors(theta, w, springs.motors(parameters))
        elastic: Scalar = regressor @ springs.links(parameters) + springs.energy(q, motors)
        return elastic

    def primary(self, q: Column) -> Column:
        """Positions (r,), rad (m), of the r primary (independent) joints among all n of the tree, the vector q (n,)."""
        return q if self._primary is None else Column(q[i] for i in self._primary)

    @cached_property
    def _advance(self) -> Callable[..., tuple[Any, ...]]:
        """A control period on arrays; equal plants share it."""
        return _shared(self.structure, "_advancing")

    def _advancing(self) -> Callable[..., tuple[Any, ...]]:
        """A control period on arrays; of a plant with nothing between controller and joints, the motion alone."""
        empty, chained = Column(()), self._chained

        def period(**columns: Column) -> tuple[Any, ...]:
            outcome = self.equation({"drives": empty, "sensors": empty, "noise": empty, **columns})
            after = outcome.measured_p, outcome.measured_v, outcome.flags, outcome.drives, outcome.sensors
            return outcome.q, outcome.v, outcome.applied, outcome.clipped[0], *(after if chained else ())

        moving = {name: self.sizes[name] for name in ("q", "v")} | {"torque": self.dof}
        kept = {name: self.sizes[name] for name in ("drives", "sensors")} | {"noise": self.noise_size}
        return self._native(period, "plant", moving, kept if chained else {})

    @cached_property
    def _energy(self) -> Callable[..., tuple[Array]]:
        """Energy on arrays; plants of one mechanism share it."""
        return _shared(self.structure, "_measuring")

    def _measuring(self) -> Callable[..., tuple[Array]]:
        def energy(q: Column, v: Column, parameters: Column, drives: Column = Column(())) -> tuple[Column]:  # noqa: B008
            return (Column((self.energy_equation(q, v, parameters, drives),)),)

        kept = {"drives": self.sizes["drives"]} if self.is_elastic else {}
        return self._native(energy, "energy", {name: self.sizes[name] for name in ("q", "v")}, kept)

    def _native(
        self,
        equation: Callable[..., tuple[Any, ...]],
        name: str,
        moving: Mapping[str, int],
        kept: Mapping[str, int] = MappingProxyType({}),
    ) -> Callable[..., Any]:
        """An equation on arrays of these lengths, the parameters between them; in Python where code would be long."""
        sizes = {**moving, "parameters": self.mechanism.equations.parameters, **kept}
        return native_or_floats(equation, sizes, len(self.mechanism.links), name=name).call

    def _measured(self, p: Array, v: Array, noise: ArrayLike, sensors: Array) -> tuple[Array, Array, Array]:
        """The first measurement of arms (..., r), and the sensors' memory after it."""
        if not self._effects.sensors:
            return p, v, sensors
        arms, noise = p.shape[:-1], checked(noise, self.noise_size, f"{self.mechanism.name}: noise")
        if same_samples(p=p, noise=noise) != arms:
            raise InputError(f"{self.mechanism.name}: noise: expected that of {arms} arms, got {noise.shape[:-1]}")
        given = column(p), column(v), column(noise), column(sensors)
        measured = self._effects.measured(*given, self.control_period)
        made_p, made_v, after = (stacked(part.of, arms) for part in measured)
        return made_p, made_v, after

    def _holding(self, q: Array, parameters: ArrayLike) -> Array:
        """The torques (..., r) of gravity on true parameters (..., P)."""
        known = checked(parameters, self.mechanism.equations.parameters, f"{self.mechanism.name}: parameters")
        still, true = Column.zeros(self.dof), column(known)
        torque = self.mechanism.equations.inverse_dynamics(column(q), still, still, still, true)
        return stacked(torque.of, q.shape[:-1])

    def _true(self, time: float) -> Array:
        own = self.mechanism.inertial_parameters
        return self.parameters(own, time) if self.loads else own

    @cached_property
    def _effects(self) -> PlantEffects:
        return PlantEffects.of(self.effects)

    @cached_property
    def _chained(self) -> bool:
        """True if an actuator, sensor or spring stands between controller and joints."""
        return bool(self._effects.actuators or self._effects.sensors or self.is_elastic)

    @property
    def is_elastic(self) -> bool:
        """True if the plant has elastic joints, with springs between the motors and the links; False for rigid ones."""
        return self._effects.elastic is not None

    @cached_property
    def _transmission(self) -> Transmission | None:
        """The springs of elastic joints."""
        return None if self._effects.elastic is None else Transmission.of(self.mechanism, self._effects.elastic)

    @cached_property
    def _silence(self) -> Array:
        return np.zeros(self.noise_size)

    @property
    def _links(self) -> tuple[str, ...]:
        return self.mechanism.description.body_names

    @cached_property
    def _primary(self) -> list[int] | None:
        """The primary joints among the tree's; None for a tree, where they are all."""
        return None if self.mechanism.description.loops is None else list(self.mechanism.description.primary)

    @cached_property
    def _shape(self) -> tuple[int]:
        return (self.dof,)

    @cached_property
    def _limits(self) -> Array:
        return np.asarray(self.torque_limits, dtype=np.float64)

    def _finite(self, torque: ArrayLike) -> Array:
        array = torque if isinstance(torque, np.ndarray) else self._vector(torque, "torque")
        if array.dtype is not _DOUBLE or array.shape != self._shape or not math.isfinite(array.dot(array)):
            return self._vector(array, "torque")
        return array

    def _vector(self, values: ArrayLike, what: str) -> Array:
        array = vectors(values, self.dof, f"{self.mechanism.name}: {what}")
        if array.ndim != 1:
            raise InputError(f"{self.mechanism.name}: {what}: expected shape ({self.dof},), got {array.shape}")
        return array

    def _blame(self, state: PlantState, parameters: ArrayLike) -> NoReturn:
        self._vector(state.p, "p"), self._vector(state.v, "v")
        checked(parameters, self.mechanism.equations.parameters, f"{self.mechanism.name}: parameters")
        raise NonFiniteError(
            f"{self.mechanism.name}: the motion ran away after {state.time:g} s: use a shorter control period or "
            "more substeps, weaker gains, and parameters whose mass matrix is positive definite"
        )


@lru_cache(maxsize=64)
def _shared(structure: Structure, name: str) -> Callable[..., Any]:
    """Result of a method of plants of one structure."""
    made: Callable[..., Any] = getattr(structure.of, name)()
    return made


def validate_ten_a_link(mechanism: Mechanism) -> None:
    """Raise `InputError` for a mechanism with linear relations among its inertial parameters, which are then fewer than
    ten for each link and those of its drives: the parameters with a payload would not satisfy them."""
    if len(mechanism.inertial_parameters) < len(mechanism.description.inertial_parameters):
        raise InputError(
            f"payload: {mechanism.name} has relations among its parameters, which a payload would not keep to: take "
            "the mechanism without them as the plant"
        )
