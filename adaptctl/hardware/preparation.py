"""Controller and reference for a robot, from its description and its posture."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.control import Sinusoids, SlotineLi
from adaptctl.control.controller import Reference
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism
from adaptctl.errors import SimplificationWarning
from adaptctl.hardware.robot import HardwareLimits
from adaptctl.tuning import adaptive_controller

ROTOR = 0.02
"""kg m^2 of rotor inertia at a joint of 1 N m; it grows with the square root of the torque limit. Those of an FR3 in
MuJoCo's menagerie, 0.195 at 87 N m and 0.074 at 12 N m, are met within 7 %."""
AMPLITUDE, SPEED_SHARE, ROOM_SHARE = 0.3, 0.15, 0.4
"""rad (m); shares of the speed limit, and of the way to the nearer end, that a motion uses"""
FREQUENCIES = (0.2, 0.45)
"""Hz, of the first joint and the last"""


def with_rotors(mechanism: Mechanism) -> Mechanism:
    """
    Return the mechanism with rotor inertias for its revolute joints, where its description has none.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.

    Returns
    -------
    Mechanism
        Mechanism whose missing rotor inertias are guessed from the torque limits; the same if none is missing.

    Warns
    -----
    SimplificationWarning
        If rotor inertias were guessed: gains lean on them.

    Notes
    -----
    The guess is 0.02 kg m^2 times the square root of the torque limit in N m. Gains need it within a factor of three;
    the estimate is learned.

    Examples
    --------
    >>> import warnings
    >>> from adaptctl.hardware import with_rotors
    >>> with warnings.catch_warnings(action="ignore"):
    ...     geared = with_rotors(arm)
    >>> geared.parameter_names[-2:]
    ('shoulder.rotor_inertia', 'elbow.rotor_inertia')
    """
    primary = {joint.name for joint in mechanism.primary_joints}
    joints = [link.joint for link in mechanism.links]
    drives = [joint.drive if joint.name not in primary else _geared(joint) for joint in joints]
    guessed = [joint.name for joint, drive in zip(joints, drives, strict=True) if drive != joint.drive]
    if not guessed:
        return mechanism
    warnings.warn(
        f"{mechanism.name}: the description has no rotor inertia of {', '.join(guessed)}: guessed from torque limits, "
        "and learned; gains lean on them, so give measured ones if you have them",
        SimplificationWarning,
        stacklevel=2,
    )
    return mechanism.with_drives(drives)


def _geared(joint: Any) -> Drive:
    drive: Drive = joint.drive
    if drive.rotor_inertia is not None or not joint.kind.is_revolute or not np.isfinite(joint.limits.effort):
        return drive
    return replace(drive, rotor_inertia=float(f"{ROTOR * joint.limits.effort**0.5:.3g}"))


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

    Examples
    --------
    >>> from adaptctl.hardware import HardwareLimits, motion_about
    >>> motion_about(p, HardwareLimits.of(arm)).at(0.0).p
    array([0.3, 0.5])
    """
    center = np.asarray(p, dtype=np.float64)
    frequency = np.linspace(*FREQUENCIES, center.size)
    room = ROOM_SHARE * np.minimum(center - limits.lower, limits.upper - center)
    speed = SPEED_SHARE * limits.velocity / (2.0 * np.pi * frequency)
    return Sinusoids(center, np.minimum(amplitude, np.minimum(np.maximum(room, 0.0), speed)), frequency)


def ready_controller(
    mechanism: Mechanism, control_period: float, reference: Reference, tool: ArrayLike | None = None
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

    Returns
    -------
    SlotineLi
        Controller as of `adaptive_controller`, whose initial estimate holds the arm.

    Examples
    --------
    >>> from adaptctl.hardware import ready_controller
    >>> ready_controller(arm, 0.004, reference).initial.any()
    np.True_
    """
    controller = adaptive_controller(mechanism, control_period=control_period, reference=reference)
    own = np.array(controller.model.mechanism.inertial_parameters)
    if tool is not None:
        last = 10 * (len(mechanism.links) - 1)
        own[last : last + 10] += np.asarray(tool)
    return replace(controller, initial=controller.model.regrouping @ own)
