"""Controller and reference for a robot, from its description and its posture."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import checked, real_number
from adaptctl.control import Sinusoids, SlotineLi
from adaptctl.control.adaptation.late_torques import MAX_DELAY
from adaptctl.control.controller import Reference
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, validate_kind
from adaptctl.hardware.gravity import parameters_with
from adaptctl.hardware.robot import HardwareLimits, validate_posture
from adaptctl.tuning import adaptive_controller
from adaptctl.tuning.default_gains import DEFAULT_SAMPLING_RATIO
from adaptctl.tuning.stated_effects import late_share

AMPLITUDE, SPEED_SHARE, ROOM_SHARE = 0.3, 0.15, 0.4
"""rad (m); shares of the speed limit, and of the way to the nearer end, that a motion uses"""
FREQUENCIES = (0.2, 0.45)
"""Hz, of the first joint and the last"""


def motion_about(p: ArrayLike, limits: HardwareLimits, amplitude: float = AMPLITUDE) -> Sinusoids:
    """
    Return a gentle motion of all joints about a posture.

    Parameters
    ----------
    p : array_like
        Positions (r,) in rad (m).
    limits : HardwareLimits
        Limits of the robot.
    amplitude : float, default 0.3
        Greatest amplitude in rad (m). It is less where speed limits or ends are near.

    Returns
    -------
    Sinusoids
        Sinusoids of 0.2 to 0.45 Hz that start at rest at the posture.

    Raises
    ------
    InputError
        If the posture has another number of joints than the limits, is outside of them, or is not of numbers.
    NonFiniteError
        If a position is not finite.

    Examples
    --------
    >>> from adaptctl.hardware import HardwareLimits, motion_about
    >>> motion_about(p, HardwareLimits.of(arm)).at(0.0).p
    array([0.3, 0.5])
    """
    validate_kind(limits, HardwareLimits, "limits", "as HardwareLimits.of(mechanism) gives")
    center = checked(p, limits.dof, "posture")
    validate_posture(center, [f"joint {j + 1}" for j in range(limits.dof)], limits)
    frequency = np.linspace(*FREQUENCIES, center.size)
    room = ROOM_SHARE * np.minimum(center - limits.lower, limits.upper - center)
    speed = SPEED_SHARE * limits.velocity / (2.0 * np.pi * frequency)
    return Sinusoids(center, np.minimum(amplitude, np.minimum(np.maximum(room, 0.0), speed)), frequency)


def periods_late(robot: Any) -> int:
    """Delay until a torque acts, as a robot states it, in whole control periods."""
    delay = real_number(getattr(robot, "delay", 0.0), what := "robot: delay: expected a time in s of 0 to 1")
    if not 0.0 <= delay <= 1.0:
        raise InputError(f"{what}, got {delay:g}")
    return math.ceil(delay / robot.period - 1e-6)


def hold_at(delay: int) -> float:
    """Sampling ratio of tuned gains at a delay in periods: from two on, with the margin that they have at one."""
    return DEFAULT_SAMPLING_RATIO * late_share(delay)


def ready_controller(
    mechanism: Mechanism, control_period: float, reference: Reference, tool: ArrayLike | None = None, delay: int = 0
) -> SlotineLi:
    """
    Return the default learning controller, from the description's own parameters.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    control_period : float
        Control period of the robot in s.
    reference : Reference
        Trajectory for which the gains are chosen.
    tool : array_like, optional
        Ten inertial parameters (10,) in SI units, in the last link's frame, of what the arm holds. Default: nothing.
    delay : int, default 0
        Delay until a torque acts in control periods. Gains are lower from two on, and what is learned is of torques
        that had arrived.

    Returns
    -------
    SlotineLi
        Controller as of `adaptive_controller`, whose initial estimate holds the arm.

    Examples
    --------
    >>> from adaptctl.hardware import ready_controller
    >>> moves = adaptctl.Sinusoids([0.3, 0.5], [0.9, 1.2], [0.5, 0.8])
    >>> ready_controller(arm, 0.004, moves).initial.any()
    np.True_
    """
    controller = adaptive_controller(
        mechanism, control_period=control_period, reference=reference, delay=min(delay, MAX_DELAY)
    )
    own = parameters_with(controller.model.mechanism, tool)
    return replace(controller, initial=controller.model.regrouping @ own)
