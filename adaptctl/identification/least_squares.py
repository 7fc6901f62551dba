"""Weighted least squares on columns that are independent."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from adaptctl.arrays import Array
from adaptctl.identification.normal_equations import NormalEquations

NEGLIGIBLE = 1e-10
"""Of the largest eigenvalue of the scaled normal matrix: what lies below is not determined, and stays zero."""
ROUNDS = 3


def least_squares(A: Array, b: Array, columns: NDArray[np.int64]) -> Array:
    """The parameters x (P,) that minimise x'A x/2 - b'x on some columns, the others zero; the shortest where they are
    not unique."""
    own, wanted = A[np.ix_(columns, columns)], b[columns]
    size = np.sqrt(np.diag(own))
    size[size == 0.0] = 1.0
    values, vectors = eigh(own / np.outer(size, size))
    kept = values > NEGLIGIBLE * values[-1]
    x = np.zeros(len(b))
    x[columns] = vectors[:, kept] @ ((vectors[:, kept].T @ (wanted / size)) / values[kept]) / size
    return x


def weighted_least_squares(equations: NormalEquations, columns: NDArray[np.int64]) -> tuple[Array, Array]:
    """The parameters x (P,), and the joints' standard deviations (r,) by which their equations are weighted (Gautier
    1997)."""
    deviations = np.sqrt(equations.square.sum(axis=0) / equations.count.sum())
    x = np.zeros(equations.moment.shape[-1])
    for _ in range(ROUNDS):
        x = least_squares(*equations.whitened(deviations), columns)
        deviations = np.maximum(np.sqrt(equations.misfit(x) / equations.count.sum()), 1e-6 * deviations.max())
    return x, deviations
