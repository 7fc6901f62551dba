"""Robot that MuJoCo simulates."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, positive_period
from adaptctl.dynamics import Mechanism
from adaptctl.hardware.force_sensor import ForceReading
from adaptctl.hardware.gravity import GravityTorque
from adaptctl.hardware.robot import HardwareLimits, RobotReading, validate_posture
from adaptctl.optional_packages import needed
from adaptctl.simulation.mujoco_plant import MuJoCoPlant

if TYPE_CHECKING:
    import mujoco

TORQUE_RATE = 1000.0
"""N m/s (N/s), as of a Franka arm"""
END_SHARE = 0.05
"""of a joint's range, in which it stands near an end, where every motion is stopped"""


class MuJoCoRobot:
    """
    Robot in MuJoCo, with brakes that hold it until it is driven and after.

    Parameters
    ----------
    robot : str or Path or Mechanism or mujoco.MjModel
        Scene (MJCF), model or mechanism.
    control_period : float, default 0.001
        Control period in s.
    start : array_like, optional
        Positions (r,) in rad (m) at which it stands. Default: the scene's, or the middle of a joint's range where these
        are outside of it or near its end.
    body : str, optional
        First body of the arm, in a scene with several.
    torque_rate : array_like, default 1000.0
        Rate limits of the torque in N m/s (N/s).
    compensates_gravity : Mechanism or bool, default False
        Mechanism whose gravity torque the robot adds to what is written, as one without the payload that it does not
        know. True for what is simulated.
    real_time : bool, default False
        True to wait for the clock in every period.
    force_sensor : bool, default False
        True to measure the force of what the arm touches: it then has a method `force`.

    Raises
    ------
    InputError
        If the start has another number of joints, or is outside their ranges.
    MissingExtraError
        If MuJoCo is not installed.

    Examples
    --------
    >>> from adaptctl.hardware import MuJoCoRobot
    >>> robot = MuJoCoRobot(arm, control_period=period, start=p)
    >>> robot.read().p
    array([0.3, 0.5])
    """

    has_brakes = True

    @needed("MuJoCoRobot")
    def __init__(
        self,
        robot: str | Path | Mechanism | mujoco.MjModel,
        control_period: float = 1e-3,
        start: ArrayLike | None = None,
        *,
        body: str | None = None,
        torque_rate: ArrayLike = TORQUE_RATE,
        compensates_gravity: Mechanism | bool = False,
        real_time: bool = False,
        force_sensor: bool = False,
    ) -> None:
        self.period = positive_period(control_period, "control_period")
        self.plant = MuJoCoPlant.of(robot, self.period, body, servos_off=True)
        arm = self.plant.mechanism
        self.limits, self.joints = HardwareLimits.of(arm, torque_rate), [joint.name for joint in arm.primary_joints]
        own = compensates_gravity if isinstance(compensates_gravity, Mechanism) else arm
        self.compensates_gravity, self._real_time = bool(compensates_gravity), real_time
        self._gravity = GravityTorque(own)
        if force_sensor:
            self.force = self._measured_force
        home: Any = np.array([self.plant.model.qpos0[j] for j in self._places])  # type: ignore[union-attr]
        p = _within(home, self.limits) if start is None else checked(start, arm.dof, "start")
        validate_posture(p, self.joints, self.limits)
        self._state, self._rest = self.plant.init(p, np.zeros(arm.dof)), np.zeros(arm.dof)
        self._torque, self._braked, self._count, self._began = self._rest, True, 0, time.monotonic()

    @property
    def _places(self) -> list[int]:
        return [int(self.plant.model.jnt_qposadr[j]) for j in self.plant.arm.joints]  # type: ignore[union-attr]

    def read(self) -> RobotReading:
        """
        Return the measurement after the next control period.

        Returns
        -------
        RobotReading
            Measurement.
        """
        self._count += 1
        if not self._braked:
            added = self.compensation(None) if self.compensates_gravity else 0.0
            self._state = self.plant.step(self._state, self._torque + added)
        if self._real_time:
            time.sleep(max(0.0, self._began + self._count * self.period - time.monotonic()))
        return RobotReading(self._count * self.period, self._state.p, self._state.v, self._torque)

    def _measured_force(self) -> ForceReading:
        """Force on the arm by contacts, as one on the last link."""
        touch = self.plant._scene.touch()
        return ForceReading(self._count * self.period, touch[:3], point=touch[3:])

    def write(self, torque: Array) -> None:
        """
        Set the torque of the next control period.

        Parameters
        ----------
        torque : ndarray
            Torque (r,) in N m (N).
        """
        self._torque = np.array(torque)

    def start(self, torque: Array) -> None:
        """
        Release the brakes under a torque.

        Parameters
        ----------
        torque : ndarray
            Torque (r,) in N m (N).
        """
        self._torque, self._braked = np.array(torque), False

    def release(self) -> None:
        """Close the brakes, and then drop the torque."""
        self._braked, self._torque = True, self._rest
        self._state = self.plant.init(self._state.p, self._rest)

    def stop(self) -> None:
        """Close the brakes at once."""
        self.release()

    def compensation(self, reading: RobotReading | None) -> Array:
        """
        Return the robot's own gravity torque.

        Parameters
        ----------
        reading : RobotReading, optional
            Measurement. Default: the latest.

        Returns
        -------
        ndarray
            Torque (r,) in N m (N).
        """
        return self._gravity(self._state.p if reading is None else reading.p)


def _within(p: Array, limits: HardwareLimits) -> Array:
    """Positions (r,), in the middle of joints' ranges where they are outside of these or near their ends."""
    bounded = np.isfinite(limits.lower) & np.isfinite(limits.upper)
    low, high = (np.where(bounded, x, 0.0) for x in (limits.lower, limits.upper))
    margin = END_SHARE * (high - low)
    near = (p < low + margin) | (p > high - margin)
    return np.where(near & bounded, 0.5 * (low + high), p)
