"""Interface between the loop and a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_per_joint
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError

REQUIRED = ("read", "write", "stop", "limits", "period", "compensates_gravity")


class RobotReading(NamedTuple):
    """
    Measurement of a robot in one control period.

    Parameters
    ----------
    time : float
        Time in s by the robot's own clock.
    p, v : ndarray
        Positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
    torque : ndarray, optional
        Torque (r,) in N m (N) that the robot reports as applied `delay` ago, in the terms of `write`. Default: none.

    Examples
    --------
    >>> from adaptctl.hardware import RobotReading
    >>> RobotReading(0.0, np.zeros(2), np.zeros(2)).torque is None
    True
    """

    time: float
    p: Any
    v: Any
    torque: Any = None


@dataclass(frozen=True, eq=False)
class HardwareLimits:
    """
    Limits that a robot's own controller enforces.

    Parameters
    ----------
    torque : array_like
        Torques (r,) in N m (N).
    velocity : array_like
        Speeds (r,) in rad/s (m/s).
    lower, upper : array_like
        Ends of the range (r,) in rad (m).
    torque_rate : array_like, default inf
        Rates of the torque (r,) in N m/s (N/s), or one number.

    Raises
    ------
    InputError
        If a shape is wrong, a limit is not positive or a range is empty.

    Examples
    --------
    >>> from adaptctl.hardware import HardwareLimits
    >>> HardwareLimits([87.0, 12.0], [2.6, 5.2], [-2.9, -1.8], [2.9, 1.8], torque_rate=1000.0).torque_rate
    array([1000., 1000.])
    """

    torque: Any
    velocity: Any
    lower: Any
    upper: Any
    torque_rate: Any = np.inf

    def __post_init__(self) -> None:
        r = np.size(self.torque)
        for name in ("torque", "velocity", "torque_rate"):
            values = positive_per_joint(getattr(self, name), r, f"robot limits: {name}", infinite=True)
            object.__setattr__(self, name, values)
        for name in ("lower", "upper"):
            given = np.asarray(getattr(self, name), dtype=np.float64)
            if given.shape != (r,) or np.isnan(given).any():
                raise InputError(f"robot limits: {name}: expected {r} numbers, got {given.tolist()}")
            given.flags.writeable = False
            object.__setattr__(self, name, given)
        if not np.all(self.lower < self.upper):
            raise InputError("robot limits: expected lower < upper for every joint")

    @classmethod
    def of(cls, mechanism: Mechanism, torque_rate: ArrayLike = np.inf) -> Self:
        """
        Return the limits of a description.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with r joints.
        torque_rate : array_like, default inf
            Rates of the torque in N m/s (N/s), which no description has.

        Returns
        -------
        HardwareLimits
            Limits.

        Examples
        --------
        >>> from adaptctl.hardware import HardwareLimits
        >>> HardwareLimits.of(arm, torque_rate=1000.0).torque_rate
        array([1000., 1000.])
        """
        limits = [joint.limits for joint in mechanism.primary_joints]
        named = {name: [getattr(one, name) for one in limits] for name in ("velocity", "lower", "upper")}
        return cls([one.effort for one in limits], torque_rate=torque_rate, **named)

    @property
    def dof(self) -> int:
        """Number r of joints."""
        return np.size(self.torque)

    def within(self, other: HardwareLimits) -> HardwareLimits:
        """
        Return the narrower of two limits in each joint.

        Parameters
        ----------
        other : HardwareLimits
            Limits of as many joints.

        Returns
        -------
        HardwareLimits
            Limits.

        Raises
        ------
        InputError
            If the ranges of a joint do not overlap.

        Examples
        --------
        >>> from adaptctl.hardware import HardwareLimits
        >>> own = HardwareLimits.of(arm)
        >>> own.within(own).dof
        2
        """
        smaller = [np.minimum(getattr(self, n), getattr(other, n)) for n in ("torque", "velocity")]
        lower = np.maximum(self.lower, other.lower)
        upper = np.minimum(self.upper, other.upper)
        rate = np.minimum(self.torque_rate, other.torque_rate)
        return HardwareLimits(smaller[0], smaller[1], lower, upper, rate)


@runtime_checkable
class TorqueRobot(Protocol):
    """
    Interface that `drive` needs: any object with these attributes and methods is a robot.

    Attributes
    ----------
    period : float
        Control period in s.
    compensates_gravity : bool
        True if the robot adds its own gravity torque to what is written.
    limits : HardwareLimits
        Limits of the robot's own controller.

    Notes
    -----
    `read` waits for the next measurement, `write` sends torques (r,), and `stop` is the vendor's own stop, at once and
    without a plan. These may be there too: `start(torque)` begins torque control at a first torque, `release()` hands
    the arm back at rest, `compensation(reading)` is the robot's own gravity torque (r,) that it adds, `has_brakes` is
    True if brakes hold it until `start`, `delay` the time in s until a torque acts, `joints` the joints' names, and
    `force()` the `ForceReading` of a force sensor.

    Examples
    --------
    >>> from adaptctl.hardware import MuJoCoRobot, TorqueRobot
    >>> isinstance(MuJoCoRobot(arm, control_period=period), TorqueRobot)
    True
    """

    period: float
    compensates_gravity: bool
    limits: HardwareLimits

    def read(self) -> RobotReading | None:
        """
        Wait for the next measurement.

        Returns
        -------
        RobotReading or None
            Measurement; None if none came in time.
        """

    def write(self, torque: Array) -> None:
        """
        Send torques for the next control period.

        Parameters
        ----------
        torque : ndarray
            Torques (r,) in N m (N).
        """

    def stop(self) -> None:
        """Stop the arm by the robot's own means."""


def validate_robot(robot: object) -> None:
    """Raise `InputError` if a robot lacks something that `drive` needs."""
    absent = [name for name in REQUIRED if not hasattr(robot, name)]
    if absent:
        raise InputError(
            f"robot: {type(robot).__name__} has no {', '.join(absent)}; expected a robot, such as "
            "adaptctl.hardware.MuJoCoRobot(mechanism)"
        )
    if not isinstance(robot.limits, HardwareLimits):  # type: ignore[attr-defined]  # it was looked for
        raise InputError("robot: expected `limits` to be HardwareLimits(torque, velocity, lower, upper, torque_rate)")


def validate_posture(p: Array, names: Sequence[str], limits: HardwareLimits) -> None:
    """Raise `InputError` for a joint at p (r,) outside its range."""
    for j in map(int, np.flatnonzero((p < limits.lower) | (p > limits.upper))):
        low, high = limits.lower[j], limits.upper[j]
        raise InputError(f"robot: {names[j]} stands at {p[j]:.4g}, outside its range {low:.4g} to {high:.4g} rad (m)")


def finite_vector(values: object, size: int) -> Array | None:
    """Numbers (size,); None if they are not numbers, too few or not finite."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return array if array.shape == (size,) and np.isfinite(array).all() else None
