"""QR factors and singular values of matrices, made in one thread: more cost far more than they save here."""

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
    """The triangular factor R (n, n) of the QR factors of a tall `matrix` (m, n) of m rows, in its unit: it has the
    matrix's singular values and right singular vectors. A matrix of at most n rows is returned as it is. Nothing is
    checked.

    It saves time: a singular value decomposition of R takes a tenth of that of the tall regressor of a long mechanism.
    """
    if matrix.shape[0] <= matrix.shape[1]:
        return matrix
    with one_thread():
        return np.asarray(np.linalg.qr(matrix, mode="r"), dtype=np.float64)


def singular_values(matrix: Array) -> Array:
    """The singular values (n,) of a matrix (m, n), in its unit, in descending order; zeros at the end where m is below
    n. Raises `numpy.linalg.LinAlgError` for NaN or infinity."""
    with one_thread():
        values = np.linalg.svd(triangle(matrix), compute_uv=False)
    return np.pad(values, (0, matrix.shape[1] - len(values)))


def right_vectors(matrix: Array) -> Array:
    """The matrix (n, n) whose columns are the orthonormal right singular vectors of a matrix (m, n), in descending
    order of singular value, n of them also where m is below n. Raises `numpy.linalg.LinAlgError` for NaN or infinity.
    """
    with one_thread():
        return np.asarray(np.linalg.svd(triangle(matrix))[2].T, dtype=np.float64)


@contextmanager
def one_thread() -> Iterator[None]:
    """Context manager in which NumPy's linear algebra runs in one thread; the numbers of threads are as before when it
    ends.

    OpenBLAS otherwise wakes a thread for every processor and waits for each in a loop: where one is busy, small
    matrices take 0.1 s instead of 0.1 ms. The setting is the process's: linear algebra of other threads is limited too,
    and another thread that enters such a context waits until this one has left it.
    """
    libraries = _libraries()
    with libraries.turn, libraries.controller.limit(limits=1, user_api="blas"):
        yield


class _Libraries(NamedTuple):
    """The loaded libraries; one of our threads at a `turn` sets their numbers of threads, so that all come back."""

    controller: ThreadpoolController
    turn: threading.RLock


@functools.cache
def _libraries() -> _Libraries:
    """The libraries that are loaded when first asked for, NumPy's among them."""
    from threadpoolctl import ThreadpoolController  # looks for libraries once it is imported

    turn = threading.RLock()
    os.register_at_fork(before=turn.acquire, after_in_parent=turn.release, after_in_child=turn.release)
    return _Libraries(ThreadpoolController(), turn)
