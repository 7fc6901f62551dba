"""Small factorisations keep OpenBLAS to one thread, and leave its number of threads as it was."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from adaptctl.identifiability.one_thread import SMALL, _openblas, one_thread_if_small

SMALL_ONE, LARGE_ONE = np.eye(10), np.zeros((SMALL, 1))


def threads() -> int:
    """As OpenBLAS tells; 1 where NumPy uses another library, of which nothing is asked."""
    openblas = _openblas()
    return 1 if openblas is None else openblas.threads()


@pytest.fixture
def two_threads() -> Iterator[int]:
    """OpenBLAS with two threads, if it is there, however many processors there are."""
    openblas, before = _openblas(), threads()
    if openblas is not None:
        openblas.set_threads(2)
    yield threads()
    if openblas is not None:
        openblas.set_threads(before)


def test_small_ones_have_one_thread_and_the_others_come_back(two_threads: int) -> None:
    with one_thread_if_small(SMALL_ONE):
        assert threads() == 1
        with one_thread_if_small(SMALL_ONE):
            assert threads() == 1
        assert threads() == 1
    assert threads() == two_threads


def test_large_ones_have_all(two_threads: int) -> None:
    with one_thread_if_small(LARGE_ONE):
        assert threads() == two_threads


def test_they_come_back_after_an_error(two_threads: int) -> None:
    with pytest.raises(np.linalg.LinAlgError), one_thread_if_small(SMALL_ONE):
        np.linalg.inv(np.zeros((2, 2)))
    assert threads() == two_threads


def test_they_come_back_whoever_takes_turns(two_threads: int) -> None:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)

    def work(_: int) -> None:
        for _ in range(300):
            with one_thread_if_small(SMALL_ONE):
                np.linalg.qr(SMALL_ONE)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, range(4)))
    sys.setswitchinterval(before)
    assert threads() == two_threads
