"""Small factorisations without the threads of OpenBLAS, which cost far more than they save there."""

from __future__ import annotations

import ctypes
import functools
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from adaptctl.mechanism.pose import Array

SMALL = 2**16
"""Entries of a matrix below which one thread is enough: up to some milliseconds of work."""


@contextmanager
def one_thread_if_small(matrix: Array) -> Iterator[None]:
    """The linear algebra within in one thread of OpenBLAS, if it is about a small matrix.

    For any matrix of some size OpenBLAS wakes a thread for every processor, and waits for each in a loop: where one is
    busy with something else, 0.1 s instead of 0.1 ms. Linear algebra of other threads is in one thread for so long too.
    """
    openblas = _openblas() if matrix.size < SMALL else None
    if openblas is None:
        yield
        return
    with openblas.turn:
        before = openblas.threads()
        openblas.set_threads(1)
        try:
            yield
        finally:
            openblas.set_threads(before)


class _OpenBLAS(NamedTuple):
    """Its number of threads, asked and set, by one of ours at a `turn`, so that the number before comes back."""

    threads: Callable[[], int]
    set_threads: Callable[[int], None]
    turn: threading.RLock


@functools.cache
def _openblas() -> _OpenBLAS | None:
    """What NumPy's wheels bring; None where NumPy uses another library."""
    numpy = ctypes.CDLL(np._core._multiarray_umath.__file__)  # type: ignore[attr-defined]
    name = "scipy_openblas_{}_num_threads64_"
    if not hasattr(numpy, name.format("set")):
        return None
    turn = threading.RLock()
    os.register_at_fork(before=turn.acquire, after_in_parent=turn.release, after_in_child=turn.release)
    return _OpenBLAS(getattr(numpy, name.format("get")), getattr(numpy, name.format("set")), turn)
