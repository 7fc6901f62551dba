"""Ranges of the primary joints within which closed loops stay away from singularities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.control.excitation.motion_limits import MotionLimits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError

# Least singular value of the closure Jacobian, relative to the reference's, that a motion keeps: twice what is refused.
LEAST_REGULARITY = 0.1
# Samples of the whole range, and of a box that is judged; how much smaller a box is that fails, and how often.
SAMPLES, JUDGED, SHRINKAGE, MAX_ROUNDS = 3000, 1000, 0.95, 60
# How far samples reach beyond the sides of a box, over its width, to be put onto them.
FACES = 0.5
# Round-off (rad or m) of positions at their limits.
SLACK = 1e-9


def keeps_regular(mechanism: Mechanism, p: Array) -> NDArray[np.bool_]:
    """Mask (n,) of positions (n, r) that loops reach from their reference, clear of singularities."""
    inside = mechanism.description.within_conditions(p)
    loops = mechanism.continuation
    return inside if loops is None else inside & (loops.progress(p, LEAST_REGULARITY) >= 1.0)


def regular_limits(mechanism: Mechanism, limits: MotionLimits, seed: int = 0) -> MotionLimits:
    """
    Limits whose positions are a box about the reference of the loops, without singularities in it.

    Conditions are sides of the box: each is a coordinate, in place of the joint of the widest range times weight.
    """
    loops = mechanism.continuation
    if loops is None:
        return limits
    rng, home = np.random.default_rng(seed), np.clip(loops.reference[loops.primary], limits.lower, limits.upper)
    oblique = _oblique(mechanism, limits)
    axes = np.eye(len(home)) if oblique.axes is None else oblique.axes
    lower, upper = oblique.lower.copy(), oblique.upper.copy()
    home = np.clip(np.linalg.solve(axes, home), lower, upper)

    def keeps(u: Array) -> NDArray[np.bool_]:
        p = u @ axes.T
        inside = np.all((p >= limits.lower - SLACK) & (p <= limits.upper + SLACK), axis=1)
        inside[inside] = keeps_regular(mechanism, p[inside])
        return inside

    lower, upper = _box(keeps, home, lower, upper, rng)
    for _ in range(MAX_ROUNDS):
        if keeps(lower + (upper - lower) * _filling(rng, len(home))).all():
            return replace(oblique, lower=lower, upper=upper)
        lower, upper = home + SHRINKAGE * (lower - home), home + SHRINKAGE * (upper - home)
    raise InputError(
        f"{mechanism.name}: its loops are near a singularity everywhere about their reference; give another reference"
    )


def _oblique(mechanism: Mechanism, limits: MotionLimits) -> MotionLimits:
    """Limits of coordinates of which conditions are some; as they are without conditions."""
    description, lower, upper = mechanism.description, limits.lower.copy(), limits.upper.copy()
    names, rows = [description.joint_names[i] for i in description.primary], np.eye(len(lower))
    for condition in description.loops.conditions if description.loops is not None else ():
        weights = np.array([condition.weights.get(name, 0.0) for name in names])
        j = int(np.argmax(np.abs(weights) * (limits.upper - limits.lower) * (np.count_nonzero(rows, axis=1) == 1)))
        ends = np.sort([weights * limits.lower, weights * limits.upper], axis=0).sum(axis=1)
        least, most = max(condition.lower, ends[0]), min(condition.upper, ends[1])
        changed = rows.copy()
        changed[j] = weights
        if weights[j] != 0.0 and abs(np.linalg.det(changed)) > 0.1 * abs(weights[j]):
            rows, margin = changed, 0.5 * (1.0 - SHRINKAGE) * (most - least)
            lower[j], upper[j] = least + margin, most - margin
    if np.array_equal(rows, np.eye(len(lower))):
        return limits
    axes = np.asarray(np.linalg.inv(rows), dtype=np.float64)
    speeds = np.where(axes != 0.0, (limits.velocity / np.abs(axes).sum(axis=1))[:, None], np.inf).min(axis=0)
    return replace(limits, lower=lower, upper=upper, velocity=speeds, axes=axes)


def _filling(rng: np.random.Generator, dof: int) -> Array:
    """Points (n, r) of a unit cube, most of them on its faces, edges and corners, where it is lost first."""
    return np.asarray(np.clip(rng.uniform(-FACES, 1.0 + FACES, size=(JUDGED, dof)), 0.0, 1.0))


def _box(
    keeps: Callable[[Array], NDArray[np.bool_]], home: Array, lower: Array, upper: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Box that has none of the irregular samples, each cut off where the least of the box is lost."""
    p = np.concatenate([rng.uniform(lower, upper, size=(SAMPLES, len(home))), *_axes(home, lower, upper)])
    bad = p[~keeps(p)]
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
