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
    """The least and the greatest position between which a `joint` is moved, rad (m if prismatic): its position limits.
    A joint without limits is moved from -1 to 1 rad (m), one with a single limit within 2 rad (m) of it. Where the two
    limits are more than two turns (4 pi rad, or m) apart, each whose magnitude is at least 4 pi counts as missing.
    Nothing is checked."""
    lower, upper, width = joint.limits.lower, joint.limits.upper, 2.0 * AMPLITUDE
    if upper - lower > TURNS:
        lower, upper = (x if abs(x) < TURNS else np.copysign(np.inf, x) for x in (lower, upper))
    if np.isinf(lower):
        lower = -width if np.isinf(upper) else upper - 2.0 * width
    return lower, lower + 2.0 * width if np.isinf(upper) else upper


def motion_ranges(mechanism: Mechanism) -> tuple[Array, Array]:
    """The least and the greatest positions between which the `mechanism`'s r primary (independent) joints are moved,
    two arrays (r,), rad (m if prismatic): their position limits. A joint without limits is moved from -1 to 1 rad (m),
    one with a single limit within 2 rad (m) of it. Where the two limits are more than two turns (4 pi rad, or m) apart,
    each whose magnitude is at least 4 pi counts as missing. Nothing is checked."""
    lower, upper = np.array([motion_range(joint) for joint in mechanism.primary_joints]).T
    return lower, upper
