"""The rank of a matrix by the largest gap in its spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from adaptctl.errors import InputError
from adaptctl.mechanism.pose import Array

FLOOR = 1e-15
"""Of the largest: singular values below are round-off and say nothing by their ratios."""


ONE_THREAD = 8192
"""Entries of a matrix up to which OpenBLAS stays in one thread, in all that QR does."""


@dataclass(frozen=True)
class NumericalRank:
    """`rank` k, the `gap` sigma_k/sigma_k+1 there, and `smallest`, sigma_k/sigma_1."""

    rank: int
    gap: float
    smallest: float

    @classmethod
    def of(cls, singular_values: ArrayLike) -> NumericalRank:
        """k at the largest ratio sigma_k/sigma_k+1, ratios to sigma_1 floored; full rank is possible too."""
        values = np.asarray(singular_values, dtype=np.float64)
        if values.size == 0 or values[0] <= 0.0:
            raise InputError("the rank of a matrix that is empty or zero cannot be decided by a gap")
        relative = np.maximum(np.append(values / values[0], 0.0), FLOOR)
        ratios = relative[:-1] / relative[1:]
        k = int(np.argmax(ratios)) + 1
        return cls(k, float(ratios[k - 1]), float(relative[k - 1]))


def triangle(matrix: Array) -> Array:
    """R of the QR factors, which has the same singular values and right vectors; the matrix itself unless it is tall.

    Long mechanisms are factored ten times faster so: their regressors lack rank, and the singular value
    decomposition of a tall matrix dwells on that. Of a tall but small matrix it is made a part at a time: OpenBLAS
    calls all processors for more, which then takes 0.1 s instead of 0.1 ms whenever one of them is busy.
    """
    rows, columns = matrix.shape
    if rows <= columns:
        return matrix
    step = ONE_THREAD // max(columns, 1) - columns
    if step < columns:
        return _factored(matrix)
    R = matrix[:columns]
    for begin in range(columns, rows, step):
        R = _factored(np.concatenate([R, matrix[begin : begin + step]]))
    return R


def _factored(matrix: Array) -> Array:
    return np.asarray(np.linalg.qr(matrix, mode="r"), dtype=np.float64)


def singular_values(matrix: Array) -> Array:
    """The singular values, falling, one for each column: zeros where there are fewer rows."""
    values = np.linalg.svd(triangle(matrix), compute_uv=False)
    return np.pad(values, (0, matrix.shape[1] - len(values)))


def right_vectors(matrix: Array) -> Array:
    """All right singular vectors (n, n) of a matrix (m, n), a vector a column, however few its rows.

    Small ones by QR iterations, which OpenBLAS leaves in one thread; divide and conquer, faster for large ones, it
    does not.
    """
    R = triangle(matrix)
    if R.size > ONE_THREAD:
        return np.asarray(np.linalg.svd(R)[2].T, dtype=np.float64)
    return np.asarray(scipy.linalg.svd(R, lapack_driver="gesvd")[2].T, dtype=np.float64)
