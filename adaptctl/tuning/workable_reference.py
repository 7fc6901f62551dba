"""References that a mechanism's motors can follow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism
from adaptctl.tuning.motion_range import AMPLITUDE, motion_ranges

FREQUENCIES = (0.1, 0.25)
"""Hz"""
START_TIME, FADE_SLOPE = 2.0, 1.875
"""s of the smooth start, and the greatest slope of a quintic fade over unit time"""
TORQUE_SHARE, SPEED_SHARE, ROOM_SHARE = 0.6, 0.6, 0.8
"""of torque limits, of velocity limits and of the room to the position limits"""
SAMPLES, ROUNDS, NEAR = 400, 24, 40
"""random centres, then rounds of random ones near the best"""
INNER = 0.8
"""of the position ranges, in which random centres lie"""
HORIZON, TIMES = 20.0, 201
"""s of the reference that are looked at, and at how many times"""
EVEN, COUPLED, AWAY = 0.1, 0.03, 0.1
"""weights in a centre's cost besides the largest share: the mean share, decades of condition, and offset"""
LESS = 1e-9
"""of a cost: by what a centre must be better, so that none is chosen for its round-off"""
SMALLER, ROUNDS_OF_FITTING = 0.7, 40


class WorkableReference(NamedTuple):
    """A reference, and the shares of the torque limits that it asks for."""

    reference: Reference
    static: Array
    """(r,) share of the torque limits that gravity and Coulomb friction ask at its centre"""
    asked: Array
    """(r,) largest share of the torque limits that following it asks"""
    reduced: Array
    """(r,) amplitude over the one that positions and speeds would allow"""


def workable_reference(mechanism: Mechanism, limits: Array, seed: int) -> WorkableReference:
    """A reference of sinusoids within TORQUE_SHARE of the torque limits (r,), about a centre where gravity asks little.

    Joints that ask for more, be it that gravity does, are moved less until they are halfway between that and their
    limit. Frequencies and amplitudes are drawn by seed.
    """
    rng = np.random.default_rng(seed)
    lower, upper = motion_ranges(mechanism)
    center = _center(mechanism, limits, rng)
    fastest = np.array([joint.limits.velocity for joint in mechanism.primary_joints])
    frequency = rng.uniform(*FREQUENCIES, mechanism.dof)
    slope = 2.0 * np.pi * frequency + FADE_SLOPE / START_TIME
    room = ROOM_SHARE * np.minimum(center - lower, upper - center)
    largest = np.minimum(np.minimum(AMPLITUDE, room), SPEED_SHARE * fastest / slope)
    amplitude = largest * rng.uniform(0.5, 1.0, mechanism.dof)
    static = _static(mechanism, center) / limits
    return _fitted(mechanism, limits, static, Sinusoids(center, amplitude, frequency, start_time=START_TIME))


def judged_reference(mechanism: Mechanism, limits: Array, reference: Reference) -> WorkableReference:
    """The reference given, and the shares of the torque limits that it asks for."""
    center = reference(np.zeros(1)).p[0]
    asked = _asked(mechanism, limits, reference)
    return WorkableReference(reference, _static(mechanism, center) / limits, asked, np.ones(mechanism.dof))


def _fitted(mechanism: Mechanism, limits: Array, static: Array, drawn: Sinusoids) -> WorkableReference:
    """The drawn reference, joints moved less until none asks for more than its share."""
    allowed, scale = np.maximum(TORQUE_SHARE, 0.5 * (1.0 + static)), np.ones(mechanism.dof)
    for _ in range(ROUNDS_OF_FITTING):
        reference = Sinusoids(drawn.center, scale * drawn.amplitude, drawn.frequency, start_time=START_TIME)
        asked = _asked(mechanism, limits, reference)
        over = asked > allowed
        if not over.any():
            break
        scale = scale * np.where(over, SMALLER, 0.95)
    return WorkableReference(reference, static, asked, scale)


def _asked(mechanism: Mechanism, limits: Array, reference: Reference) -> Array:
    """Largest share (r,) of the limits along a reference; infinite where loops cannot follow it."""
    points = reference(np.linspace(0.0, HORIZON, TIMES))
    if mechanism.continuation is not None:
        inside = mechanism.description.within_conditions(points.p).all()
        if not (inside and mechanism.continuation.reachable(points.p[::4]).all()):
            return np.full(mechanism.dof, np.inf)
    return np.asarray(np.abs(mechanism.inverse_dynamics(points.p, points.v, points.a)).max(axis=0) / limits)


def _static(mechanism: Mechanism, center: Array) -> Array:
    """Torque (r,) of gravity, and of Coulomb friction at full, at rest."""
    rest = np.zeros_like(center)
    coulomb = np.array([joint.drive.coulomb or 0.0 for joint in mechanism.primary_joints])
    return np.asarray(np.abs(mechanism.inverse_dynamics(center, rest, rest)) + coulomb)


def _center(mechanism: Mechanism, limits: Array, rng: np.random.Generator) -> Array:
    """Posture (r,) of the least cost: random ones first, then random ones near the best."""
    lower, upper = motion_ranges(mechanism)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    spread = rng.uniform(-1.0, 1.0, (SAMPLES, mechanism.dof)) * rng.uniform(0.0, INNER, (SAMPLES, 1))
    candidates = np.concatenate((middle[None], middle + half * spread))
    if mechanism.continuation is not None:
        near_home = mechanism.home + 0.3 * half * spread
        candidates = np.concatenate((mechanism.home[None], np.clip(near_home, lower, upper)))
        candidates = candidates[mechanism.description.within_conditions(candidates)]
        candidates = candidates[mechanism.continuation.reachable(candidates)]
    costs = _costs(mechanism, limits, candidates, middle, half)
    best, least, step = candidates[costs.argmin()], costs.min(), 0.3
    for _ in range(ROUNDS if mechanism.continuation is None else 0):
        moved = rng.random((NEAR, mechanism.dof)) < max(0.3, 2.0 / mechanism.dof)
        near = best + step * half * rng.normal(size=moved.shape) * moved
        near = np.clip(near, middle - 0.9 * half, middle + 0.9 * half)
        costs = _costs(mechanism, limits, near, middle, half)
        if costs.min() < least - LESS:
            best, least = near[costs.argmin()], costs.min()
        else:
            step *= 0.8
    return np.asarray(best)


def _costs(mechanism: Mechanism, limits: Array, p: Array, middle: Array, half: Array) -> Array:
    """Costs (n,) of postures (n, r): what gravity asks, how coupled the joints are, how far from mid-range."""
    rest = np.zeros_like(p)
    shares = np.abs(mechanism.inverse_dynamics(p, rest, rest)) / limits
    M = mechanism.mass_matrix(p)
    root = np.sqrt(np.maximum(np.diagonal(M, axis1=1, axis2=2), 1e-300))
    least = np.linalg.eigvalsh(M / root[:, :, None] / root[:, None, :])[:, 0]
    decades = -np.log10(np.maximum(least, 1e-9))
    away = (((p - middle) / np.maximum(half, 1e-9)) ** 2).mean(axis=1)
    return np.asarray(shares.max(axis=1) + EVEN * shares.mean(axis=1) + COUPLED * decades + AWAY * away)
