"""Result of a run at a robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.hardware.timing import LoopTimes
from adaptctl.hardware.touch_reaction import TouchEvent
from adaptctl.identification import IdentifiedPayload
from adaptctl.simulation import Rollout

FINAL = 2.0
"""s at the end for the final error"""


@dataclass(frozen=True, eq=False)
class DrivenRun:
    """
    Record of a run at a robot.

    Parameters
    ----------
    rollout : Rollout, optional
        Run until the planned stop at its end; None with less than two samples. Its `torque` is the controller's, its
        `applied` what acted on the arm, the robot's own gravity torque included. Flags hold what was subtracted
        (`compensation.JOINT`), what the robot reported (`reported_torque.JOINT`, 0 where it reports nothing), and
        periods that were learned from (`learning`).
    times : LoopTimes
        Histogram of the control periods.
    stopped : str
        Reason of a stop before the end; empty if there was none.
    by_robot : bool
        True if the robot's own stop was asked for.
    first_error : float
        Tracking error in rad (m) of the first period.
    peak_torque_rate : float
        Greatest rate of a torque in N m/s (N/s).
    peak_speed_share : float
        Greatest share of a speed limit.
    compensates_gravity : bool
        True if the robot added its own gravity torque.
    touches : tuple of TouchEvent, default ()
        Touches that a controller `with_external_torque` felt. Flags then hold `touched` and `external_torque.JOINT`
        while the path is followed or the arm complies.
    payload : IdentifiedPayload, optional
        Body that the arm carries beyond its initial estimate, as of `learned_payload`; `told` says which of its numbers
        the motion tells. A flag `payload_mass` has its mass in kg during the run, where the motion tells it.
    force_bias : ndarray, optional
        Force (3,) in N that a force sensor showed at rest, and which was subtracted; flags `measured_force_x` to
        `measured_force_z` have the rest. None without a sensor.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from adaptctl.hardware import MuJoCoRobot
    >>> robot = MuJoCoRobot(arm, control_period=law.control_period, start=p)
    >>> start = replace(law, initial=law.model.fundamental_parameters)
    >>> run = adaptctl.drive(robot, start, reference, duration=0.1)
    >>> run.stopped, run.by_robot, run.first_error
    ('', False, 0.0)
    """

    rollout: Rollout | None
    times: LoopTimes
    stopped: str
    by_robot: bool
    first_error: float
    peak_torque_rate: float
    peak_speed_share: float
    compensates_gravity: bool
    touches: tuple[TouchEvent, ...] = ()
    payload: IdentifiedPayload | None = None
    force_bias: Array | None = None

    @property
    def final_rms_error(self) -> Array:
        """RMS errors (r,) of the last 2 s in rad (m)."""
        if self.rollout is None:
            return np.empty(0)
        late = self.rollout.time >= self.rollout.time[-1] - FINAL
        return np.asarray(np.sqrt(np.mean(self.rollout.error[late] ** 2, axis=0)))
