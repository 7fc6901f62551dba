"""Base classes of effects: ways in which a plant is not ideal."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, numbers, per_joint
from adaptctl.errors import InputError
from adaptctl.scalars import Column


class Effect(ABC):
    """Base class of the effects by which a plant is not ideal: a frozen dataclass of its own parameters.

    Its equations are written over scalars of any kind. What changes over time is its memory, one column passed
    in and out.
    """

    @abstractmethod
    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` where the effect does not fit r joints, the links or a control period (s)."""


class ActuatorEffect(Effect):
    """An effect on torques on their way from the controller to the joints."""

    rank: ClassVar[int]
    """Place between controller and joint: lower ones come first."""
    mark: ClassVar[str | None] = None
    """Name under which a rollout marks the periods in which it held a torque back; None where that is no event."""

    @abstractmethod
    def start(self, torque: Array, control_period: float) -> Array:
        """The memory (..., m) at rest, after the joints were held by a torque (..., r) N m."""

    @abstractmethod
    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The torque (r,) N m that is passed on of a torque (r,) in one control period (s), and the memory after it."""


class SensorEffect(Effect):
    """An effect on positions and velocities on their way from the joints to the controller."""

    rank: ClassVar[int]
    """Place between joint and controller: lower ones come first."""

    @abstractmethod
    def start(self, p: Array, v: Array, control_period: float) -> Array:
        """The memory (..., m) before the first measurement, of arms at positions p moving at velocities v (..., r)."""

    @abstractmethod
    def measure(
        self, p: Column, v: Column, noise: Column, memory: Column, control_period: float
    ) -> tuple[Column, Column, Column]:
        """The measured p (rad or m) and v (rad/s or m/s), (r,) each, and the memory after it; `noise` (2r,) is standard
        normal."""


class JointEffect(Effect):
    """A torque in the joints that depends on their velocities and takes energy out."""

    @abstractmethod
    def torque(self, v: Column) -> Column:
        """The torque (r,) that opposes velocities v (r,), N m (N of a prismatic joint)."""

    @abstractmethod
    def steepest(self, dof: int) -> Array:
        """The greatest slope of each joint's torque over its velocity (r,), N m s/rad: how stiff it is."""


class LoadEffect(Effect):
    """An effect on the inertial parameters in mid-motion, such as a payload."""

    @abstractmethod
    def mass(self, time: float) -> float:
        """The mass that is added at a time (s), kg."""

    def until(self, time: float) -> float:
        """The time (s) until which the load at a time (s) stays as it is; that time itself where it always changes."""
        return time

    @abstractmethod
    def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
        """The inertial parameters (..., P) after the load at a time (s) was added, SI units."""


def at_least_zero(values: ArrayLike, dof: int, what: str) -> Array:
    """Numbers (r,) of at least zero, one for all joints or one each. Infinity is allowed.

    Raises `InputError` on a wrong shape, on numbers below zero and on NaN.
    """
    given = numbers(values, what)
    if not np.all(given >= 0.0):
        raise InputError(f"{what}: expected numbers of at least 0, got {given.tolist()}")
    return per_joint(given, dof, what)


def require_positive(value: float, what: str, unit: str) -> None:
    """Raise `InputError` for a number that is not positive and finite."""
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"{what}: expected a positive number of {unit}, got {value}")
