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
    """Base class of the effects that real plants have besides rigid links and drives, such as delays or friction: a
    frozen dataclass of its own parameters.

    Its equations are written over scalars of any kind: floats, or symbols that become native code. What changes over
    time is its memory, one column of numbers passed in and out.
    """

    @abstractmethod
    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` where the effect does not fit `dof` (r) joints, the `links` (names of those with inertial
        parameters, in their order) or a control period (s)."""


class ActuatorEffect(Effect):
    """Base class of the effects on torques on their way from the controller to the joints, such as a delay.

    `rank` is its place there, lower ones first; `mark` is the name under which a rollout marks the control periods in
    which it passed on another torque than it was given, None (the default) for no marks.
    """

    rank: ClassVar[int]
    """Place between controller and joint: lower ones come first."""
    mark: ClassVar[str | None] = None
    """Name under which a rollout marks the periods in which it held a torque back; None where that is no event."""

    @abstractmethod
    def start(self, torque: Array, control_period: float) -> Array:
        """The memory (..., m) at rest, m numbers of the effect's own, after the joints were held by a torque (..., r),
        N m (N for a prismatic joint); `control_period` is in s."""

    @abstractmethod
    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The torque (r,) that is passed on in one control period (s) of the `torque` (r,) given, both N m (N for a
        prismatic joint), and the effect's memory (m,) after that period; `memory` (m,) is that before it."""


class SensorEffect(Effect):
    """Base class of the effects on positions and velocities on their way from the joints to the controller, such as
    encoders. `rank` is its place there, lower ones first."""

    rank: ClassVar[int]
    """Place between joint and controller: lower ones come first."""

    @abstractmethod
    def start(self, p: Array, v: Array, control_period: float) -> Array:
        """The memory (..., m) before the first measurement, m numbers of the effect's own, of arms at positions p (rad
        or m) moving at velocities v (rad/s or m/s), (..., r) each; `control_period` is in s."""

    @abstractmethod
    def measure(
        self, p: Column, v: Column, noise: Column, memory: Column, control_period: float
    ) -> tuple[Column, Column, Column]:
        """The measured positions (r,), rad or m, and velocities (r,), rad/s or m/s, and the effect's memory (m,) after
        them; from p and v (r,), in the same units, true or as measured by effects before, and `memory` (m,), the one
        before. `noise` (2r,) is standard normal, the positions' first; `control_period` is in s."""


class JointEffect(Effect):
    """Base class of the effects that are torques in the joints, such as friction: they depend on the joints' velocities
    and take energy out."""

    @abstractmethod
    def torque(self, v: Column) -> Column:
        """The torque (r,), N m (N for a prismatic joint), that opposes velocities v (r,), rad/s (m/s)."""

    @abstractmethod
    def steepest(self, dof: int) -> Array:
        """The greatest slope of each joint's torque over its velocity (r,), N m s/rad (N s/m), for `dof` (r) joints:
        how stiff it is."""


class LoadEffect(Effect):
    """Base class of the effects that change the inertial parameters in mid-motion, such as a payload."""

    @abstractmethod
    def mass(self, time: float) -> float:
        """The mass that is added at a time (s), kg."""

    def until(self, time: float) -> float:
        """The time (s) until which the load at `time` (s) stays as it is: `time` itself, as of a load that always
        changes, unless a subclass overrides it."""
        return time

    @abstractmethod
    def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
        """The inertial parameters (..., P), SI units, of `parameters` (..., P) with the load at `time` (s) added. The
        first are ten for each of the `links`, named in their order: m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz,
        I_zz, in kg, kg m, kg m^2 about the origin of the link's frame."""


def at_least_zero(values: ArrayLike, dof: int, what: str) -> Array:
    """Numbers (r,) of at least zero, from `values`, one for all `dof` (r) joints or one each: a read-only copy.
    Infinity is allowed; `what` names them in errors.

    Raises `InputError` for what holds no numbers, on a wrong shape, on numbers below zero and on NaN.
    """
    given = numbers(values, what)
    if not np.all(given >= 0.0):
        raise InputError(f"{what}: expected numbers of at least 0, got {given.tolist()}")
    return per_joint(given, dof, what)


def require_positive(value: float, what: str, unit: str) -> None:
    """Raise `InputError` unless `value` is a positive finite number; its message has the value's name, `what`, and its
    `unit`."""
    positive_number(value, f"{what}: expected a positive number of {unit}")
