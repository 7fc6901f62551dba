"""WidowX AI arms of Trossen Robotics, by the vendor's client trossen-arm."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any

import numpy as np

from adaptctl.arrays import Array, positive_period
from adaptctl.errors import InputError
from adaptctl.hardware.robot import HardwareLimits, RobotReading
from adaptctl.optional_packages import needed

TORQUE_RATE = 500.0
"""N m/s, which no document states: what the arm's gears were not meant to exceed is unknown"""

NOTHING = 1e-2
"""N m"""


class TrossenRobot:
    """
    WidowX AI arm, in the vendor's external-effort mode.

    Parameters
    ----------
    address : str
        Address of the arm's controller.
    control_period : float, default 0.002
        Control period in s. The client talks to the arm by itself, faster than that.
    torque_rate : float, default 500.0
        Rate limit of torques in N m/s.

    Raises
    ------
    InputError
        If the arm cannot be reached.
    MissingExtraError
        If trossen-arm is not installed.

    Notes
    -----
    The arm adds compensation of gravity and friction in this mode. What it reports of it is subtracted, and the
    description's gravity torque where it reports nothing.
    Range, speed and torque limits are those of the arm's controller, which goes into an error state beyond them. At the
    end, the arm is held by its own position control.

    Examples
    --------
    >>> robot = adaptctl.hardware.TrossenRobot("arm.local")  # doctest: +SKIP
    """

    compensates_gravity, delay = True, 2e-3

    @needed("TrossenRobot")
    def __init__(self, address: str, control_period: float = 2e-3, torque_rate: float = TORQUE_RATE) -> None:
        import trossen_arm  # type: ignore[import-not-found,unused-ignore]

        self.period = positive_period(control_period, "control_period")
        self._client, self._driver, self._due = trossen_arm, trossen_arm.TrossenArmDriver(), 0.0
        self._output: Any = None
        self._reports = False
        try:
            tool = trossen_arm.StandardEndEffector.wxai_v0_base
            self._driver.configure(trossen_arm.Model.wxai_v0, tool, address, False)
        except Exception as error:  # the client's kinds of error have no common one
            raise InputError(f"{address}: no Trossen arm: {' '.join(str(error).split())}") from error
        limits = self._driver.get_joint_limits()[:-1]  # the last is the gripper
        named = {own: [getattr(one, name) for one in limits] for own, name in FIELDS.items()}
        self.limits = HardwareLimits(**named, torque_rate=torque_rate)

    def read(self) -> RobotReading:
        """
        Wait for the next period, and return the latest measurement.

        Returns
        -------
        RobotReading
            Measurement.
        """
        now = time.monotonic()
        self._due = max(self._due + self.period, now)
        time.sleep(self._due - now)
        self._output = self._driver.get_robot_output()
        arm = self._arm
        measured = np.array(arm.positions), np.array(arm.velocities)
        return RobotReading(1e-6 * self._output.header.timestamp, *measured)

    def start(self, torque: Array) -> None:
        """
        Go from position control to external efforts.

        Parameters
        ----------
        torque : ndarray
            First torque (r,) in N m beyond the arm's compensation.
        """
        self._driver.set_arm_modes(self._client.Mode.external_effort)
        self.write(torque)

    def write(self, torque: Array) -> None:
        """
        Send a torque.

        Parameters
        ----------
        torque : ndarray
            Torque (r,) in N m beyond the arm's compensation.
        """
        self._driver.set_arm_external_efforts(self._client.VectorDouble(torque.tolist()), 0.0, False)

    def release(self) -> None:
        """Hold the arm where it is by its own position control."""
        here = self._client.VectorDouble(list(self._driver.get_robot_output().joint.arm.positions))
        self._driver.set_arm_modes(self._client.Mode.position)
        self._driver.set_arm_positions(here, 0.0, False)

    def stop(self) -> None:
        """Brake the arm: its idle mode."""
        with suppress(Exception):  # an arm in an error state has braked itself
            self._driver.set_arm_modes(self._client.Mode.idle)

    def compensation(self, reading: RobotReading) -> Array | None:
        """
        Return the torque that the arm says it adds by itself.

        Parameters
        ----------
        reading : RobotReading
            Measurement.

        Returns
        -------
        ndarray or None
            Torque (r,) in N m; None if it is nothing at all, as a simulator's may be that does not report it.
        """
        told = np.array(self._arm.compensation_efforts)
        self._reports = self._reports or bool((np.abs(told) > NOTHING).any())
        return told if self._reports else None

    @property
    def _arm(self) -> Any:
        return self._output.joint.arm


FIELDS = {"torque": "effort_max", "velocity": "velocity_max", "lower": "position_min", "upper": "position_max"}
"""limits of a joint as `HardwareLimits` and as the client call them"""
