"""Feasible references."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference
from adaptctl.control.gains.workspace import MAX_RANGE, reachable
from adaptctl.control.references import Sinusoids, validate_reference
from adaptctl.description import Joint
from adaptctl.dynamics import Mechanism

MAX_AMPLITUDE = 0.5  # rad (m)
FREQUENCIES = (0.1, 0.25)  # Hz
START_TIME = 2.0  # s of the fade-in
FADE_SLOPE = 1.875  # largest slope of a quintic from 0 to 1


def motion_range(joint: Joint) -> tuple[float, float]:
    """Least and greatest position of a joint, rad (m)."""
    lower, upper, width = joint.limits.lower, joint.limits.upper, 2.0 * MAX_AMPLITUDE
    if upper - lower > MAX_RANGE:
        lower, upper = (x if abs(x) < MAX_RANGE else np.copysign(np.inf, x) for x in (lower, upper))
    if np.isinf(lower):
        lower = -width if np.isinf(upper) else upper - 2.0 * width
    return lower, lower + 2.0 * width if np.isinf(upper) else upper


def motion_ranges(mechanism: Mechanism) -> tuple[Array, Array]:
    """Least and greatest positions (r,)."""
    lower, upper = np.array([motion_range(joint) for joint in mechanism.primary_joints]).T
    return lower, upper


def coulomb_friction(mechanism: Mechanism) -> Array:
    """Coulomb friction (r,) of the primary joints in the file, N m (N)."""
    return np.array([joint.drive.coulomb or 0.0 for joint in mechanism.primary_joints])


def random_swing(
    mechanism: Mechanism, room: Array, speed_share: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Random frequencies, Hz, and amplitudes, rad (m), (r,)."""
    fastest = np.array([joint.limits.velocity for joint in mechanism.primary_joints])
    frequency = rng.uniform(*FREQUENCIES, mechanism.dof)
    slope = 2.0 * np.pi * frequency + FADE_SLOPE / START_TIME
    largest = np.minimum(np.minimum(MAX_AMPLITUDE, room), speed_share * fastest / slope)
    return frequency, largest * rng.uniform(0.5, 1.0, mechanism.dof)


TORQUE_SHARE, SPEED_SHARE, ROOM_SHARE = 0.6, 0.6, 0.8  # of torque limits, velocity limits, and room for motion
RANDOM_CENTERS, DESCENT_STEPS = 200, 8
CENTER_RANGE, DESCENT_RANGE, LOOP_RANGE = 0.8, 0.9, 0.3  # of the position ranges; the last about the home of loops
SLOPE_STEP, CENTER_DIGITS = 1e-6, 3  # of half a range
HORIZON, TIME_SAMPLES = 20.0, 201  # s of the reference
MAX_NORM_POWER = 8  # of the norm that approximates the largest share
TYPICAL_LOAD_WEIGHT, CONDITION_WEIGHT, OFFSET_WEIGHT = 0.1, 0.03, 0.1  # of a centre's cost, the second per decade
OVERLOADED_SHRINKAGE, OTHERS_SHRINKAGE, FITTING_ROUNDS = 0.7, 0.95, 40
MIN_AMPLITUDE_SHARE = 0.05  # an overloaded joint that moves less is loaded by the others
MAX_TORQUE_SHARE = 0.95


class FeasibleReference(NamedTuple):
    """Reference, static and peak shares (r,) of torque limits, and reduced amplitudes."""

    reference: Reference
    static: Array
    asked: Array
    reduced: Array


def feasible_reference(mechanism: Mechanism, limits: Array, seed: int) -> FeasibleReference:
    """Sinusoids within 60 % of the torque limits, or more where rest needs it."""
    rng = np.random.default_rng(seed)
    lower, upper = motion_ranges(mechanism)
    center = _center(mechanism, limits, rng)
    room = ROOM_SHARE * np.minimum(center - lower, upper - center)
    frequency, amplitude = random_swing(mechanism, room, SPEED_SHARE, rng)
    static = _static(mechanism, limits, center)
    return _scaled_to_limits(mechanism, limits, static, Sinusoids(center, amplitude, frequency, start_time=START_TIME))


def judged_reference(mechanism: Mechanism, limits: Array, reference: Reference) -> FeasibleReference:
    """Given reference with its torque shares."""
    validate_reference(reference)
    center = reference(np.zeros(1)).p[0]
    asked = _peak_shares(mechanism, limits, reference)
    return FeasibleReference(reference, _static(mechanism, limits, center).sum(axis=0), asked, np.ones(mechanism.dof))


def _scaled_to_limits(mechanism: Mechanism, limits: Array, parts: Array, drawn: Sinusoids) -> FeasibleReference:
    """Drawn reference with reduced amplitudes."""
    static = parts.sum(axis=0)
    allowed = np.clip(0.5 * (1.0 + static), TORQUE_SHARE, MAX_TORQUE_SHARE)
    scale = np.where(parts[0] < allowed, 1.0, 0.0)
    for _ in range(FITTING_ROUNDS):
        reference = Sinusoids(drawn.center, scale * drawn.amplitude, drawn.frequency, start_time=START_TIME)
        asked = _peak_shares(mechanism, limits, reference)
        over = (asked > allowed) & (scale > 0.0)
        if not over.any():
            break
        others = OTHERS_SHRINKAGE if scale[over].min() > MIN_AMPLITUDE_SHARE else OVERLOADED_SHRINKAGE
        scale = scale * np.where(over, OVERLOADED_SHRINKAGE, others)
    return FeasibleReference(reference, static, asked, scale)


def _peak_shares(mechanism: Mechanism, limits: Array, reference: Reference) -> Array:
    """Largest torque shares (r,), infinite where loops do not close."""
    points = reference(np.linspace(0.0, HORIZON, TIME_SAMPLES))
    if mechanism.continuation is not None:
        inside = mechanism.description.within_conditions(points.p).all()
        if not (inside and mechanism.continuation.reachable(points.p[::4]).all()):
            return np.full(mechanism.dof, np.inf)
    return np.asarray(np.abs(mechanism.inverse_dynamics(points.p, points.v, points.a)).max(axis=0) / limits)


def _static(mechanism: Mechanism, limits: Array, center: Array) -> Array:
    """Shares (2, r) of gravity and Coulomb friction."""
    rest = np.zeros((1, mechanism.dof))
    gravity = np.abs(mechanism.inverse_dynamics(center[None], rest, rest))[0]
    return np.stack((gravity, coulomb_friction(mechanism))) / limits


def _center(mechanism: Mechanism, limits: Array, rng: np.random.Generator) -> Array:
    """Posture (r,) of least cost."""
    lower, upper = motion_ranges(mechanism)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    offsets = rng.uniform(-1.0, 1.0, (RANDOM_CENTERS, mechanism.dof)) * rng.uniform(
        0.0, CENTER_RANGE, (RANDOM_CENTERS, 1)
    )
    closed = mechanism.description.closed
    if closed:
        first = mechanism.neutral_configuration
        candidates = np.clip(first + LOOP_RANGE * half * offsets, lower, upper)
        candidates = candidates[reachable(mechanism, candidates)]
    else:
        first, candidates = middle, middle + half * offsets
    best = _cheapest(mechanism, limits, np.concatenate((first[None], candidates)), middle, half)
    if closed:
        return best
    below = _downhill(mechanism, limits, best, middle, half)
    return _cheapest(mechanism, limits, np.stack((best, below)), middle, half)


def _cheapest(mechanism: Mechanism, limits: Array, postures: Array, middle: Array, half: Array) -> Array:
    return np.asarray(postures[_costs(mechanism, limits, postures, middle, half).argmin()])


def _downhill(mechanism: Mechanism, limits: Array, start: Array, middle: Array, half: Array) -> Array:
    """Posture (r,) of less gravity, rounded to be reproducible."""
    moves = SLOPE_STEP * np.concatenate((np.zeros((1, mechanism.dof)), np.eye(mechanism.dof)))

    def load(offset: Array) -> tuple[float, Array]:
        found = _loads(mechanism, limits, middle + half * (offset + moves), middle, half)
        return float(found[0]), (found[1:] - found[0]) / SLOPE_STEP

    from scipy.optimize import minimize  # takes longer to load than many an experiment that never needs it

    inside = [(-DESCENT_RANGE, DESCENT_RANGE)] * mechanism.dof
    given: dict[str, Any] = {"jac": True, "method": "L-BFGS-B", "bounds": inside, "options": {"maxiter": DESCENT_STEPS}}
    found = minimize(load, (start - middle) / np.maximum(half, 1e-9), **given)
    return np.asarray(middle + half * np.round(found.x, CENTER_DIGITS))


def _costs(mechanism: Mechanism, limits: Array, p: Array, middle: Array, half: Array) -> Array:
    """Costs (n,): gravity, distance from mid-range, coupling."""
    M = mechanism.mass_matrix(p)
    root = np.sqrt(np.maximum(np.diagonal(M, axis1=1, axis2=2), 1e-300))
    least = np.linalg.eigvalsh(M / root[:, :, None] / root[:, None, :])[:, 0]
    decades = -np.log10(np.maximum(least, 1e-9))
    return _loads(mechanism, limits, p, middle, half) + CONDITION_WEIGHT * decades


def _loads(mechanism: Mechanism, limits: Array, p: Array, middle: Array, half: Array) -> Array:
    """Smooth part of the costs (n,)."""
    rest = np.zeros_like(p)
    shares = mechanism.inverse_dynamics(p, rest, rest) / limits
    largest = (shares**MAX_NORM_POWER).sum(axis=1) ** (1.0 / MAX_NORM_POWER)
    typical = np.sqrt((shares**2).mean(axis=1))
    away = (((p - middle) / np.maximum(half, 1e-9)) ** 2).mean(axis=1)
    return np.asarray(largest + TYPICAL_LOAD_WEIGHT * typical + OFFSET_WEIGHT * away)
