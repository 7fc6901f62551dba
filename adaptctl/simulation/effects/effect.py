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
    """Base class of the effects by which a plant is not ideal: a frozen dataclass of its own parameters.

    Its equations are written over scalars of any kind. What changes over time is its memory, one column of numbers
    passed in and out.
    """

    @abstractmethod
    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` where the effect does not fit `dof` (r) joints, the `links` (names of those with inertial
        parameters, in their order) or a control period (s)."""


class ActuatorEffect(Effect):
    """An effect on torques on their way from the controller to the joints. `rank` is its place there, lower ones first;
    `mark` is the name under which a rollout marks the periods in which it held a torque back, None where that is no
    event."""

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
        """The torque (r,) that is passed on of a torque (r,), both N m (N for a prismatic joint), in one control period
        (s), and the memory (m,) after it, of the one before."""


class SensorEffect(Effect):
    """An effect on positions and velocities on their way from the joints to the controller. `rank` is its place there,
    lower ones first."""

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
        """The measured p (rad or m) and v (rad/s or m/s), (r,) each, and the memory (m,) after it, from p and v (r,) as
        they are or as effects before measured them, and the memory before; `noise` (2r,) is standard normal, the
        positions' first, and `control_period` in s."""


class JointEffect(Effect):
    """An effect that is a torque in the joints: it depends on their velocities and takes energy out."""

    @abstractmethod
    def torque(self, v: Column) -> Column:
        """The torque (r,), N m (N for a prismatic joint), that opposes velocities v (r,), rad/s (m/s)."""

    @abstractmethod
    def steepest(self, dof: int) -> Array:
        """The greatest slope of each joint's torque over its velocity (r,), N m s/rad (N s/m), for `dof` (r) joints:
        how stiff it is."""


class LoadEffect(Effect):
    """An effect on the inertial parameters in mid-motion, such as a payload."""

    @abstractmethod
    def mass(self, time: float) -> float:
        """The mass that is added at a time (s), kg."""

    def until(self, time: float) -> float:
        """The time (s) until which the load at a time (s) stays as it is; unless overridden that time itself, as of a
        load that always changes."""
        return time

    @abstractmethod
    def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
        """The inertial parameters (..., P) after the load at a time (s) was added to those given (..., P), SI units;
        the first are ten for each of the `links`, by name."""


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
    """Raise `InputError` for what is no positive finite number, with its name, `what`, and its `unit`."""
    positive_number(value, f"{what}: expected a positive number of {unit}")
