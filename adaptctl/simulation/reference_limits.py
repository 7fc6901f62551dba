"""References beyond the limits of an arm's joints."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference
from adaptctl.control.spline import Spline
from adaptctl.description import Joint
from adaptctl.errors import ReferenceWarning, warn

SAMPLES = 401
"""number of times"""
TOLERANCE = 1e-6
"""rad (m), and share of a speed, beyond a limit that counts as within"""
MAX_OVERSHOOT = 0.05
"""share of a spline's range that it may leave it by"""
MANY_TURNS = 6.0 * math.pi
"""rad: a joint without limits that starts beyond so much may be given in degrees"""


def warn_of_limits(reference: Reference, joints: Sequence[Joint], duration: float) -> None:
    """Warn (`ReferenceWarning`) in one line of positions and speeds beyond limits, and of angles like degrees."""
    point = reference(np.linspace(0.0, duration, SAMPLES))
    p, v = np.asarray(point.p, dtype=np.float64), np.asarray(point.v, dtype=np.float64)
    if not p.shape == v.shape == (SAMPLES, len(joints)) or not np.isfinite(p + v).all():
        return  # which is refused when it is sampled
    told = [text for k, joint in enumerate(joints) for text in _beyond(joint, p[:, k], v[:, k])]
    told += _overshoots(reference, joints) if isinstance(reference, Spline) else []
    if told:
        degrees = any(_may_be_degrees(joint, p[:, k]) for k, joint in enumerate(joints))
        hint = "; expected rad, and these look like degrees" if degrees else ""
        warn(f"reference: {'; '.join(told)}{hint}", ReferenceWarning)


def _beyond(joint: Joint, p: Array, v: Array) -> list[str]:
    """Texts on positions and speeds beyond a joint's limits."""
    limits, unit = joint.limits, joint.kind.position_unit
    told = []
    far = p[np.abs(p - np.clip(p, limits.lower, limits.upper)).argmax()]
    if not limits.lower - TOLERANCE <= far <= limits.upper + TOLERANCE:
        told.append(f"{joint.name} goes to {far:.4g} {unit}, beyond {limits.lower:.4g} to {limits.upper:.4g}")
    elif _may_be_degrees(joint, p):
        told.append(f"{joint.name} starts at {p[0]:.4g} {unit}")
    if (speed := float(np.abs(v).max())) > limits.velocity * (1.0 + TOLERANCE):
        told.append(f"{joint.name} moves at {speed:.4g} {unit}/s, beyond {limits.velocity:.4g}")
    return told


def _overshoots(spline: Spline, joints: Sequence[Joint]) -> list[str]:
    """Joints in which a spline leaves its positions by far."""
    way = np.ptp(spline.positions, axis=0)
    return [
        f"{joint.name} overshoots its spline's positions by {beyond:.4g} {joint.kind.position_unit}: give more of them"
        for joint, beyond, whole in zip(joints, spline.overshoot, way, strict=True)
        if beyond > MAX_OVERSHOOT * whole + TOLERANCE
    ]


def _may_be_degrees(joint: Joint, p: Array) -> bool:
    """True where angles are far and within limits as degrees."""
    limits, angles = joint.limits, np.radians(p)
    limited = bool(np.all((angles >= limits.lower) & (angles <= limits.upper)))
    beyond = p.min() < limits.lower or p.max() > limits.upper
    far = float(np.abs(p).max()) > 2.0 * math.pi if beyond else abs(float(p[0])) > MANY_TURNS
    return joint.kind.is_revolute and limited and far
