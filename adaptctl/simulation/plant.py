"""The simulated plant."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import KW_ONLY, dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, checked, positive_period, same_samples, stacked, vectors, whole_number
from adaptctl.caching import cached_property
from adaptctl.compilation.kernel import native_or_floats
from adaptctl.control.gains.gains import torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NonFiniteError, validate_kind
from adaptctl.scalars import Column, Scalar, Structure, Tunable, column
from adaptctl.simulation.effects import Effect, LoadEffect, PlantEffects
from adaptctl.simulation.effects.plant_effects import listed
from adaptctl.simulation.integrator import Integrator, RungeKutta4, validate_explicit, validate_integrator
from adaptctl.simulation.period import ControlPeriod, PlantState, held_motion
from adaptctl.simulation.transmission import Motors, Transmission

_DOUBLE = np.dtype(np.float64)

MAX_SUBSTEPS = 1_000_000
"""integration steps per control period"""


@dataclass(frozen=True, eq=False)
class Plant(Tunable):
    """
    Simulated robot under torques held over each control period.

    Parameters
    ----------
    mechanism : Mechanism
        Robot with r primary (independent) joints. Joints have no stops.
    control_period : float
        Time in s for which a torque is held.
    substeps : int, default 1
        Equal integration steps per control period, 1 to 1000000; stiff friction and elastic joints need more.
    integrator : Integrator, default RungeKutta4()
        Integration method. Default: Runge-Kutta of fourth order, for motions without stiff friction.
    torque_limits : array_like, optional
        Largest magnitudes of the torques, N m (N if prismatic): one number or (r,), infinity for no bound. Default: the
        mechanism's effort limits.
    effects : iterable of Effect, default ()
        Delays and limits of torques, friction and springs in the joints, sensors and loads, in any order. Default: an
        ideal robot.

    Raises
    ------
    InputError
        If the period is not positive and finite, a limit is not positive, `substeps` is out of range or too small for
        elastic joints, a massless link moves no mass, or an effect does not fit.

    Notes
    -----
    Up to 100 links run as native code, more in Python.

    Examples
    --------
    >>> plant = adaptctl.Plant(arm, 0.001)
    >>> plant
    <Plant of 'two_link': period 0.001 s, effects: none>
    >>> state = plant.init([0.3, 0.5], [0.0, 0.0])
    >>> for _ in range(10):
    ...     state = plant.step(state, [20.0, 5.0])
    >>> round(state.time, 3), state.p.shape
    (0.01, (2,))
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
        period = positive_period(self.control_period, "control_period")
        object.__setattr__(self, "control_period", period)
        whole_number(self.substeps, "substeps", 1, MAX_SUBSTEPS)
        validate_integrator(self.integrator)
        self.mechanism.validate_mass()
        object.__setattr__(self, "torque_limits", torque_limits(self.mechanism, self.torque_limits))
        given = listed(self.effects)
        placed = (e.on(self.mechanism.description) if isinstance(e, LoadEffect) else e for e in given)
        object.__setattr__(self, "effects", tuple(placed))
        self._effects.validate(self.dof, self._links, self.control_period)
        if self.loads:
            validate_ten_a_link(self.mechanism)
        if not self.integrator.implicit:
            settings = self._transmission, self.control_period, self.substeps
            validate_explicit(self.mechanism, self._effects.joints, *settings)

    def __repr__(self) -> str:
        effects = ", ".join(type(effect).__name__ for effect in self.effects) or "none"
        return f"<{type(self).__name__} of {self.mechanism.name!r}: period {self.control_period} s, effects: {effects}>"

    @property
    def dof(self) -> int:
        """Number r of primary (independent) joints."""
        return self.mechanism.dof

    @cached_property
    def loads(self) -> tuple[LoadEffect, ...]:
        """Effects that change the inertial parameters."""
        return self._effects.loads

    @property
    def flags(self) -> tuple[str, ...]:
        """Names of the actuator effects' flags, such as "torque_limited"."""
        return self._effects.flags

    @cached_property
    def noise_size(self) -> int:
        """Number of random numbers per control period: 2r, or 0 without sensor effects."""
        return 2 * self.dof if self._effects.sensors or self._effects.senses_motors else 0

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Lengths of the state columns "q", "v", "drives" and "sensors"."""
        still, period = np.zeros(self.dof), self.control_period
        memories = self._effects.drive_memory(still, period), self._effects.sensor_memory(still, still, period)
        joints = {"q": self.mechanism.equations.num_joints, "v": self.dof}
        drives = len(memories[0]) + self._effects.moved_size(self.dof)
        return joints | {"drives": drives, "sensors": len(memories[1])}

    def parameters(self, own: Array, time: float) -> Array:
        """
        Return the true parameters at a time, loads included.

        Parameters
        ----------
        own : ndarray
            Inertial and friction parameters (..., P) without loads, SI units, ordered as `Mechanism.parameter_names`.
        time : float
            Time in s.

        Returns
        -------
        ndarray
            Parameters (..., P), SI units.

        Raises
        ------
        InputError
            If there are too few parameters for a payload's link.

        Examples
        --------
        >>> from adaptctl.simulation import Plant
        >>> from adaptctl.simulation.effects import PayloadHeld
        >>> loaded = Plant(arm, period, effects=[PayloadHeld(1.0)])
        >>> loaded.parameters(arm.inertial_parameters, time=0.0).shape == arm.inertial_parameters.shape
        True
        """
        return self._effects.loaded(own, self._links, time)

    def next_change_time(self, time: float) -> float:
        """
        Return the time until which the true parameters are constant.

        Parameters
        ----------
        time : float
            Time in s.

        Returns
        -------
        float
            Time in s, at least `time`; infinity if nothing changes any more.
        """
        return min((load.next_change_time(time) for load in self.loads), default=math.inf)

    def payload_mass(self, time: float) -> float:
        """
        Return the total mass of the loads.

        Parameters
        ----------
        time : float
            Time in s.

        Returns
        -------
        float
            Mass in kg, 0 without loads.

        Examples
        --------
        >>> from adaptctl.simulation.effects import PayloadHeld
        >>> adaptctl.Plant(arm, period, effects=[PayloadHeld(0.5)]).payload_mass(0.0)
        0.5
        """
        return sum(load.mass(time) for load in self.loads)

    def init(
        self, p: ArrayLike, v: ArrayLike, parameters: ArrayLike | None = None, noise: ArrayLike | None = None
    ) -> PlantState:
        """
        Return the state of one robot or many at time zero.

        Parameters
        ----------
        p : array_like
            Positions (..., r) in rad (m if prismatic).
        v : array_like
            Velocities (..., r) in rad/s (m/s).
        parameters : array_like, optional
            True parameters (..., P), SI units, ordered as `Mechanism.parameter_names`; used with actuator effects or
            elastic joints only. Default: the mechanism's, loads included.
        noise : array_like, optional
            Standard normal numbers (..., 2r) without a unit of the first measurement, the positions' first; used with
            sensors only. Default: zero, a measurement without noise.

        Returns
        -------
        PlantState
            State whose last torque holds the joints at rest against gravity and stretches the springs of elastic
            joints.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a number is NaN or infinite.
        SingularityError
            If kinematic loops cannot be followed to p.

        Examples
        --------
        >>> plant.init(p, v).q.shape
        (2,)
        """
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
        unbent, motors = np.zeros((*arms, self._effects.friction_size(self.dof))), (theta, v) if self.is_elastic else ()
        drives = np.concatenate((drives, unbent, *motors), axis=-1)
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
        """
        Advance one robot by a control period under a held torque.

        Parameters
        ----------
        state : PlantState
            State at the beginning of the period.
        torque : array_like
            Commanded torque (r,) in N m (N if prismatic), clipped to `torque_limits`.
        parameters : array_like, optional
            True parameters (P,), SI units, ordered as `Mechanism.parameter_names`. Default: the mechanism's, with the
            loads at the state's time.
        noise : array_like, optional
            Standard normal numbers (2r,) without a unit of the sensors, the positions' first, not checked. Default:
            zero, a measurement without noise.

        Returns
        -------
        PlantState
            State at the end of the period.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If an argument or the motion is NaN or infinite.

        Examples
        --------
        >>> plant.step(plant.init(p, v), [5.0, 1.0]).applied_torque
        array([5., 1.])
        """
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

    def clip_torque(self, torque: ArrayLike) -> Array:
        """
        Clip a torque to `torque_limits`.

        Parameters
        ----------
        torque : array_like
            Torque (r,) in N m (N if prismatic).

        Returns
        -------
        ndarray
            Clipped torque (r,) in N m (N).

        Raises
        ------
        InputError
            If the shape is wrong.
        NonFiniteError
            If the torque is NaN or infinite.

        Examples
        --------
        >>> adaptctl.Plant(arm, period, torque_limits=[20.0, 5.0]).clip_torque([30.0, -1.0])
        array([20., -1.])
        """
        return np.minimum(np.maximum(self._finite(torque), -self._limits), self._limits)

    def energy(self, state: PlantState, parameters: ArrayLike | None = None) -> float:
        """
        Return the kinetic plus potential energy of one robot.

        Parameters
        ----------
        state : PlantState
            State of the robot.
        parameters : array_like, optional
            True parameters (P,), SI units, ordered as `Mechanism.parameter_names`. Default: the mechanism's, with
            loads.

        Returns
        -------
        float
            Energy in J, springs and motors of elastic joints included; gravity's zero is at the base's origin.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If the energy is NaN or infinite.

        Examples
        --------
        >>> bool(np.isfinite(plant.energy(plant.init(p, v))))
        True
        """
        true = self._true(state.time) if parameters is None else parameters
        motors = (state.drives,) if self.is_elastic else ()
        ((energy,),) = self._energy(state.q, state.v, true, *motors)
        if not math.isfinite(energy):
            self._blame(state, true)
        return float(energy)

    def compile(self) -> None:
        """Compile the code of a control period and of the energy now, instead of at first use."""
        _ = self._advance, self._energy

    def positions(self, q: Array) -> Array:
        """
        Return the positions of the primary joints, from an array of all joints.

        Parameters
        ----------
        q : ndarray
            Positions (..., n) of the tree's joints, rad (m if prismatic).

        Returns
        -------
        ndarray
            Positions (..., r) in rad (m).
        """
        return q if self._primary is None else q[..., self._primary]

    def is_valid_configuration(self, q: Array) -> NDArray[np.bool_]:
        """
        Return a mask of the configurations away from singularities and within the description's bounds.

        Parameters
        ----------
        q : ndarray
            Positions (..., n) of the spanning tree's joints, rad (m if prismatic).

        Returns
        -------
        ndarray of bool
            Mask (...), True where the loops' regularity is at least 0.05 and the bounds hold; True for a tree.
        """
        if self.mechanism.continuation is None:
            return np.ones(q.shape[:-1], dtype=np.bool_)
        inside = self.mechanism.description.within_conditions(self.positions(q))
        return np.asarray(inside & self.mechanism.continuation.is_regular(q))

    @cached_property
    def equation(self) -> ControlPeriod:
        """Function from named Columns to the `PeriodOutcome` of a control period."""
        settings = self.control_period, self.substeps, self.integrator
        motion = held_motion(self.mechanism, *settings, self._effects.joints, self._transmission)
        primary = tuple(self.mechanism.description.primary)
        return ControlPeriod(motion, self._effects, tuple(self._limits.tolist()), primary, self.control_period)

    def energy_equation(self, q: Column, v: Column, parameters: Column, drives: Column) -> Scalar:
        """
        Compute the energy from Columns of floats, arrays or graph nodes.

        Parameters
        ----------
        q : Column
            Positions (n,) of the spanning tree's joints, rad (m if prismatic).
        v : Column
            Velocities (r,) in rad/s (m/s).
        parameters : Column
            True parameters (P,), SI units.
        drives : Column
            Internal states (d,) of the drives in SI units; with elastic joints its end has the motors' positions and
            velocities (2r,).

        Returns
        -------
        Scalar
            Kinetic plus potential energy in J.

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> energy = plant.energy_equation(column(p), column(v), column(arm.inertial_parameters), column([]))
        >>> bool(np.isclose(energy, arm.energy(p, v)))
        True
        """
        regressor, springs = self.mechanism.equations.energy_regressor(q, v), self._transmission
        if springs is None:
            rigid: Scalar = regressor @ parameters
            return rigid
        theta, w = (Column(drives.of[len(drives) - k * self.dof :][: self.dof]) for k in (2, 1))
        motors = Motors(theta, w, springs.motors(parameters))
        elastic: Scalar = regressor @ springs.links(parameters) + springs.energy(q, motors)
        return elastic

    def primary(self, q: Column) -> Column:
        """
        Return the positions of the primary joints, from a Column of all joints.

        Parameters
        ----------
        q : Column
            Positions (n,) of the spanning tree's joints, rad (m if prismatic).

        Returns
        -------
        Column
            Positions (r,) in rad (m).
        """
        return q if self._primary is None else Column(q[i] for i in self._primary)

    @cached_property
    def _advance(self) -> Callable[..., tuple[Any, ...]]:
        return _shared(self.structure, "_advancing")

    def _advancing(self) -> Callable[..., tuple[Any, ...]]:
        """Control period on arrays, the motion alone without further effects."""
        empty, chained = Column(()), self._chained

        def period(**columns: Column) -> tuple[Any, ...]:
            outcome = self.equation({"drives": empty, "sensors": empty, "noise": empty, **columns})
            after = outcome.measured_p, outcome.measured_v, outcome.flags, outcome.drives, outcome.sensors
            return outcome.q, outcome.v, outcome.applied_torque, outcome.clipped[0], *(after if chained else ())

        moving = {name: self.sizes[name] for name in ("q", "v")} | {"torque": self.dof}
        kept = {name: self.sizes[name] for name in ("drives", "sensors")} | {"noise": self.noise_size}
        return self._native(period, "plant", moving, kept if chained else {})

    @cached_property
    def _energy(self) -> Callable[..., tuple[Array]]:
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
        """Compiled equation on arrays, or in Python if too long."""
        sizes = {**moving, "parameters": self.mechanism.equations.parameters, **kept}
        return native_or_floats(equation, sizes, len(self.mechanism.links), name=name).call

    def _measured(self, p: Array, v: Array, noise: ArrayLike, sensors: Array) -> tuple[Array, Array, Array]:
        if not self._effects.sensors:
            return p, v, sensors
        arms, noise = p.shape[:-1], checked(noise, self.noise_size, f"{self.mechanism.name}: noise")
        if same_samples(p=p, noise=noise) != arms:
            raise InputError(f"{self.mechanism.name}: noise: expected values for {arms} arms, got {noise.shape[:-1]}")
        given = column(p), column(v), column(noise), column(sensors)
        measured = self._effects.measured(*given, self.control_period)
        made_p, made_v, after = (stacked(part.of, arms) for part in measured)
        return made_p, made_v, after

    def _holding(self, q: Array, parameters: ArrayLike) -> Array:
        """Gravity torques (..., r)."""
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
        return bool(self._effects.actuators or self._effects.sensors or self._effects.moved_size(self.dof))

    @property
    def is_elastic(self) -> bool:
        """True if the joints are elastic."""
        return self._effects.elastic is not None

    @cached_property
    def _transmission(self) -> Transmission | None:
        return None if self._effects.elastic is None else Transmission.of(self.mechanism, self._effects.elastic)

    @cached_property
    def _silence(self) -> Array:
        return np.zeros(self.noise_size)

    @property
    def _links(self) -> tuple[str, ...]:
        return self.mechanism.description.body_names

    @cached_property
    def _primary(self) -> list[int] | None:
        """Indices of the primary joints, None for a tree."""
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
            f"{self.mechanism.name}: the motion diverged after {state.time:g} s: use a shorter control period or "
            "more substeps, smaller gains, and parameters whose mass matrix is positive definite"
        )


@lru_cache(maxsize=64)
def _shared(structure: Structure, name: str) -> Callable[..., Any]:
    made: Callable[..., Any] = getattr(structure.of, name)()
    return made


def validate_ten_a_link(mechanism: Mechanism) -> None:
    """Raise `InputError` if payloads would break relations among parameters."""
    if len(mechanism.inertial_parameters) < len(mechanism.description.inertial_parameters):
        raise InputError(
            f"payload: {mechanism.name} has relations among its parameters, which a payload would not keep to: take "
            "the mechanism without them as the plant"
        )
