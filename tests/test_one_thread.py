"""Factorisations keep the libraries below to one thread, and leave their numbers of threads as they were."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from adaptctl.identifiability.factorisation import _libraries, one_thread


def threads() -> list[int]:
    """Of each library that was there when first asked, NumPy's among them; others are loaded by others."""
    return [library["num_threads"] for library in _libraries().controller.info() if library["user_api"] == "blas"]


@pytest.fixture
def two_threads() -> Iterator[list[int]]:
    """Two threads, however many processors there are."""
    with _libraries().controller.limit(limits=2, user_api="blas"):
        yield threads()


def test_one_thread_and_the_others_come_back(two_threads: list[int]) -> None:
    assert max(two_threads) == 2
    with one_thread():
        assert max(threads()) == 1
        with one_thread():
            assert max(threads()) == 1
        assert max(threads()) == 1
    assert threads() == two_threads


def test_they_come_back_after_an_error(two_threads: list[int]) -> None:
    with pytest.raises(np.linalg.LinAlgError), one_thread():
        np.linalg.inv(np.zeros((2, 2)))
    assert threads() == two_threads


def test_they_come_back_whoever_takes_turns(two_threads: list[int]) -> None:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)

    def work(_: int) -> None:
        for _ in range(300):
            with one_thread():
                np.linalg.qr(np.eye(10))

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, range(4)))
    sys.setswitchinterval(before)
    assert threads() == two_threads
