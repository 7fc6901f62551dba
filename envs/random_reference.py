"""Trajectories nobody chose: sinusoids within the limits of any mechanism."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from adaptctl.control.controller import Reference
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.mechanism import Joint
from adaptctl.mechanism.pose import Array

Trajectory: TypeAlias = Reference | int | str | None
"""A reference, the seed of a random one, or "random" or None for a new one each time."""

AMPLITUDE = 0.5
"""Greatest swing about the centre, rad or m, where the limits allow it."""
FREQUENCIES = (0.1, 0.25)
"""Hz"""
SHARE = 0.8
"""The share of a position range and of a velocity limit that is used."""
ROOM = 0.1
"""rad or m that loops must leave around a reference, for the tracking error."""
BOX_SAMPLES = 64
START_TIME = 2.0
"""Length of the smooth start, s."""
FADE_SLOPE = 1.875
"""Greatest slope of the quintic fade from 0 to 1 over unit time."""


def drawn(trajectory: Trajectory, mechanism: Mechanism, rng: np.random.Generator) -> Reference:
    """The reference meant; a new random one is drawn from `rng`. Raises `InputError` when none is meant."""
    if trajectory is None or (isinstance(trajectory, str) and trajectory == "random"):
        return random_sinusoids(mechanism, rng)
    if isinstance(trajectory, int | np.integer) and trajectory >= 0:
        return random_sinusoids(mechanism, np.random.default_rng(int(trajectory)))
    if callable(trajectory):
        return trajectory
    raise InputError(f"trajectory: expected a Reference, a seed of at least 0, or 'random', got {trajectory!r}")


def random_sinusoids(mechanism: Mechanism, rng: np.random.Generator) -> Sinusoids:
    """One sinusoid a joint about a random centre, within the position and velocity limits.

    An unlimited joint moves within 2 AMPLITUDE of zero, or of its only bound. A mechanism with loops stays where
    they can be followed and within its conditions.
    """
    lower, upper = np.array([_range(joint) for joint in mechanism.primary_joints]).T
    fastest = np.array([joint.limits.velocity for joint in mechanism.primary_joints])
    middle, reach = 0.5 * (lower + upper), 0.5 * SHARE * (upper - lower)
    frequency = rng.uniform(*FREQUENCIES, mechanism.dof)
    largest = np.minimum(np.minimum(AMPLITUDE, reach), SHARE * fastest / _unit_speed(frequency))
    amplitude = largest * rng.uniform(0.5, 1.0, mechanism.dof)
    center = middle + (reach - amplitude) * rng.uniform(-1.0, 1.0, mechanism.dof)
    return _where_loops_allow(mechanism, Sinusoids(center, amplitude, frequency, start_time=START_TIME))


def _where_loops_allow(mechanism: Mechanism, reference: Sinusoids) -> Sinusoids:
    """The reference itself where all its path can be reached, else drawn in towards the loops' own reference.

    Nothing changes for a tree. The box of centre and amplitude is tried at its corners and inside.
    """
    if mechanism.continuation is None:
        return reference
    home, amplitude = mechanism.continuation.reference[mechanism.continuation.primary], reference.amplitude[0]
    box = np.random.default_rng(0).uniform(-1.0, 1.0, (BOX_SAMPLES, mechanism.dof))
    box[: BOX_SAMPLES // 2] = np.sign(box[: BOX_SAMPLES // 2])
    for share in SHARE ** np.arange(30):
        center = home + share * (reference.center - home)
        p = center + (share * amplitude + ROOM) * box
        if mechanism.description.within_conditions(p).all() and mechanism.continuation.reachable(p).all():
            return Sinusoids(center, share * amplitude, reference.frequency[0], start_time=START_TIME)
    raise InputError(f"{mechanism.name}: no reference fits: its loops allow hardly any motion about their reference")


def _range(joint: Joint) -> tuple[float, float]:
    lower, upper, width = joint.limits.lower, joint.limits.upper, 2.0 * AMPLITUDE
    if np.isinf(lower):
        lower = -width if np.isinf(upper) else upper - 2.0 * width
    return lower, lower + 2.0 * width if np.isinf(upper) else upper


def _unit_speed(frequency: Array) -> Array:
    """A bound on the speed of a sinusoid of unit amplitude, its fading in included."""
    return 2.0 * np.pi * frequency + FADE_SLOPE / START_TIME
