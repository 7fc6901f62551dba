"""Kernels that put their results into given arrays: the same numbers, no array made, nothing overwritten too soon."""

from __future__ import annotations

import sys
import tracemalloc
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adaptctl import Mechanism, load
from adaptctl.compilation import Kernel, compile_function
from adaptctl.compilation.batch import MIN_STREAMED_BYTES
from adaptctl.dynamics.array_equations import COMPILE_AFTER_CALLS
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column

pytestmark = pytest.mark.usefixtures("optimized")

N = 5


def neighbours(x: Column, y: Column) -> list[Column]:
    """Rows that need entries of x after others of the result have been written, where they are the same memory."""
    turned = Column((*x.of[1:], x[0]))
    return [x + turned, turned * y]


@pytest.fixture(scope="module")
def kernel() -> Kernel:
    return compile_function(neighbours, {"x": N, "y": N}, name="neighbours", finite=True)


@pytest.fixture(scope="module")
def pair() -> Kernel:
    return compile_function(lambda x, y: (x + y, x * y), {"x": N, "y": N}, name="pair")


def numbers(seed: int = 0) -> Any:
    return np.random.default_rng(seed).normal(size=(2, N))


def test_results_are_those_of_a_call(kernel: Kernel) -> None:
    x, y = numbers()
    out = np.full((2, N), np.nan)
    assert kernel.into(out, x, y) is out
    np.testing.assert_array_equal(out, kernel(x, y))


def test_every_result_has_its_array(pair: Kernel) -> None:
    x, y = numbers()
    total, product = np.empty((2, N))
    found = pair.into(total, product, x, y)
    assert found[0] is total
    assert found[1] is product
    np.testing.assert_array_equal(found, pair(x, y))


@pytest.mark.parametrize(
    "out",
    [
        np.empty((2, N, 2))[..., 0],
        np.empty((N, 2)).T,
        np.empty((4, N))[::2],
        np.frombuffer(bytearray(8 * 2 * N + 1), np.uint8)[1:].view(np.float64).reshape(2, N),
    ],
    ids=["strided", "transposed", "every other row", "unaligned"],
)
def test_any_strides_are_filled(kernel: Kernel, out: Any) -> None:
    x, y = numbers()
    assert kernel.into(out, x, y) is out
    np.testing.assert_array_equal(out, kernel(x, y))


def test_arguments_of_any_kind_are_read(kernel: Kernel) -> None:
    x, y = numbers()
    out = np.empty((2, N))
    assert kernel.into(out, x.tolist(), np.repeat(y, 2)[::2]) is out
    np.testing.assert_array_equal(out, kernel(x, y))


@given(first=st.integers(0, 3 * N), second=st.integers(0, 3 * N))
def test_memory_may_overlap(kernel: Kernel, first: int, second: int) -> None:
    memory = np.random.default_rng(first).normal(size=5 * N)
    x, y, out = memory[first : first + N], memory[second : second + N], memory[N : 3 * N].reshape(2, N)
    expected = kernel(x, y)
    np.testing.assert_array_equal(kernel.into(out, x, y), expected)


def test_results_that_overlap_are_as_if_copied_in_order(pair: Kernel) -> None:
    x, y = numbers()
    memory = np.empty(N + 1)
    pair.into(memory[:N], memory[1:], x, y)
    np.testing.assert_array_equal(memory[1:], x * y)
    assert memory[0] == x[0] + y[0]


def read_only() -> Any:
    array = np.empty((2, N))
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    "out",
    [
        np.empty((N, 2)), np.empty(2 * N), np.empty((2, N, 1)), np.empty((2, N), np.float32), read_only(),
        np.empty((2, N)).tolist(), None, np.empty((2, N), ">f8"), (np.empty((2, N)),),
    ],
    ids=["turned", "flat", "deeper", "float32", "read-only", "list", "none", "big-endian", "tuple"],
)  # fmt: skip
def test_what_is_no_room_is_refused(kernel: Kernel, out: Any) -> None:
    with pytest.raises(InputError, match=r"out: expected an array of float64 to write to, of shape \(2, 5\)"):
        kernel.into(out, *numbers())


def test_a_missing_argument_is_refused(kernel: Kernel) -> None:
    with pytest.raises(InputError, match="expected 2 arguments"):
        kernel.into(np.empty((2, N)), numbers()[0])
    with pytest.raises(InputError, match=r"out: expected one array per result \(1\)"):
        kernel.into()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_refused(kernel: Kernel, value: float) -> None:
    x, y = numbers()
    y[2] = value
    with pytest.raises(NonFiniteError, match="argument 'y'"):
        kernel.into(np.empty((2, N)), x, y)
    with pytest.raises(NonFiniteError, match="the result is not finite"):
        kernel.into(np.empty((2, N)), np.full(N, 1e300), np.full(N, 1e300))


def test_a_call_keeps_nothing_and_makes_no_array(kernel: Kernel) -> None:
    x, y = numbers()
    out, into = np.empty((2, N)), kernel.into
    counts = [sys.getrefcount(array) for array in (out, x, y)]
    for _ in range(1000):
        into(out, x, y)
    assert [sys.getrefcount(array) for array in (out, x, y)] == counts
    kernel, x = compile_function(lambda x: 2.0 * x, {"x": 500}), np.ones(500)
    out, into = np.empty(500), kernel.into
    for _ in range(3):  # which make the arrays that are returned by turns
        into(out, x)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(1000):
        into(out, x)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak - before < out.nbytes


def test_without_builtin_functions_it_is_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("adaptctl.compilation.kernel.has_builtins", lambda: False)
    kernel, (x, y), out = compile_function(neighbours, {"x": N, "y": N}), numbers(), np.empty((2, N))
    assert kernel.into(out, x, y) is out
    np.testing.assert_array_equal(out, neighbours_of(x, y))


def neighbours_of(x: Any, y: Any) -> Any:
    return np.array([x + np.roll(x, -1), np.roll(x, -1) * y])


def test_a_mechanism_fills_once_it_is_compiled() -> None:
    arm = Mechanism(load("puma560_measured").description)
    p, v, a = np.random.default_rng(0).normal(size=(3, arm.dof))
    fresh = arm.inverse_dynamics(p, v, a)
    out = np.empty(arm.dof)
    for _ in range(COMPILE_AFTER_CALLS + 2):
        arm.inverse_dynamics(p, v, a, out=out)
    assert arm.inverse_dynamics(p, v, a, out=out) is out
    np.testing.assert_allclose(out, fresh, rtol=1e-11)
    many = np.empty((3, arm.dof))
    arm.inverse_dynamics(np.tile(p, (3, 1)), np.tile(v, (3, 1)), np.tile(a, (3, 1)), out=many)
    np.testing.assert_allclose(many, np.tile(fresh, (3, 1)), rtol=1e-11)
    with pytest.raises(InputError, match="out: expected an array of float64"):
        arm.inverse_dynamics(p, v, a, out=np.empty(3))


def test_results_larger_than_caches_are_those_of_parts() -> None:
    """Rows of whole cache lines are then written past the caches, other rows and other places are not."""
    for width in (8, 24, 20):
        kernel = compile_function(partial(_columns, width), {"x": 2}, name="columns")
        samples = MIN_STREAMED_BYTES // 8 // width + 13
        x = np.random.default_rng(width).normal(size=(samples, 2))
        parts = np.concatenate([kernel.map(part) for part in np.array_split(x, 7)])
        np.testing.assert_array_equal(kernel.map(x), parts)
        for skip in (0, 1, 8):
            memory = np.full(samples * width + 32, np.pi)
            first = (-memory.ctypes.data // 8) % 8 + skip
            kernel.map(x, out=memory[first : first + parts.size].reshape(parts.shape))
            np.testing.assert_array_equal(memory[first : first + parts.size], parts.ravel())
            assert np.all(memory[:first] == np.pi), "before"
            assert np.all(memory[first + parts.size :] == np.pi), "after"


def _columns(width: int, x: Column) -> Column:
    return Column([x[0] * k + x[1] for k in range(width)])


@pytest.mark.parametrize("rows", [slice(None), slice(None, None, 3), slice(None, None, -1), slice(7, 8)])
def test_rows_of_a_wider_array_are_read_where_they_are(kernel: Kernel, rows: slice) -> None:
    wide = np.random.default_rng(3).normal(size=(20, 3 * N))
    wide.flags.writeable = False
    x, y = wide[rows, 2 : 2 + N], wide[rows, -N:]
    np.testing.assert_array_equal(kernel.map(x, y), kernel.map(x.copy(), y.copy()))
    np.testing.assert_array_equal(kernel.map(wide[rows, ::3], y), kernel.map(wide[rows, ::3].copy(), y.copy()))
    same = np.broadcast_to(wide[0, :N], x.shape)
    np.testing.assert_array_equal(kernel.map(x, same), kernel.map(x.copy(), same.copy()))
