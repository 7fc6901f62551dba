"""Trajectories nobody chose: sinusoids within the limits of any mechanism."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from adaptctl.control.controller import Reference
from adaptctl.control.references import Sinusoids
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.mechanism import Link
from adaptctl.mechanism.pose import Array

Trajectory: TypeAlias = Reference | int | str | None
"""A reference, the seed of a random one, or "random" or None for a new one each time."""

AMPLITUDE = 0.5
"""Greatest swing about the centre, rad or m, where the limits allow it."""
FREQUENCIES = (0.1, 0.25)
"""Hz"""
SHARE = 0.8
"""The share of a position range and of a velocity limit that is used."""
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

    An unlimited joint moves within 2 AMPLITUDE of zero, or of its only bound.
    """
    lower, upper = np.array([_range(link) for link in mechanism.links]).T
    fastest = np.array([link.joint.limits.velocity for link in mechanism.links])
    middle, reach = 0.5 * (lower + upper), 0.5 * SHARE * (upper - lower)
    frequency = rng.uniform(*FREQUENCIES, mechanism.dof)
    largest = np.minimum(np.minimum(AMPLITUDE, reach), SHARE * fastest / _unit_speed(frequency))
    amplitude = largest * rng.uniform(0.5, 1.0, mechanism.dof)
    center = middle + (reach - amplitude) * rng.uniform(-1.0, 1.0, mechanism.dof)
    return Sinusoids(center, amplitude, frequency, start_time=START_TIME)


def _range(link: Link) -> tuple[float, float]:
    lower, upper, width = link.joint.limits.lower, link.joint.limits.upper, 2.0 * AMPLITUDE
    if np.isinf(lower):
        lower = -width if np.isinf(upper) else upper - 2.0 * width
    return lower, lower + 2.0 * width if np.isinf(upper) else upper


def _unit_speed(frequency: Array) -> Array:
    """A bound on the speed of a sinusoid of unit amplitude, its fading in included."""
    return 2.0 * np.pi * frequency + FADE_SLOPE / START_TIME
