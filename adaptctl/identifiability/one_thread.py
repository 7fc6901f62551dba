"""Small factorisations without the threads of OpenBLAS, which cost far more than they save there."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager

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
    threads = _threads() if matrix.size < SMALL else None
    if threads is None:
        yield
        return
    ask, tell = threads
    before = ask()
    tell(1)
    try:
        yield
    finally:
        tell(before)


@functools.cache
def _threads() -> tuple[Callable[[], int], Callable[[int], None]] | None:
    """What asks for the number of threads and what sets it, in the OpenBLAS of NumPy's wheels; None for others."""
    numpy = ctypes.CDLL(np._core._multiarray_umath.__file__)  # type: ignore[attr-defined]
    name = "scipy_openblas_{}_num_threads64_"
    if not hasattr(numpy, name.format("set")):
        return None
    return getattr(numpy, name.format("get")), getattr(numpy, name.format("set"))
