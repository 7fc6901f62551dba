"""Ranges in which joints are moved, and random sinusoids within them."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.gains.workspace import TURNS
from adaptctl.description import Joint
from adaptctl.dynamics import Mechanism

AMPLITUDE = 0.5
"""Greatest swing about the centre, rad or m, where the limits allow it."""
FREQUENCIES = (0.1, 0.25)
"""Hz"""
START_TIME, FADE_SLOPE = 2.0, 1.875
"""Length of the smooth start, s, and the largest slope of its course from 0 to 1 over that length."""


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


def random_swing(
    mechanism: Mechanism, room: Array, speed_share: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Frequencies (r,), Hz, and amplitudes (r,), rad (m if prismatic), of random sinusoids, one for each of the
    `mechanism`'s r primary joints, drawn from `rng`: the frequencies between 0.1 and 0.25 Hz, then the amplitudes
    between half and all of the largest that stays within 0.5 rad (m), `room` (r,), rad (m), to either side, and
    `speed_share` of the joints' velocity limits, a smooth start of 2 s included. Nothing is checked."""
    fastest = np.array([joint.limits.velocity for joint in mechanism.primary_joints])
    frequency = rng.uniform(*FREQUENCIES, mechanism.dof)
    slope = 2.0 * np.pi * frequency + FADE_SLOPE / START_TIME
    largest = np.minimum(np.minimum(AMPLITUDE, room), speed_share * fastest / slope)
    return frequency, largest * rng.uniform(0.5, 1.0, mechanism.dof)
