"""Force sensor of a robot, checked, and without what it shows at rest."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import HeldState
from adaptctl.control.controller import Controller
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.hardware.robot import finite_vector

SAMPLES = 50
"""periods at rest over which the bias is averaged"""
MAX_LOST = 10
"""periods in a row without a sound force, after which the arm is stopped"""
MAX_AGE = 0.02
"""s by which a force may be older than the measurement of the joints"""
REST_SHARE = 0.5
"""share of the force that is a touch, by which it may change at rest"""


class ForceReading(NamedTuple):
    """
    Measurement of a force sensor.

    Parameters
    ----------
    time : float
        Time in s by the robot's own clock at which it was measured.
    force : ndarray
        Force (3,) in N on the arm, in the world's axes.
    moment : ndarray, optional
        Moment (3,) in N m about the point. Default: none.
    point : ndarray, optional
        Point (3,) in m in the world at which it acts on the last link. Default: unknown; the force then is felt, and
        its torques are not.

    Examples
    --------
    >>> from adaptctl.hardware import ForceReading
    >>> ForceReading(0.0, np.zeros(3)).force
    array([0., 0., 0.])
    """

    time: float
    force: Any
    moment: Any = (0.0, 0.0, 0.0)
    point: Any = None


class ForceSensor:
    """Wrench (6,) in N and N m of a robot beyond that at rest, or the last sound one, and what is wrong with it."""

    def __init__(self, robot: Any, level: float) -> None:
        self._robot, self.level, self._stamp = robot, level, -np.inf
        self._rest, self.wrench, self.lost, self.fault = np.zeros(6), np.zeros(6), 0, ""
        self.point: Array | None = None

    @property
    def bias(self) -> Array:
        """Force (3,) in N at rest."""
        return self._rest[:3]

    @property
    def force(self) -> Array:
        """Force (3,) in N."""
        return self.wrench[:3]

    def rest(self) -> None:
        """Average forces at rest. Raises `InputError` where these are missing, late or change."""
        seen = []
        for _ in range(SAMPLES):
            reading = self._robot.read()
            self.take(reading.time if reading is not None else self._stamp)
            if self.lost > MAX_LOST:
                raise InputError(f"robot: {self.fault}")
            if not self.lost:
                seen.append(self.wrench)
        self._rest = np.mean(seen, axis=0)
        change = float(np.linalg.norm((seen - self._rest)[:, :3], axis=1).max())
        if change > REST_SHARE * self.level:
            raise InputError(
                f"robot: the measured force changes by {change:.3g} N at rest, and {self.level:g} N are a touch: let "
                "nothing touch the arm, or give a larger touch_force"
            )

    def take(self, now: float) -> None:
        """Read the force of a period."""
        try:
            reading = self._robot.force()
        except Exception as error:  # of a vendor's client, whatever it is
            self._miss(f"the force sensor is silent: {type(error).__name__}: {error}")
            return
        stamp, wrench = finite_vector([getattr(reading, "time", None)], 1), None
        if stamp is not None:
            wrench = _wrench(reading)
        if stamp is None or wrench is None:
            self._miss("the force sensor is silent")
        elif now - stamp[0] > MAX_AGE:
            self._miss(f"the force sensor is {now - stamp[0]:.3g} s late")
        elif stamp[0] <= self._stamp:
            self._miss("the force sensor is silent: it repeats itself")
        else:
            self._stamp, self.wrench, self.lost, self.fault = float(stamp[0]), wrench - self._rest, 0, ""
            self.point = finite_vector(getattr(reading, "point", None), 3)

    def _miss(self, fault: str) -> None:
        self.lost, self.fault = self.lost + 1, fault

    @property
    def failed(self) -> str:
        """Fault, once it has lasted too long; empty before."""
        return self.fault if self.lost > MAX_LOST else ""

    @property
    def pressed(self) -> float:
        """Size of the force in N if it is a touch, else 0."""
        size = float(np.linalg.norm(self.force))
        return size if size > self.level else 0.0


def _wrench(reading: Any) -> Array | None:
    """Force and moment (6,) of a reading; None if it is none."""
    force, moment = finite_vector(getattr(reading, "force", None), 3), getattr(reading, "moment", np.zeros(3))
    turning = finite_vector(moment, 3)
    return None if force is None or turning is None else np.concatenate((force, turning))


def sensor_of(robot: Any, level: float) -> ForceSensor | None:
    """Force sensor of a robot, if it has one."""
    return ForceSensor(robot, level) if callable(getattr(robot, "force", None)) else None


def validate_felt(controller: Controller[Any], sensor: ForceSensor | None, mechanism: Mechanism) -> None:
    """Raise `InputError` if the torques of a measured force drive a controller, and are not known."""
    missing = (
        "" if mechanism.is_plain_tree else f"{mechanism.name}: through loops and couplings no force has known torques"
    )
    if sensor is None or sensor.point is None:
        missing = "robot: it measures no force with its point"
    if missing and HeldState(controller).driven:
        raise InputError(
            f"{missing}, which drives the target inertia of the controller: leave out "
            "force_cutoff, and give it an adaptation of with_external_torque(...)"
        )


def force_flags(sensor: ForceSensor | None) -> tuple[str, ...]:
    """Names of what a log keeps of a sensor."""
    return () if sensor is None else tuple(f"measured_force_{axis}" for axis in "xyz")


def logged(sensor: ForceSensor | None) -> Array:
    """Numbers that a log keeps of a sensor."""
    return np.empty(0) if sensor is None else sensor.force
