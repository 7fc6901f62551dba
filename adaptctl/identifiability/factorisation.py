"""QR factors and singular values of matrices, made in one thread: more cost far more than they save here."""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from threadpoolctl import ThreadpoolController

from adaptctl.arrays import Array


def triangle(matrix: Array) -> Array:
    """The triangular factor R (n, n) of the QR factors of a tall matrix (m, n), which has its singular values and right
    vectors.

    A matrix that is not tall is returned as it is. Long mechanisms are factored ten times faster so: their regressors
    lack rank, and the singular value decomposition of a tall matrix dwells on that.
    """
    if matrix.shape[0] <= matrix.shape[1]:
        return matrix
    with one_thread():
        return np.asarray(np.linalg.qr(matrix, mode="r"), dtype=np.float64)


def singular_values(matrix: Array) -> Array:
    """The singular values (n,) of a matrix (m, n), falling; zeros where there are fewer rows than columns."""
    with one_thread():
        values = np.linalg.svd(triangle(matrix), compute_uv=False)
    return np.pad(values, (0, matrix.shape[1] - len(values)))


def right_vectors(matrix: Array) -> Array:
    """Matrix (n, n) whose columns are the right singular vectors of a matrix (m, n), also where m is below n."""
    with one_thread():
        return np.asarray(np.linalg.svd(triangle(matrix))[2].T, dtype=np.float64)


@contextmanager
def one_thread() -> Iterator[None]:
    """A context in which linear algebra runs in one thread; the numbers of threads come back afterwards.

    OpenBLAS wakes a thread for every processor, and waits for each in a loop: where one is busy with something else,
    0.1 s instead of 0.1 ms, and seconds in all for a robot of many joints. Linear algebra of other threads is in one
    thread for so long too.
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
    turn = threading.RLock()
    os.register_at_fork(before=turn.acquire, after_in_parent=turn.release, after_in_child=turn.release)
    return _Libraries(ThreadpoolController(), turn)
