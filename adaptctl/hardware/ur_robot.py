"""Universal Robots arms, by ur_rtde."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from adaptctl.arrays import Array, real_number
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.errors import InputError
from adaptctl.hardware.force_sensor import ForceReading
from adaptctl.hardware.robot import HardwareLimits, RobotReading
from adaptctl.optional_packages import needed

TORQUE_RATE = 2000.0
"""N m/s (N/s)"""


class URRobot:
    """
    UR e-series arm, in direct torque control at 500 Hz.

    Parameters
    ----------
    address : str
        Address of the robot, with PolyScope 5.23 or newer.
    limits : HardwareLimits
        Limits, such as those of the arm's description.
    force_sensor : bool, default False
        True to have a method `force`: force and moment at the tool center point of the sensor in an e-series wrist.
    base_turn : float, default pi
        Angle in rad about z from the axes of the robot's base to those of the description's: half a turn in ROS's.

    Raises
    ------
    InputError
        If the robot cannot be reached.
    MissingExtraError
        If ur_rtde is not installed.

    Notes
    -----
    The robot adds compensation of gravity, with the payload it was told of, and of most of the friction. Its protective
    stop guards speed, range and force. Torque rates are limited to 2000 N m/s.

    Examples
    --------
    >>> limits = adaptctl.hardware.HardwareLimits.of(arm)
    >>> robot = adaptctl.hardware.URRobot("robot.local", limits)  # doctest: +SKIP
    """

    period, compensates_gravity, delay = 1 / 500, True, 2e-3

    @needed("URRobot")
    def __init__(
        self,
        address: str,
        limits: HardwareLimits,
        *,
        force_sensor: bool = False,
        base_turn: float = np.pi,
    ) -> None:
        import rtde_control  # type: ignore[import-not-found,unused-ignore]
        import rtde_receive  # type: ignore[import-not-found,unused-ignore]

        rate = np.minimum(limits.torque_rate, TORQUE_RATE)
        self.limits = HardwareLimits(limits.torque, limits.velocity, limits.lower, limits.upper, rate)
        try:
            self._receive = rtde_receive.RTDEReceiveInterface(address)
            self._control = rtde_control.RTDEControlInterface(address)
        except Exception as error:  # the client raises the standard library's of C++
            raise InputError(f"{address}: no UR robot: {' '.join(str(error).split())}") from error
        self._payload, self._tick = self._told(), None
        self._time, self._turn = 0.0, real_number(base_turn, "base_turn")
        if force_sensor:
            self.force = self._measured_force

    def read(self) -> RobotReading:
        """
        Wait for the next period, and return the latest measurement.

        Returns
        -------
        RobotReading
            Measurement.
        """
        if self._tick is not None:
            self._control.waitPeriod(self._tick)
        self._tick = self._control.initPeriod()
        if self._told() != self._payload:
            raise RuntimeError("the payload set at the robot changed during the run")
        time, p, v = self._receive.getTimestamp(), self._receive.getActualQ(), self._receive.getActualQd()
        self._time = time
        return RobotReading(time, np.array(p), np.array(v))

    def write(self, torque: Array) -> None:
        """
        Send a torque.

        Parameters
        ----------
        torque : ndarray
            Torque (r,) in N m beyond the robot's compensation.
        """
        if not self._control.directTorque(torque.tolist()):
            raise RuntimeError("the robot refuses torques: look at the teach pendant")

    def release(self) -> None:
        """End torque control: the robot holds itself."""
        self._control.stopScript()

    def stop(self) -> None:
        """Stop by the robot's own means."""
        with suppress(Exception):  # it has stopped already where a torque was refused
            self._control.stopScript()

    @property
    def tool(self) -> Array:
        """Ten inertial parameters (10,) in SI units, in the last link's frame, of the payload set at the robot."""
        mass, center, inertia = self._payload
        xx, yy, zz, xy, xz, yz = inertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return from_center_of_mass(mass, center, tensor)

    def _measured_force(self) -> ForceReading:
        """Force and moment at the tool center point, in the description's axes."""
        wrench, pose = self._receive.getActualTCPForce(), self._receive.getActualTCPPose()
        cos, sin = np.cos(self._turn), np.sin(self._turn)
        turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        force, moment, point = (turned @ part for part in (wrench[:3], wrench[3:], pose[:3]))
        return ForceReading(self._time, force, moment, point)

    def _told(self) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        """Payload set at the robot: mass, centre and inertia."""
        get: Any = self._receive
        inertia = tuple(get.getPayloadInertia()) or (0.0,) * 6
        return float(get.getPayload()), tuple(get.getPayloadCog()), inertia
