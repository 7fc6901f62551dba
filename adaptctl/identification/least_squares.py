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
    """The P parameters x (P,) that minimise x^T A x/2 - b^T x over the c of them of zero-based indices `columns` (c,),
    the others being zero. A (P, P) is a normal matrix, b (P,) a moment, ^T the transpose. A is scaled to a diagonal of
    ones; where eigenvalues of it are below 1e-10 of the largest, x is not unique, and the one of least norm in the
    scaled parameters is taken. Raises `ValueError` for numbers that are not finite, `IndexError` where `columns` is
    empty or has an index of P or more."""
    own, wanted = A[np.ix_(columns, columns)], b[columns]
    size = np.sqrt(np.diag(own))
    size[size == 0.0] = 1.0
    values, vectors = eigh(own / np.outer(size, size))
    kept = values > NEGLIGIBLE * values[-1]
    x = np.zeros(len(b))
    x[columns] = vectors[:, kept] @ ((vectors[:, kept].T @ (wanted / size)) / values[kept]) / size
    return x


def weighted_least_squares(equations: NormalEquations, columns: NDArray[np.int64]) -> tuple[Array, Array]:
    """The parameters (P,), SI units, of a weighted least-squares fit and the standard deviations (r,), N m (N for a
    prismatic joint), of the torque residuals of r joints, a pair. Only the c parameters of zero-based indices `columns`
    (c,) are fitted, the others being zero; the joints' equations are weighted by the inverse squares of these
    deviations (Gautier 1997).

    `equations` are normal equations on P parameters. Weights and parameters are found in three rounds. Raises
    `ValueError` for numbers that are not finite, as for equations of no instants, `IndexError` where `columns` is empty
    or has an index of P or more.
    """
    deviations = np.sqrt(equations.square.sum(axis=0) / equations.count.sum())
    x = np.zeros(equations.moment.shape[-1])
    for _ in range(ROUNDS):
        x = least_squares(*equations.whitened(deviations), columns)
        deviations = np.maximum(np.sqrt(equations.misfit(x) / equations.count.sum()), 1e-6 * deviations.max())
    return x, deviations
