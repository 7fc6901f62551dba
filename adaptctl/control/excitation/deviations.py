"""Deviations that least squares leave in parameters."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identifiability.factorisation import triangle

# Floor under the lengths of columns times prior ranges, relative to the longest,
# so that one of round-off alone stays short.
MIN_COLUMN_RATIO = 1e-3
# Share of the largest singular value up to which directions count as not excited. Round-off leaves
# some 1e-16 and a poor motion 1e-3, so that nothing is near the bound; that of the certificates of rank is the same.
UNEXCITED_RATIO = 1e-9
# Component of a parameter in the unexcited directions that counts: they are known to round-off over UNEXCITED_RATIO.
UNEXCITED_COMPONENT = 1e-6


def least_squares_deviations(Y: Array, ranges: Array) -> tuple[float, Array]:
    """Condition number of a scaled regressor (m, k), and the deviations (k,) that least squares leave."""
    R = triangle(Y)  # of the same lengths and singular values, and k rows instead of m
    size = np.linalg.norm(R, axis=0)
    size = np.maximum(size, MIN_COLUMN_RATIO * (size * ranges).max() / ranges)
    size[size == 0.0] = 1.0
    _, values, directions = np.linalg.svd(R / size)
    rank = int(np.sum(values > UNEXCITED_RATIO * values[0]))
    excited, not_excited = directions[:rank], directions[rank:]
    found = np.linalg.norm(excited / values[:rank, None], axis=0) / size
    found[np.linalg.norm(not_excited, axis=0) > UNEXCITED_COMPONENT] = np.inf
    return float(values[0] / values[-1]) if rank == len(size) else np.inf, found
