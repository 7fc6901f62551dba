"""Base classes of effects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, numbers, per_joint, positive_number
from adaptctl.errors import InputError
from adaptctl.scalars import Column, absolute, where

if TYPE_CHECKING:
    from adaptctl.description import Description

MIN_SECANT_SPEED = 1e-9
"""rad/s (m/s); below, friction's slope at rest is used"""


class Effect(ABC):
    """
    Abstract base class of plant effects.

    Notes
    -----
    Derive from `ActuatorEffect`, `SensorEffect`, `JointEffect` or `LoadEffect`. A subclass is a frozen dataclass. Its
    equations run over scalars of any kind, so they must not branch on values.

    Examples
    --------
    >>> from adaptctl.simulation.effects import ActuatorLag, Friction
    >>> adaptctl.Plant(arm, 0.001, effects=[Friction(viscous=1.0), ActuatorLag(0.01)])
    <Plant of 'two_link': period 0.001 s, effects: Friction, ActuatorLag>
    """

    @abstractmethod
    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """
        Raise an error where the settings do not fit a plant.

        Parameters
        ----------
        dof : int
            Number r of joints.
        links : tuple of str
            Names of the links with ten inertial parameters each, in their order.
        control_period : float
            Control period in s.

        Raises
        ------
        InputError
            If a setting is out of range or has not one number or r.
        NotFoundError
            If a link is not among `links`.
        """


class ActuatorEffect(Effect):
    """
    Abstract base class of effects on torques, such as a delay.

    Notes
    -----
    A subclass has `rank`, its position among these effects, and may have `flag`, the flag of control periods in which
    it changed a torque.

    Examples
    --------
    >>> from adaptctl.simulation.effects import ActuatorLag, TorqueLimit
    >>> TorqueLimit(5.0).rank < ActuatorLag(0.01).rank
    True
    """

    rank: ClassVar[int]
    flag: ClassVar[str | None] = None

    @abstractmethod
    def initial_state(self, torque: Array, control_period: float) -> Array:
        """
        Return the internal state at time zero.

        Parameters
        ----------
        torque : ndarray
            Torque (..., r) that held the joints, N m (N if prismatic).
        control_period : float
            Control period in s.

        Returns
        -------
        ndarray
            Internal state (..., h) of h numbers, in units of the effect.
        """

    @abstractmethod
    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """
        Return the torque passed on over one control period.

        Parameters
        ----------
        torque : Column
            Torque (r,) from the controller or the effect before, N m (N if prismatic).
        memory : Column
            Internal state (h,) before the period, in units of the effect.
        control_period : float
            Control period in s.

        Returns
        -------
        tuple of Column
            Torque (r,) in N m (N) and internal state (h,) after the period.
        """


class SensorEffect(Effect):
    """
    Abstract base class of effects on measurements, such as encoders.

    Notes
    -----
    A subclass has `rank`, its position among these effects.

    Examples
    --------
    >>> from adaptctl.simulation.effects import Encoder, FilteredDifferences
    >>> Encoder().rank < FilteredDifferences(50.0).rank
    True
    """

    rank: ClassVar[int]

    @abstractmethod
    def initial_state(self, p: Array, v: Array, control_period: float) -> Array:
        """
        Return the internal state before the first measurement.

        Parameters
        ----------
        p : ndarray
            Positions (..., r) in rad (m if prismatic).
        v : ndarray
            Velocities (..., r) in rad/s (m/s).
        control_period : float
            Control period in s.

        Returns
        -------
        ndarray
            Internal state (..., h) of h numbers, in units of the effect.
        """

    @abstractmethod
    def measure(
        self, p: Column, v: Column, noise: Column, memory: Column, control_period: float
    ) -> tuple[Column, Column, Column]:
        """
        Return measured positions and velocities.

        Parameters
        ----------
        p : Column
            Positions (r,), true or as measured by the effects before, rad (m if prismatic).
        v : Column
            Velocities (r,), likewise, rad/s (m/s).
        noise : Column
            Standard normal numbers (2r,) without a unit, the positions' first, the same for all sensor effects.
        memory : Column
            Internal state (h,) before the measurement, in units of the effect.
        control_period : float
            Control period in s.

        Returns
        -------
        tuple of Column
            Positions (r,) in rad (m), velocities (r,) in rad/s (m/s) and internal state (h,) after the measurement.
        """


class JointEffect(Effect):
    """
    Abstract base class of resisting joint torques, such as friction.

    Notes
    -----
    They dissipate energy. A subclass whose torque depends on a state (r,), zero at first, sets `has_state`, and has
    `moved_state` and `resistance` of its own.

    Examples
    --------
    >>> from adaptctl.simulation.effects import Friction
    >>> Friction(viscous=1.5).max_slope(2)
    array([1.5, 1.5])
    """

    has_state: ClassVar[bool] = False

    @abstractmethod
    def torque(self, v: Column, held: Column) -> Column:
        """
        Return the resisting torque.

        Parameters
        ----------
        v : Column
            Velocities (r,) in rad/s (m/s if prismatic).
        held : Column
            Torque (r,) on the joints, of the drives or of the springs of elastic joints, N m (N).

        Returns
        -------
        Column
            Torque (r,) in N m (N), of the sign of v: it is subtracted from the drives' torque.
        """

    def resistance(self, z: Column, v: Column, held: Column, time: float) -> tuple[Column, Column]:
        """
        Compute what makes the resisting torque at the end of a step, torque plus slope times velocity.

        Parameters
        ----------
        z : Column
            State (r,) before the step, or () without one.
        v : Column
            Velocities (r,) in rad/s (m/s) near those of the end.
        held : Column
            Torque (r,) on the joints in N m (N).
        time : float
            Step in s.

        Returns
        -------
        tuple of Column
            Torques (r,) in N m (N) and slopes (r,) in N m s/rad (N s/m), at least zero; of this base class none, and
            torque divided by velocity.
        """
        speeds = Column(where(absolute(x) > MIN_SECANT_SPEED, x, MIN_SECANT_SPEED) for x in v)
        slopes = (torque / speed for torque, speed in zip(self.torque(speeds, held), speeds, strict=True))
        return Column.zeros(len(v)), Column(slopes)

    def moved_state(self, z: Column, v: Column, time: float) -> Column:
        """
        Compute the state after a step at constant velocities.

        Parameters
        ----------
        z : Column
            State (r,) before the step, or () without one.
        v : Column
            Velocities (r,) in rad/s (m/s if prismatic).
        time : float
            Step in s.

        Returns
        -------
        Column
            State (r,) at its end; of this base class the same.
        """
        return z

    @abstractmethod
    def max_slope(self, dof: int) -> Array:
        """
        Return the largest derivative of the resisting torque with respect to velocity.

        Parameters
        ----------
        dof : int
            Number r of joints.

        Returns
        -------
        ndarray
            Slopes (r,) in N m s/rad (N s/m if prismatic), which bound the integration step.
        """


class LoadEffect(Effect):
    """
    Abstract base class of changes of inertial parameters, such as a payload.

    Examples
    --------
    >>> from adaptctl.simulation.effects import PayloadHeld
    >>> load = PayloadHeld(0.5, start=1.0)
    >>> load.mass(0.5), load.mass(1.5), load.next_change_time(0.5)
    (0.0, 0.5, 1.0)
    """

    @abstractmethod
    def mass(self, time: float) -> float:
        """
        Return the mass that the effect adds.

        Parameters
        ----------
        time : float
            Time in s.

        Returns
        -------
        float
            Mass in kg, 0 while it adds none.
        """

    def next_change_time(self, time: float) -> float:
        """
        Return the time until which the load is constant.

        Parameters
        ----------
        time : float
            Time in s.

        Returns
        -------
        float
            Time in s; of this base class `time` itself, as for a load that changes continuously.
        """
        return time

    def on(self, description: Description) -> LoadEffect:
        """
        Return the effect on a robot's links, by the names of those that have inertial parameters.

        Parameters
        ----------
        description : Description
            Robot, whose named frames, such as `tool0`, are known too.

        Returns
        -------
        LoadEffect
            The effect; of this base class the same.

        Raises
        ------
        NotFoundError
            If a link is unknown or does not move.
        """
        return self

    @abstractmethod
    def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
        """
        Return the parameters with the load added.

        Parameters
        ----------
        parameters : ndarray
            Inertial and friction parameters (..., P) without the load, SI units, ten for each link first.
        links : tuple of str
            Names of the links with ten inertial parameters each, in their order.
        time : float
            Time in s.

        Returns
        -------
        ndarray
            Parameters (..., P) in SI units; the given ones themselves where nothing is added.
        """


def at_least_zero(values: ArrayLike, dof: int, what: str) -> Array:
    """Checked values (r,) of at least zero, infinity allowed."""
    given = numbers(values, what)
    if not np.all(given >= 0.0):
        raise InputError(f"{what}: expected numbers of at least 0, got {given.tolist()}")
    return per_joint(given, dof, what)


def validate_positive(value: float, what: str, unit: str) -> None:
    """Raise `InputError` unless a number is positive and finite."""
    positive_number(value, f"{what}: expected a positive number of {unit}")
