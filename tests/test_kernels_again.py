"""Arrays of results that kernels return again: only once nobody holds them, in any way, and as new."""

from __future__ import annotations

import copy
import gc
import sys
import threading
import tracemalloc
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adaptctl.compilation import Kernel, compile_function
from adaptctl.scalars import Column

N = 4
pytestmark = [
    pytest.mark.usefixtures("optimized"),
    pytest.mark.skipif(sys.implementation.name != "cpython", reason="kernels are built-in functions of CPython alone"),
]


def doubled(x: Column) -> list[Column]:
    return [x + x, x * x]


@pytest.fixture
def kernel() -> Kernel:
    return compile_function(doubled, {"x": N}, name="doubled")


@pytest.fixture
def pair() -> Kernel:
    return compile_function(lambda x: (x + x, x[0], x * x), {"x": N}, name="pair")


def expected(x: Any) -> Any:
    return np.array([x + x, x * x])


def place(array: Any) -> int:
    return int(array.ctypes.data)


def test_what_nobody_holds_is_returned_again(kernel: Kernel) -> None:
    places = {place(kernel.call(np.full(N, float(k)))) for k in range(50)}
    assert len(places) == 1
    places, result = set(), None
    for k in range(50):
        result = kernel.call(np.full(N, float(k)))
        places.add(place(result))
    assert len(places) == 2


@given(st.lists(st.integers(0, 5), min_size=1, max_size=60))
def test_what_is_held_stays(steps: list[int]) -> None:
    """Results that are kept, and dropped, in any order: none of those kept changes, and no two share memory."""
    kernel = compile_function(doubled, {"x": N}, name="doubled")
    held: list[tuple[Any, Any]] = []
    for k, drop in enumerate(steps):
        x = np.arange(N) + float(k)
        held.append((kernel.call(x), x))
        if drop < len(held):
            del held[drop]
    for result, x in held:
        np.testing.assert_array_equal(result, expected(x))
    assert len({place(result) for result, _ in held}) == len(held)


HELD: dict[str, Callable[[Any], Any]] = {
    "a view": lambda r: r[1],
    "a transpose": lambda r: r.T,
    "a memoryview": memoryview,
    "an iterator": lambda r: iter(r.flat),
    "a strided view": lambda r: np.lib.stride_tricks.as_strided(r, (3,), (8,)),
    "an array of its interface": lambda r: np.asarray(memoryview(r)),
    "a pointer": lambda r: r.ctypes,
    "a capsule": lambda r: np.from_dlpack(r),
}


@pytest.mark.parametrize("hold", HELD.values(), ids=HELD)
def test_what_is_held_in_part_stays(kernel: Kernel, hold: Callable[[Any], Any]) -> None:
    result = kernel.call(np.ones(N))
    at, part = place(result), hold(result)
    del result
    for k in range(5):
        assert place(kernel.call(np.full(N, float(k)))) != at
    assert part is not None


CHANGED: dict[str, Callable[[Any], Any]] = {
    "read only": lambda r: r.setflags(write=False),
    "of another shape": lambda r: setattr(r, "shape", (N, 2)),
    "of another type": lambda r: setattr(r, "dtype", np.int64),
}


@pytest.mark.parametrize("change", CHANGED.values(), ids=CHANGED)
@pytest.mark.filterwarnings("ignore:Setting the:DeprecationWarning")
def test_what_was_changed_is_not_returned_again(kernel: Kernel, change: Callable[[Any], Any]) -> None:
    result = kernel.call(np.ones(N))
    change(result)
    del result
    x = np.arange(float(N))
    for _ in range(5):
        again = kernel.call(x)
        assert (again.shape, again.dtype, again.flags.writeable) == ((2, N), np.dtype(float), True)
        np.testing.assert_array_equal(again, expected(x))


def test_whoever_watches_a_result_sees_no_other(kernel: Kernel) -> None:
    result = kernel.call(np.ones(N))
    watched, at = weakref.ref(result), place(result)
    del result
    for _ in range(5):
        assert place(kernel.call(np.ones(N))) != at or watched() is None


def test_each_result_of_a_tuple_is_by_itself(pair: Kernel) -> None:
    x, y = np.arange(float(N)), np.full(N, 7.0)
    total, _, product = pair.call(x)
    del total
    for _ in range(5):
        pair.call(y)
    np.testing.assert_array_equal(product, x * x)


def test_a_result_may_be_what_is_given_next() -> None:
    grown = compile_function(lambda x: 2.0 * Column((*x.of[1:], x[0])), {"x": N}, name="grown").call
    x = np.array([1.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(grown(grown(grown(grown(x)))), 16.0 * x)
    for _ in range(4):
        x = grown(x)
    np.testing.assert_array_equal(x, 16.0 * np.array([1.0, 2.0, 3.0, 4.0]))


def test_threads_have_their_own(kernel: Kernel) -> None:
    wrong: list[Any] = []

    def work(seed: int) -> None:
        for k in range(2000):
            x = np.full(N, float(1000 * seed + k))
            result = kernel.call(x)
            if not np.array_equal(copy.copy(result), expected(x)):
                wrong.append((seed, k))

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_what_is_kept_goes_with_the_kernel() -> None:
    kernel = compile_function(doubled, {"x": N}, name="doubled")
    watched = [weakref.ref(kernel.call(np.ones(N))) for _ in range(1)]
    held = [kernel.call(np.full(N, float(k))) for k in range(10)]
    watched += map(weakref.ref, held)
    del held, kernel
    gc.collect()
    assert [one() for one in watched] == [None] * 11


def test_nothing_piles_up(kernel: Kernel) -> None:
    call, x = kernel.call, np.ones(N)

    def work() -> None:
        held: list[Any] = []
        for _ in range(300):
            held.append(call(x))
            held[-1].setflags(write=len(held) % 3 > 0)
            if len(held) % 7 == 0:
                held.clear()

    work()
    tracemalloc.start()
    start = tracemalloc.get_traced_memory()[0]
    for _ in range(10):
        work()
    assert tracemalloc.get_traced_memory()[0] - start < 2_000
    tracemalloc.stop()
