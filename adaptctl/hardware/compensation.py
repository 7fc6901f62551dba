"""Gravity torque that a robot adds by itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.hardware.gravity import GravityTorque
from adaptctl.hardware.robot import RobotReading, finite_vector


class Compensation:
    """
    Gravity torque that a robot adds to what is written, and that is subtracted from the controller's torque.

    Parameters
    ----------
    robot : TorqueRobot
        Robot. Its own `compensation(reading)` is asked where there is one.
    gravity : GravityTorque
        Gravity torque of the description, where the robot does not report its own.
    has_weight : bool
        True if the controller's model has gravity. Without, nothing is subtracted.

    Notes
    -----
    The payload's weight, which the robot does not know, is then left to the controller's model.
    """

    def __init__(self, robot: Any, gravity: GravityTorque, has_weight: bool) -> None:
        self._of = getattr(robot, "compensation", None)
        self._gravity, self._is_used = gravity, bool(robot.compensates_gravity) and has_weight
        self._last: Array | None = None

    def __call__(self, reading: RobotReading) -> Array:
        """Torque (r,) in N m (N) that the robot adds: what it reports, else that of the description."""
        if not self._is_used:
            return np.zeros_like(reading.p)
        told = None if self._of is None else self._of(reading)
        if told is None:
            return self._gravity(reading.p)
        found = finite_vector(told, len(reading.p))
        self._last = found if found is not None else self._last
        return self._gravity(reading.p) if self._last is None else self._last
