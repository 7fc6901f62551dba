"""Base classes of effects: ways in which a plant is not ideal."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, numbers, per_joint, positive_number
from adaptctl.errors import InputError
from adaptctl.scalars import Column


class Effect(ABC):
    """Abstract base class of plant effects, which are what real plants have besides rigid links and ideal drives, such
    as delays or friction. A subclass is a frozen dataclass of its own settings. Derive from `ActuatorEffect`,
    `SensorEffect`, `JointEffect` or `LoadEffect`: a plant refuses all others but `ElasticJoints`. Each gives
    `require(dof, links, control_period)`, which raises `InputError` where its settings do not fit a plant.

    Equations are written over scalars of any kind: floats, or symbols that become native code. What changes over time
    is an effect's internal state, one `Column` (vector) of h numbers, which is passed in and returned.
    """

    @abstractmethod
    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` where the effect does not fit a plant: not its `dof` (r) joints, its `links` (names of
        those with ten inertial parameters each, in their order) or its `control_period` (s). Raise `NotFoundError`, a
        subclass of it, for a link that is not among `links`."""


class ActuatorEffect(Effect):
    """Abstract base class of actuator effects, which change torques on their way from the controller to the joints,
    such as a delay. Nothing is checked at construction, unless by a subclass.

    A subclass, a frozen dataclass of its own settings, gives, for a plant of r = `dof` joints, with torques in N m (N
    if prismatic) and the `control_period` in s:

    `rank`, an integer, its position in the order in which torques pass the effects, lower ones first; `require(dof,
    links, control_period)`, which raises `InputError` where its settings do not fit the plant, `links` being the names
    of the links with ten inertial parameters each; `start(torque, control_period)`, which returns its initial internal
    state (..., h), h >= 0 numbers of its own, for joints that were held by the array `torque` (..., r); and
    `act(torque, memory, control_period)`, which returns the torque (r,) passed on and the next internal state (h,). In
    `act` the vectors are Columns of scalars of any kind, floats or symbols that become native code, on whose values it
    must not branch. It may give `flag`, the name under which a rollout flags the control periods in which the effect
    passed on another torque than it was given, None (the default) for no flag.
    """

    rank: ClassVar[int]
    flag: ClassVar[str | None] = None

    @abstractmethod
    def initial_state(self, torque: Array, control_period: float) -> Array:
        """The initial internal state (..., h), h numbers of the effect's own, after the r joints were held by `torque`
        (..., r), N m (N for a prismatic joint); `control_period` is in s. Nothing is checked here."""

    @abstractmethod
    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The torque (r,) passed on to r joints over one control period (s), and the effect's internal state (h,) after
        it, h numbers of its own. `torque` (r,) comes from the controller or the effect before, `memory` (h,) is the
        internal state after the last period. Torques are in N m (N for a prismatic joint). Vectors are Columns of
        scalars of any kind: floats, or symbols that become native code. An implementation may raise `InputError` for
        settings that do not fit r joints, `ValueError` for an internal state of another length."""


class SensorEffect(Effect):
    """Abstract base class of sensor effects, which change positions and velocities on their way from the joints to the
    controller, such as encoders. Nothing is checked at construction, unless by a subclass.

    A subclass, a frozen dataclass of its own settings, gives, for a plant of r = `dof` joints, with the
    `control_period` in s:

    `rank`, an integer, its position in the order in which measurements pass the effects, lower ones first;
    `require(dof, links, control_period)`, which raises `InputError` where its settings do not fit the plant, `links`
    being the names of the links with ten inertial parameters each; `start(p, v, control_period)`, which returns its
    initial internal state (..., h), h >= 0 numbers of its own, for arrays of positions p and velocities v (..., r); and
    `measure(p, v, noise, memory, control_period)`, which returns the measured positions and velocities (r,) and the
    next internal state (h,), from p and v (r,), the true ones or as measured by the effects before, `noise` (2r,),
    standard normal numbers drawn for this measurement, the positions' first, the same for all sensor effects, and
    `memory` (h,).

    Positions are in rad (m if prismatic), velocities in rad/s (m/s). In `measure` the vectors are Columns of scalars of
    any kind, floats or symbols that become native code, on whose values it must not branch.
    """

    rank: ClassVar[int]

    @abstractmethod
    def initial_state(self, p: Array, v: Array, control_period: float) -> Array:
        """The initial internal state (..., h) of the effect, h numbers of its own, before the first measurement of arms
        of r joints: at positions p (..., r), rad (m if prismatic), and velocities v (..., r), rad/s (m/s).
        `control_period` is in s. Nothing is checked here."""

    @abstractmethod
    def measure(
        self, p: Column, v: Column, noise: Column, memory: Column, control_period: float
    ) -> tuple[Column, Column, Column]:
        """The measured positions (r,) of r joints, rad or m, their measured velocities (r,), rad/s or m/s, and the
        effect's internal state (h,) after them, h numbers of its own. Vectors are Columns of scalars of any kind:
        floats, or symbols that become native code.

        `p` and `v` (r,), in the same units, are the true positions and velocities, or as measured by the effects
        before; `memory` (h,) is the internal state before this measurement, and `noise` (2r,) holds standard normal
        numbers (unitless), the positions' first; `control_period` is in s. An implementation may raise `InputError` for
        settings that do not fit r joints, `ValueError` for columns of other lengths.
        """


class JointEffect(Effect):
    """Abstract base class of joint effects, which are torques in the joints that resist their motion and dissipate
    energy, such as friction; they depend on the joints' velocities alone. Nothing is checked at construction, unless by
    a subclass.

    A subclass, a frozen dataclass of its own settings, gives, for a plant of r = `dof` joints, `require(dof, links,
    control_period)`, which raises `InputError` where its settings do not fit the plant (`links` are names of links,
    `control_period` is in s); `torque(v)`, the resisting torque (r,), N m (N if prismatic), at velocities v (r,), rad/s
    (m/s), of their sign, both Columns of scalars of any kind, floats or symbols that become native code; and
    `steepest(dof)`, an array (r,), its greatest slope over velocity, N m s/rad (N s/m).
    """

    @abstractmethod
    def torque(self, v: Column) -> Column:
        """The resisting torque (r,), N m (N for a prismatic joint), at joint velocities v (r,), rad/s (m/s), of r
        joints. It has the sign of v: in the equations of motion it is subtracted from the drives' torque. Both are
        Columns, vectors of scalars of any kind: floats, or symbols that become native code. An implementation may
        raise `InputError` for settings that do not fit r joints."""

    @abstractmethod
    def max_slope(self, dof: int) -> Array:
        """The greatest slope (r,) of each joint's resisting torque over its velocity, N m s/rad (N s/m for a prismatic
        joint), for `dof` (r) joints: how stiff the effect is for an integrator. An implementation may raise
        `InputError` for settings that do not fit r joints."""


class LoadEffect(Effect):
    """Abstract base class of load effects, which change the mechanism's inertial parameters in mid-motion, such as a
    payload that is picked up. Nothing is checked at construction, unless by a subclass.

    A subclass, a frozen dataclass of its own settings, gives `require(dof, links, control_period)`, which raises
    `InputError` where its settings do not fit a plant of `dof` joints (`links` are the names of those with ten inertial
    parameters each, `control_period` is in s); `mass(time)`, the mass that it adds at a time (s), kg; and
    `loaded(parameters, links, time)`, the P inertial and friction parameters (..., P), SI units, with the load, ten for
    each of `links` first, from those without it. It may override `until(time)`, the time (s) until which the load stays
    as it is; the base class returns `time`, as for a load that changes continuously.
    """

    @abstractmethod
    def mass(self, time: float) -> float:
        """The mass, kg, that the effect adds to the mechanism at `time` (s), 0 while it adds none. Nothing is
        raised."""

    def next_change_time(self, time: float) -> float:
        """The time (s) until which the load stays as it is at `time` (s). This base class returns `time` itself, as for
        a load that changes continuously; a subclass whose load stays constant returns a later one, infinity if it never
        changes again. Nothing is raised."""
        return time

    @abstractmethod
    def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
        """The mechanism's P inertial and friction parameters (..., P) with the load at `time` (s) added to `parameters`
        (..., P), those without it, which are left as they are; where nothing is added they may be returned themselves.
        The first are ten for each of the `links`, named in their order: m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz,
        I_yz, I_zz (mass, first moments of mass, inertia tensor), in kg, kg m, kg m^2 about the origin of the link's
        frame; the drives' (rotor inertias and friction) follow, SI units. An implementation may raise `NotFoundError`
        for a link that is not among `links`, `InputError` for too few parameters."""


def at_least_zero(values: ArrayLike, dof: int, what: str) -> Array:
    """Numbers (r,) of at least zero, one for each of `dof` (r) joints: a read-only float64 copy of `values`, one number
    for all joints or (r,), in their unit. Infinity is allowed. `what` is the name of the values in errors. Raises
    `InputError` where `values` are not real numbers, have another shape, or hold a negative number or NaN."""
    given = numbers(values, what)
    if not np.all(given >= 0.0):
        raise InputError(f"{what}: expected numbers of at least 0, got {given.tolist()}")
    return per_joint(given, dof, what)


def validate_positive(value: float, what: str, unit: str) -> None:
    """Raise `InputError` unless `value` is one positive finite number; texts and arrays of several numbers are refused
    too. The message has the value's name, `what`, and its `unit`."""
    positive_number(value, f"{what}: expected a positive number of {unit}")
