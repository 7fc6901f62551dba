"""Ranges in which joints are moved."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.gains.workspace import TURNS
from adaptctl.description import Joint
from adaptctl.dynamics import Mechanism

AMPLITUDE = 0.5
"""Greatest swing about the centre, rad or m, where the limits allow it."""


def motion_range(joint: Joint) -> tuple[float, float]:
    """Least and greatest position of a joint, rad or m: its limits, and 2 AMPLITUDE to each side of zero, or to the
    one side of its only bound, where it has none. Limits of more than two turns are none."""
    lower, upper, width = joint.limits.lower, joint.limits.upper, 2.0 * AMPLITUDE
    if upper - lower > TURNS:
        lower, upper = (x if abs(x) < TURNS else np.copysign(np.inf, x) for x in (lower, upper))
    if np.isinf(lower):
        lower = -width if np.isinf(upper) else upper - 2.0 * width
    return lower, lower + 2.0 * width if np.isinf(upper) else upper


def motion_ranges(mechanism: Mechanism) -> tuple[Array, Array]:
    """Least and greatest positions (r,) of the primary joints, rad or m."""
    lower, upper = np.array([motion_range(joint) for joint in mechanism.primary_joints]).T
    return lower, upper
