"""References that a mechanism's motors can follow."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference
from adaptctl.control.gains.workspace import TURNS, reachable
from adaptctl.control.references import Sinusoids
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


TORQUE_SHARE, SPEED_SHARE, ROOM_SHARE = 0.6, 0.6, 0.8
"""of torque limits, of velocity limits and of the room to the position limits"""
SAMPLES, STEPS = 200, 8
"""random centres, and steps downhill from the best of them"""
INNER, OUTER, NEAR_HOME = 0.8, 0.9, 0.3
"""of the position ranges, in which random centres lie, in which steps end, and about the home of closed loops"""
DIFFERENCE, DIGITS = 1e-6, 3
"""of half a range, by which slopes are taken; decimal digits of it that centres have"""
HORIZON, TIMES = 20.0, 201
"""s of the reference that are looked at, and at how many times"""
SHARPNESS, EVEN, COUPLED, AWAY = 8, 0.1, 0.03, 0.1
"""power of the norm that stands for a centre's largest share; weights of the typical share, of decades of condition,
and of the offset from mid-range"""
SMALLER, SLIGHTLY, ROUNDS = 0.7, 0.95, 40
"""times the amplitude of joints that ask for too much, and of the others, in a round of fitting"""
OWN = 0.05
"""of a joint's amplitude: where it asks for too much with less, others are the cause"""
HIGHEST = 0.95
"""of a torque limit, the most that a reference may ask"""


class FeasibleReference(NamedTuple):
    """Record of a reference for r joints, `reference`, and of the fractions of the torque limits that it asks for. All
    are (r,), without a unit. Nothing is checked.

    `static` is the fraction that gravity and Coulomb friction ask for at rest, at the reference's centre (its position
    at time 0 if it was given); `asked` is the peak, at 201 times of the first 20 s of following it, infinite where
    kinematic loops cannot be closed on it; `reduced` is the reference's amplitude over that which positions and speeds
    would allow, 1 where torques did not make it smaller and for a reference that was given.
    """

    reference: Reference
    static: Array
    asked: Array
    reduced: Array


def feasible_reference(mechanism: Mechanism, limits: Array, seed: int) -> FeasibleReference:
    """A `FeasibleReference` for the `mechanism`'s r joints: sinusoids that ask for at most 0.6 of the torque limits, or
    more where rest asks for much, about a centre where gravity asks for little. `limits` (r,) are the torque limits, N
    m (N if prismatic).

    Frequencies, from 0.1 to 0.25 Hz, and amplitudes, up to 0.5 rad (m), are drawn by `seed`, a whole number of at least
    0, the same for equal seeds; the smooth start takes 2 s. Amplitudes are made smaller until each joint asks for at
    most the fraction (1 + x)/2 of its limit, at its peak in the first 20 s, taken as 0.6 if less and as 0.95 if more: x
    is the fraction that gravity and Coulomb friction ask for at rest. A joint of which gravity alone asks more does not
    move. Fitting ends after 40 rounds. Nothing is checked.
    """
    rng = np.random.default_rng(seed)
    lower, upper = motion_ranges(mechanism)
    center = _center(mechanism, limits, rng)
    room = ROOM_SHARE * np.minimum(center - lower, upper - center)
    frequency, amplitude = random_swing(mechanism, room, SPEED_SHARE, rng)
    static = _static(mechanism, limits, center)
    return _fitted(mechanism, limits, static, Sinusoids(center, amplitude, frequency, start_time=START_TIME))


def judged_reference(mechanism: Mechanism, limits: Array, reference: Reference) -> FeasibleReference:
    """A `FeasibleReference` of the `reference` given, for the `mechanism`'s r joints: with the fractions (r,), no unit,
    that it asks for of the torque limits `limits` (r,), N m (N if prismatic). `asked` is the peak, at 201 times of its
    first 20 s, of the magnitude of each joint's torque over its limit, infinite where kinematic loops cannot be closed
    on it; `static` is the same for gravity and Coulomb friction at rest at the position at time 0; `reduced` is ones
    (r,), no amplitude being made smaller. Raises `InputError` where the reference's points do not fit the joints,
    `NonFiniteError` where they are not finite, `SingularityError` where kinematic loops cannot be closed at the
    first."""
    center = reference(np.zeros(1)).p[0]
    asked = _asked(mechanism, limits, reference)
    return FeasibleReference(reference, _static(mechanism, limits, center).sum(axis=0), asked, np.ones(mechanism.dof))


def _fitted(mechanism: Mechanism, limits: Array, parts: Array, drawn: Sinusoids) -> FeasibleReference:
    """The drawn reference, joints moved less until none asks for more than its share; `parts` are of `_static`.

    A joint that gravity alone asks more of is held still, and no other is moved less for its sake.
    """
    static = parts.sum(axis=0)
    allowed = np.clip(0.5 * (1.0 + static), TORQUE_SHARE, HIGHEST)
    scale = np.where(parts[0] < allowed, 1.0, 0.0)
    for _ in range(ROUNDS):
        reference = Sinusoids(drawn.center, scale * drawn.amplitude, drawn.frequency, start_time=START_TIME)
        asked = _asked(mechanism, limits, reference)
        over = (asked > allowed) & (scale > 0.0)
        if not over.any():
            break
        others = SLIGHTLY if scale[over].min() > OWN else SMALLER
        scale = scale * np.where(over, SMALLER, others)
    return FeasibleReference(reference, static, asked, scale)


def _asked(mechanism: Mechanism, limits: Array, reference: Reference) -> Array:
    """Largest share (r,) of the limits along a reference; infinite where loops cannot follow it."""
    points = reference(np.linspace(0.0, HORIZON, TIMES))
    if mechanism.continuation is not None:
        inside = mechanism.description.within_conditions(points.p).all()
        if not (inside and mechanism.continuation.reachable(points.p[::4]).all()):
            return np.full(mechanism.dof, np.inf)
    return np.asarray(np.abs(mechanism.inverse_dynamics(points.p, points.v, points.a)).max(axis=0) / limits)


def _static(mechanism: Mechanism, limits: Array, center: Array) -> Array:
    """Shares (2, r) of the torque limits: of gravity, and of Coulomb friction at full, at rest."""
    rest = np.zeros((1, mechanism.dof))
    gravity = np.abs(mechanism.inverse_dynamics(center[None], rest, rest))[0]
    coulomb = np.array([joint.drive.coulomb or 0.0 for joint in mechanism.primary_joints])
    return np.stack((gravity, coulomb)) / limits


def _center(mechanism: Mechanism, limits: Array, rng: np.random.Generator) -> Array:
    """Posture (r,) of the least cost: the best of random ones, and from there downhill where no loop closes."""
    lower, upper = motion_ranges(mechanism)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    offsets = rng.uniform(-1.0, 1.0, (SAMPLES, mechanism.dof)) * rng.uniform(0.0, INNER, (SAMPLES, 1))
    closed = mechanism.description.closed
    if closed:
        first = mechanism.neutral_configuration
        candidates = np.clip(first + NEAR_HOME * half * offsets, lower, upper)
        candidates = candidates[reachable(mechanism, candidates)]
    else:
        first, candidates = middle, middle + half * offsets
    best = _least(mechanism, limits, np.concatenate((first[None], candidates)), middle, half)
    if closed:
        return best
    below = _downhill(mechanism, limits, best, middle, half)
    return _least(mechanism, limits, np.stack((best, below)), middle, half)


def _least(mechanism: Mechanism, limits: Array, postures: Array, middle: Array, half: Array) -> Array:
    """The posture (r,) of the least cost among (n, r)."""
    return np.asarray(postures[_costs(mechanism, limits, postures, middle, half).argmin()])


def _downhill(mechanism: Mechanism, limits: Array, start: Array, middle: Array, half: Array) -> Array:
    """Posture (r,) where gravity asks less, by quasi-Newton steps within OUTER of the ranges.

    It is rounded, so that it does not depend on the last bits of equations in Python or in native code.
    """
    moves = DIFFERENCE * np.concatenate((np.zeros((1, mechanism.dof)), np.eye(mechanism.dof)))

    def load(offset: Array) -> tuple[float, Array]:
        found = _loads(mechanism, limits, middle + half * (offset + moves), middle, half)
        return float(found[0]), (found[1:] - found[0]) / DIFFERENCE

    from scipy.optimize import minimize  # takes longer to load than many an experiment that never needs it

    inside = [(-OUTER, OUTER)] * mechanism.dof
    given: dict[str, Any] = {"jac": True, "method": "L-BFGS-B", "bounds": inside, "options": {"maxiter": STEPS}}
    found = minimize(load, (start - middle) / np.maximum(half, 1e-9), **given)
    return np.asarray(middle + half * np.round(found.x, DIGITS))


def _costs(mechanism: Mechanism, limits: Array, p: Array, middle: Array, half: Array) -> Array:
    """Costs (n,) of postures (n, r): what gravity asks, how far from mid-range, and how coupled the joints are."""
    M = mechanism.mass_matrix(p)
    root = np.sqrt(np.maximum(np.diagonal(M, axis1=1, axis2=2), 1e-300))
    least = np.linalg.eigvalsh(M / root[:, :, None] / root[:, None, :])[:, 0]
    decades = -np.log10(np.maximum(least, 1e-9))
    return _loads(mechanism, limits, p, middle, half) + COUPLED * decades


def _loads(mechanism: Mechanism, limits: Array, p: Array, middle: Array, half: Array) -> Array:
    """The part of the costs (n,) that is smooth: what gravity asks, and how far postures (n, r) are from mid-range."""
    rest = np.zeros_like(p)
    shares = mechanism.inverse_dynamics(p, rest, rest) / limits
    largest = (shares**SHARPNESS).sum(axis=1) ** (1.0 / SHARPNESS)
    typical = np.sqrt((shares**2).mean(axis=1))
    away = (((p - middle) / np.maximum(half, 1e-9)) ** 2).mean(axis=1)
    return np.asarray(largest + EVEN * typical + AWAY * away)
