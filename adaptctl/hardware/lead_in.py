"""Way from an arm's posture to the reference."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import FadeIn
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.hardware.resting import MARGIN, StoppingDistance
from adaptctl.hardware.robot import HardwareLimits

LEAD_INS = (3.0, 5.0, 8.0, 12.0, 20.0)
"""s, of which the shortest is taken that stays within the limits"""
SPEED_SHARE, TORQUE_SHARE = 0.9, 0.9
"""shares of the limits that the reference may ask for"""
SAMPLES = 1001
"""number of times"""


def led_in(
    reference: Reference,
    start: Array,
    duration: float,
    mechanism: Mechanism,
    limits: HardwareLimits,
    stopping: StoppingDistance,
    lead_in: float | None = None,
) -> FadeIn:
    """
    Return a reference that starts at rest at a posture, within the limits.

    Parameters
    ----------
    reference : Reference
        Trajectory to join.
    start : ndarray
        Positions (r,) in rad (m) at time 0.
    duration : float
        Time in s for which it is followed.
    mechanism : Mechanism
        Mechanism with r joints.
    limits : HardwareLimits
        Limits of the robot.
    stopping : StoppingDistance
        Planned stops.
    lead_in : float, optional
        Time in s after which the reference is followed exactly. Default: the shortest of 3, 5, 8, 12 and 20 s, at most
        half the duration, that stays within the limits.

    Returns
    -------
    FadeIn
        Minimum-jerk lead-in to the reference.

    Raises
    ------
    InputError
        If no lead-in stays within the limits; the message names joint, time and limit.
    SingularityError
        If the loops come near a singularity at the start or on the way.
    """
    fault = ""
    for length in _lengths(duration) if lead_in is None else (lead_in,):
        faded = FadeIn(reference, start, length)
        fault = beyond_limits(faded, duration, mechanism, limits, stopping)
        if not fault:
            _validate_loops(faded, duration, mechanism)
            return faded
    raise InputError(f"reference: {fault}")


def _lengths(duration: float) -> list[float]:
    """Lead-ins in s of at most half a run; the shortest in any case."""
    return [LEAD_INS[0], *(length for length in LEAD_INS[1:] if length <= 0.5 * duration)]


def beyond_limits(
    reference: Reference, duration: float, mechanism: Mechanism, limits: HardwareLimits, stopping: StoppingDistance
) -> str:
    """Text on the first limit that a reference leaves; empty if none."""
    times = np.linspace(0.0, duration, SAMPLES)
    point = reference(times)
    p, v = (np.asarray(part, dtype=np.float64) for part in (point.p, point.v))
    if p.shape != (SAMPLES, mechanism.dof) or not all(np.isfinite(part).all() for part in point):
        return f"expected finite positions, velocities and accelerations of {mechanism.dof} joints"
    outside = (p < limits.lower) | (p > limits.upper)
    checks: list[tuple[Any, Any, str]] = [
        (outside, p, "goes to {:.4g}, beyond its range"),
        (
            np.abs(v) > SPEED_SHARE * limits.velocity,
            v,
            f"moves at {{:.4g}}, above {SPEED_SHARE:.0%} of its limit",
        ),
        (stopping.beyond(p, v), p, f"cannot be stopped {MARGIN:g} in front of its end from {{:.4g}}"),
        *_torques(point, mechanism, limits),
    ]
    for mask, values, text in checks:
        if mask.any():
            k, j = np.argwhere(mask)[0]
            joint = mechanism.primary_joints[j].name
            return f"at {times[k]:.3g} s {joint} {text.format(values[k, j])}: start elsewhere, or move less or slower"
    return ""


def _validate_loops(reference: Reference, duration: float, mechanism: Mechanism) -> None:
    """Raise `SingularityError` where loops come near a singularity."""
    if mechanism.continuation is None:
        return
    q = None
    for p in reference(np.linspace(0.0, duration, SAMPLES)).p:
        q = mechanism.configuration(p, q)


def _torques(point: ReferencePoint, mechanism: Mechanism, limits: HardwareLimits) -> list[tuple[Any, Any, str]]:
    if not mechanism.is_plain_tree or not mechanism.inertial_parameters.any():
        return []
    torque = mechanism.inverse_dynamics(*map(np.ascontiguousarray, point))
    mask = np.abs(torque) > TORQUE_SHARE * limits.torque
    return [(mask, torque, f"needs {{:.4g}} N m (N), above {TORQUE_SHARE:.0%} of its limit")]
