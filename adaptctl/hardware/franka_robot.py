"""Franka robots, by the vendor's client pylibfranka."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.errors import InputError
from adaptctl.hardware.force_sensor import ForceReading
from adaptctl.hardware.robot import HardwareLimits, RobotReading
from adaptctl.optional_packages import needed

FR3_LIMITS = HardwareLimits(
    torque=[87.0] * 4 + [12.0] * 3,
    velocity=[2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26],
    lower=[-2.9007, -1.8361, -2.9007, -3.0770, -2.8763, 0.4398, -3.0508],
    upper=[2.9007, 1.8361, 2.9007, -0.1169, 2.8763, 4.6216, 3.0508],
    torque_rate=1000.0,
)
"""limits of a Research 3: franka_description 0.6, and 1000 N m/s of the FCI"""

UPRIGHT = (0.0, 0.0, -9.81)
"""gravity in m/s^2 in the base of a robot on a table"""
FLANGE = 0.107
"""m from the frame of link 7 to the flange"""


class FrankaRobot:
    """
    Franka Research 3, at 1 kHz.

    Parameters
    ----------
    address : str
        Address of the robot.
    real_time : bool, default True
        True to refuse a kernel without real time (`RealtimeConfig.kEnforce`). False takes any: the robot stops by
        itself when commands are late.
    limits : HardwareLimits, optional
        Limits. Default: those of a Research 3.
    feels_force : bool, default False
        True to have a method `force`: the robot's own estimate of the force on its tool (`O_F_ext_hat_K`). It is felt
        as a touch, and drives no law, since it has the errors of the vendor's model of the arm.

    Raises
    ------
    InputError
        If the robot cannot be reached, or the kernel has no real time.
    MissingExtraError
        If pylibfranka is not installed.

    Notes
    -----
    The robot adds gravity compensation with the load it was told of (`set_load`): that torque, as its own model says
    it, is subtracted. It stops by itself on late commands, collisions and its own limits.

    Examples
    --------
    >>> robot = adaptctl.hardware.FrankaRobot("robot.local")  # doctest: +SKIP
    """

    period, compensates_gravity, delay = 1e-3, True, 1e-3

    @needed("FrankaRobot")
    def __init__(
        self,
        address: str,
        real_time: bool = True,
        limits: HardwareLimits = FR3_LIMITS,
        *,
        feels_force: bool = False,
    ) -> None:
        import pylibfranka  # type: ignore[import-not-found,unused-ignore]

        self._client, self.limits = pylibfranka, limits
        config = pylibfranka.RealtimeConfig
        try:
            self._robot = pylibfranka.Robot(address, config.kEnforce if real_time else config.kIgnore)
        except Exception as error:  # the client's own kinds of error have no common one
            kernel = "; --any-kernel goes without real time" if "realtime" in str(error).lower() else ""
            raise InputError(f"{address}: no Franka robot: {' '.join(str(error).split())}{kernel}") from error
        self._model: Any = None
        self._active: Any = None
        self._state: Any = None
        self._time = 0.0
        if feels_force:
            self.force = self._estimated_force
        with suppress(Exception):  # robots of before libfranka 0.14 have none, and the description's is taken
            self._model = self._robot.load_model()

    def read(self) -> RobotReading:
        """
        Wait for the next measurement.

        Returns
        -------
        RobotReading
            Measurement; its torque is the measured one without gravity.
        """
        if self._active is None:
            self._state, passed = self._robot.read_once(), self.period
        else:
            self._state, duration = self._active.readOnce()
            passed = duration.to_sec()
        self._time += passed
        state = self._state
        return RobotReading(self._time, np.array(state.q), np.array(state.dq), np.array(state.tau_J_d))

    def start(self, torque: Array) -> None:
        """
        Begin torque control.

        Parameters
        ----------
        torque : ndarray
            First torque (r,), zero: the robot compensates gravity.
        """
        self._active = self._robot.start_torque_control()
        self.read()
        self.write(torque)

    def write(self, torque: Array) -> None:
        """
        Send a torque.

        Parameters
        ----------
        torque : ndarray
            Torque (r,) in N m without gravity.
        """
        self._send(torque, finished=False)

    def release(self) -> None:
        """End the motion: the robot holds itself."""
        self.read()
        self._send(np.zeros(len(self.limits.torque)), finished=True)
        self._active = None

    def stop(self) -> None:
        """Stop by the robot's own means."""
        self._active = None
        with suppress(Exception):  # it has stopped already where a command was refused
            self._robot.stop()

    def compensation(self, reading: RobotReading) -> Array | None:
        """
        Return the robot's gravity torque with the load it was told of.

        Parameters
        ----------
        reading : RobotReading
            Measurement.

        Returns
        -------
        ndarray or None
            Torque (r,) in N m; None where the robot has no model for its load.
        """
        if self._model is None:
            return None
        state = self._state
        if not any(state.O_ddP_O):  # a robot that does not say how it is mounted stands upright
            state.O_ddP_O = list(UPRIGHT)
        return np.array(self._model.gravity(state))

    @property
    def tool(self) -> Array:
        """Ten inertial parameters (10,) in SI units, in the frame of link 7, of hand and load that it was told of."""
        state = self._robot.read_once()
        place = np.array(state.F_x_Ctotal) + np.array([0.0, 0.0, FLANGE])
        return from_center_of_mass(state.m_total, place, np.array(state.I_total).reshape(3, 3))

    def _estimated_force(self) -> ForceReading:
        """Force on the tool as the robot estimates it, in the axes of its base."""
        return ForceReading(self._time, np.array(self._state.O_F_ext_hat_K)[:3])

    def _send(self, torque: Array, finished: bool) -> None:
        command = self._client.Torques(torque.tolist())
        command.motion_finished = finished
        self._active.writeOnce(command)
