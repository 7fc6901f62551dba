"""The rank of a matrix by the largest gap in its spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.identifiability.one_thread import one_thread

FLOOR = 1e-15
"""Of the largest: singular values below are round-off and say nothing by their ratios."""


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
    decomposition of a tall matrix dwells on that.
    """
    if matrix.shape[0] <= matrix.shape[1]:
        return matrix
    with one_thread():
        return np.asarray(np.linalg.qr(matrix, mode="r"), dtype=np.float64)


def singular_values(matrix: Array) -> Array:
    """The singular values, falling, one for each column: zeros where there are fewer rows."""
    with one_thread():
        values = np.linalg.svd(triangle(matrix), compute_uv=False)
    return np.pad(values, (0, matrix.shape[1] - len(values)))


def right_vectors(matrix: Array) -> Array:
    """All right singular vectors (n, n) of a matrix (m, n), a vector a column, however few its rows."""
    with one_thread():
        return np.asarray(np.linalg.svd(triangle(matrix))[2].T, dtype=np.float64)
