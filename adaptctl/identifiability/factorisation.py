"""QR factors and singular values, made in one thread."""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from adaptctl.arrays import Array

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


def triangle(matrix: Array) -> Array:
    """Triangular factor R (n, n) of a tall matrix."""
    if matrix.shape[0] <= matrix.shape[1]:
        return matrix
    with one_thread():
        return np.asarray(np.linalg.qr(matrix, mode="r"), dtype=np.float64)


def triangle_by_joint(regressor: Array) -> Array:
    """Triangular factor (k, k), or fewer rows, of all rows of a regressor (T, r, k), each without its joint's zeros."""
    parts = []
    for rows in np.moveaxis(regressor, 1, 0):
        own = rows.any(axis=0)
        factor = triangle(rows[:, own])
        parts.append(np.zeros((len(factor), len(own))))
        parts[-1][:, own] = factor
    return triangle(np.concatenate(parts))


def singular_values(matrix: Array) -> Array:
    """Singular values (n,) of a matrix (m, n), descending, zeros at the end if m is below n."""
    with one_thread():
        values = np.linalg.svd(triangle(matrix), compute_uv=False)
    return np.pad(values, (0, matrix.shape[1] - len(values)))


def right_vectors(matrix: Array) -> Array:
    """Orthonormal right singular vectors (n, n), in columns."""
    square = triangle(matrix)
    with one_thread():
        try:
            return np.asarray(np.linalg.svd(square)[2].T, dtype=np.float64)
        except np.linalg.LinAlgError:  # Divide and conquer fails for a few matrices, where QR iterations do not.
            from scipy.linalg import svd

            return np.asarray(svd(square, lapack_driver="gesvd")[2].T, dtype=np.float64)


@contextmanager
def one_thread() -> Iterator[None]:
    """Context with NumPy's linear algebra in one thread, in the whole process."""
    libraries = _libraries()
    with libraries.turn, libraries.controller.limit(limits=1, user_api="blas"):
        yield


class _Libraries(NamedTuple):
    """Loaded libraries."""

    controller: ThreadpoolController
    turn: threading.RLock


@functools.cache
def _libraries() -> _Libraries:
    from threadpoolctl import ThreadpoolController  # looks for libraries once it is imported

    turn = threading.RLock()
    os.register_at_fork(before=turn.acquire, after_in_parent=turn.release, after_in_child=turn.release)
    return _Libraries(ThreadpoolController(), turn)
