"""Ranges of the primary joints within which closed loops stay away from singularities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.control.excitation.excitation_trajectory import MotionLimits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError

# Least singular value of the closure Jacobian, relative to the reference's, that a motion keeps: twice what is refused.
LEAST_REGULARITY = 0.1
# Samples of the whole range, and of a box that is judged; how much smaller a box is that fails, and how often.
SAMPLES, JUDGED, SHRINKAGE, MAX_ROUNDS = 3000, 1000, 0.95, 60
# How far samples reach beyond the sides of a box, over its width, to be put onto them.
FACES = 0.5


def keeps_regular(mechanism: Mechanism, p: Array) -> NDArray[np.bool_]:
    """Mask (n,) of positions (n, r) that loops reach from their reference, clear of singularities."""
    inside = mechanism.description.within_conditions(p)
    loops = mechanism.continuation
    return inside if loops is None else inside & (loops.progress(p, LEAST_REGULARITY) >= 1.0)


def regular_limits(mechanism: Mechanism, limits: MotionLimits, seed: int = 0) -> MotionLimits:
    """Limits whose positions are a box about the reference of the loops, without singularities in it."""
    loops = mechanism.continuation
    if loops is None:
        return limits
    rng, home = np.random.default_rng(seed), loops.reference[loops.primary]
    home = np.clip(home, limits.lower, limits.upper)
    lower, upper = _box(mechanism, home, limits.lower.copy(), limits.upper.copy(), rng)
    for _ in range(MAX_ROUNDS):
        if keeps_regular(mechanism, lower + (upper - lower) * _filling(rng, len(home))).all():
            return replace(limits, lower=lower, upper=upper)
        lower, upper = home + SHRINKAGE * (lower - home), home + SHRINKAGE * (upper - home)
    raise InputError(
        f"{mechanism.name}: its loops are near a singularity everywhere about their reference; give another reference"
    )


def _filling(rng: np.random.Generator, dof: int) -> Array:
    """Points (n, r) of a unit cube, most of them on its faces, edges and corners, where it is lost first."""
    return np.asarray(np.clip(rng.uniform(-FACES, 1.0 + FACES, size=(JUDGED, dof)), 0.0, 1.0))


def _box(
    mechanism: Mechanism, home: Array, lower: Array, upper: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Box that has none of the irregular samples, each cut off where the least of the box is lost."""
    p = np.concatenate([rng.uniform(lower, upper, size=(SAMPLES, len(home))), *_axes(home, lower, upper)])
    bad = p[~keeps_regular(mechanism, p)]
    while len(bad := bad[np.all((bad > lower) & (bad < upper), axis=1)]):
        nearest = bad[np.argmin(np.max(np.abs(bad - home) / (upper - lower), axis=1))]
        lost = np.where(nearest > home, upper - nearest, nearest - lower) / (upper - lower)
        lost[nearest == home] = np.inf
        j = int(np.argmin(lost))
        if nearest[j] > home[j]:
            upper[j] = nearest[j]
        else:
            lower[j] = nearest[j]
    return lower, upper


def _axes(home: Array, lower: Array, upper: Array) -> list[Array]:
    """Positions (100, r) along each joint's range alone."""
    found = []
    for j in range(len(home)):
        line = np.tile(home, (100, 1))
        line[:, j] = np.linspace(lower[j], upper[j], 100)
        found.append(line)
    return found
