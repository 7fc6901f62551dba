"""Kernels as functions of arrays: what they take, return and refuse, one sample or many, in any thread."""

from __future__ import annotations

import gc
import math
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import pytest

from adaptctl.compilation import Kernel, compile_function, outlined
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column, where

pytestmark = pytest.mark.usefixtures("optimized")

# Arguments and results


class Parts(NamedTuple):
    column: Column
    number: Any


def parts(p: Column, nothing: Column, v: Column) -> Parts:
    return Parts(p + v, p @ v)


@pytest.fixture(scope="module")
def kernel() -> Kernel:
    return compile_function(parts, {"p": 2, "nothing": 0, "v": 2}, name="law")


def test_a_kernel_describes_itself(kernel: Kernel) -> None:
    assert (kernel.name, dict(kernel.arguments)) == ("law", {"p": 2, "nothing": 0, "v": 2})
    assert kernel.outputs == ((2,), ())
    assert kernel.operations.flops == 2 + 3
    assert compile_function(parts, kernel.arguments).name == "parts"


@pytest.mark.parametrize(
    "p",
    [
        np.array([1.0, 2.0]),
        np.array([1.0, 9.0, 2.0])[::2],
        np.array([2.0, 1.0])[::-1],
        np.array([[1.0, 5.0], [2.0, 6.0]])[:, 0],
        np.array([1.0, 2.0], dtype=np.float32),
        np.array([1, 2]),
        np.array([1.0, 2.0], dtype=">f8"),
        np.array([1.0, 2.0], dtype=np.longdouble),
        [1, 2.0],
        (1.0, np.float64(2.0)),
    ],
    ids=["plain", "strided", "reversed", "column", "float32", "int", "big-endian", "longdouble", "list", "tuple"],
)
def test_arguments_of_any_kind(kernel: Kernel, p: Any) -> None:
    result = kernel(p, [], [10.0, 20.0])
    assert isinstance(result, Parts)
    np.testing.assert_array_equal(result.column, [11.0, 22.0])
    assert result.number == 50.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0, 2.0], []), r"law: expected 3 arguments \(p, nothing, v\), got 2"),
        (([1.0, 2.0], [], [1.0]), r"law: argument 'v': expected shape \(2,\), got \(1,\)"),
        (([1.0], [], [1.0, 2.0, 3.0]), r"law: argument 'p': expected shape \(2,\), got \(1,\)"),
        (([1.0, 2.0], [0.0], [1.0, 2.0]), r"argument 'nothing': expected shape \(0,\), got \(1,\)"),
        ((np.ones((2, 1)), np.ones((0, 1)), np.ones((2, 1))), r"argument 'p': expected shape \(2,\), got \(2, 1\)"),
        ((1.0, [], [1.0, 2.0]), r"argument 'p': expected shape \(2,\), got \(\)"),
        (([1.0, 2.0], [], [1j, 2.0]), "argument 'v': expected real numbers .*complex"),
        (("12", [], [1.0, 2.0]), "argument 'p': expected real numbers"),
        ((["1", "2"], [], [1.0, 2.0]), "argument 'p': expected real numbers"),
        (([None, 2.0], [], [1.0, 2.0]), "argument 'p': expected real numbers"),
        (([[1.0], [2.0, 3.0]], [], [1.0, 2.0]), "argument 'p': expected real numbers"),
    ],
)
def test_wrong_arguments_are_named(kernel: Kernel, arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        kernel(*arguments)


def test_results_are_fresh(kernel: Kernel) -> None:
    first, kept = kernel([1.0, 2.0], [], [3.0, 4.0]), np.array([4.0, 6.0])
    second = kernel([5.0, 6.0], [], [7.0, 8.0])
    np.testing.assert_array_equal(first.column, kept)
    assert not np.shares_memory(first.column, second.column)


@pytest.mark.parametrize(
    ("equation", "expected"),
    [
        (lambda x: x, [1.0, 2.0]),
        (lambda x: (x, x), ([1.0, 2.0], [1.0, 2.0])),
        (lambda x: (x[1],), (2.0,)),
        (lambda x: x[1], 2.0),
        (lambda x: 3, 3.0),
        (lambda x: Column((math.inf, -0.1)), [math.inf, -0.1]),
        (lambda x: Column(()), []),
        (lambda x: (), ()),
        (lambda x: (Column(()), x[0] + x[1]), ([], 3.0)),
        (lambda x: [x, 2.0 * x, x], [[1.0, 2.0], [2.0, 4.0], [1.0, 2.0]]),
        (lambda x: ([x], x[0], [Column(()), Column(())]), ([[1.0, 2.0]], 1.0, np.empty((2, 0)))),
    ],
)
def test_results_of_any_kind(equation: Callable[[Column], Any], expected: Any) -> None:
    result = compile_function(equation, {"x": 2})([1.0, 2.0])
    assert isinstance(result, tuple) is isinstance(expected, tuple)
    pairs = zip(result, expected, strict=True) if isinstance(expected, tuple) else [(result, expected)]
    for got, wanted in pairs:
        np.testing.assert_array_equal(got, wanted, strict=False)
        assert np.shape(got) == np.shape(wanted)


def test_rows_go_in_and_out_of_called_functions() -> None:
    transposed = outlined(lambda a, b: [Column(row) for row in zip(*a, b, strict=True)])
    kernel = compile_function(lambda x, y: transposed([x, y], x), {"x": 2, "y": 2})
    np.testing.assert_array_equal(kernel([1.0, 2.0], [3.0, 4.0]), [[1.0, 3.0, 1.0], [2.0, 4.0, 2.0]])


@pytest.mark.parametrize("length", [-1, 1.5, 2.0, np.nan, np.inf, "2", None, True])
def test_lengths_are_counts(length: Any) -> None:
    says = f"<lambda>: length of 'x': expected a whole number of at least 0, got {length!r}"
    with pytest.raises(InputError, match=says):
        compile_function(lambda x: x, {"x": length})


def test_a_kernel_needs_an_argument() -> None:
    with pytest.raises(InputError, match="at least one argument"):
        compile_function(lambda: 1.0, {})


# Built-in functions: what arrays usually are is read without detour, all else is made so first


def unusual(values: list[float]) -> dict[str, Any]:
    """The same numbers, each time in another array that cannot be read at once."""
    plain = np.array(values)
    unaligned = np.zeros(8 * len(values) + 1, dtype=np.uint8)[1:].view(np.float64)
    unaligned[:] = plain
    return {
        "list": values,
        "float32": plain.astype(np.float32),
        "swapped": plain.astype(plain.dtype.newbyteorder()),
        "strided": np.repeat(plain, 2)[::2],
        "reversed": plain[::-1].copy()[::-1],
        "broadcast": np.broadcast_to(plain[:1], plain.shape) if len(set(values)) == 1 else plain,
        "unaligned": unaligned,
        "subclass": plain.view(np.recarray),
        "masked": np.ma.masked_array(plain),
        "described": plain.astype(np.dtype(np.float64, metadata={"unit": "rad"})),
        "read-only": np.frombuffer(plain.tobytes()),
        "memory": memoryview(plain),
        "whole": np.array(values, dtype=np.int8),
    }


@pytest.fixture(scope="module")
def summed() -> Kernel:
    return compile_function(lambda x, y: (x @ y, x + y), {"x": 3, "y": 3})


@pytest.mark.parametrize("kind", unusual([1.0]))
def test_every_kind_of_array_is_read(summed: Kernel, kind: str) -> None:
    x, y = np.array([1.0, 2.0, 3.0]), [5.0, 5.0, 5.0]
    for arguments in ((unusual(x.tolist())[kind], np.array(y)), (x, unusual(y)[kind])):
        dot, total = summed(*arguments)
        assert (dot, total.tolist()) == (30.0, [6.0, 7.0, 8.0])
        assert (type(dot), type(total), total.dtype) == (float, np.ndarray, np.float64)
        assert total.flags.writeable
        assert total.flags.owndata


@pytest.mark.parametrize(
    "x",
    [np.zeros(()), np.zeros((3, 1)), np.zeros((1, 3)), np.zeros(4), np.zeros(0), 1.0, None, "abc", object(), {}, len],
)
def test_no_other_object_is_taken_for_an_array(summed: Kernel, x: Any) -> None:
    for arguments in ((x, np.ones(3)), (np.ones(3), x)):
        with pytest.raises(InputError, match=r"argument '[xy]': expected"):
            summed(*arguments)


def test_a_call_leaks_nothing(summed: Kernel) -> None:
    checked = compile_function(parts, {"p": 2, "nothing": 0, "v": 2}, finite=True)
    x, bad, empty = np.ones(3), np.array([1.0, np.nan]), np.empty(0)

    def work() -> None:
        for _ in range(300):
            summed(x, x)
            summed([1.0, 2.0, 3.0], x)
            checked(x[:2], empty, x[:2])
            with suppress(InputError):
                summed(x)
            with suppress(NonFiniteError):
                checked(bad, empty, bad)

    work()
    before, references = len(gc.get_objects()), sys.getrefcount(x)
    tracemalloc.start()
    start = tracemalloc.get_traced_memory()[0]
    work()
    assert tracemalloc.get_traced_memory()[0] - start < 5_000
    tracemalloc.stop()
    assert len(gc.get_objects()) - before < 200
    assert sys.getrefcount(x) == references


def test_what_is_given_may_be_anything_where_only_results_must_be_finite() -> None:
    guarded = compile_function(
        lambda x, y: Column((where(x[0] < 0.0, y[0], x[0]),)), {"x": 1, "y": 1}, finite="results"
    )
    bad, fine = np.array([np.inf]), np.array([-1.0])
    assert guarded(fine, fine).tolist() == [-1.0]
    assert guarded([2.0], bad).tolist() == [2.0]
    assert guarded.map([[2.0], [-1.0]], [[np.nan], [5.0]]).tolist() == [[2.0], [5.0]]
    with pytest.raises(NonFiniteError, match="argument 'y': expected finite numbers"):
        guarded(fine, bad)
    with pytest.raises(NonFiniteError, match="argument 'y': expected finite numbers"):
        guarded.map([[2.0], [-1.0]], [[1.0], [np.nan]])


def test_a_result_outlives_its_kernel() -> None:
    kernel = compile_function(lambda x: 2.0 * x, {"x": 3})
    call = kernel.__call__
    result = kernel(np.ones(3))
    del kernel
    gc.collect()
    np.testing.assert_array_equal(result, [2.0, 2.0, 2.0])
    np.testing.assert_array_equal(call(np.ones(3)), [2.0, 2.0, 2.0])


def test_without_builtin_functions_a_call_is_a_map_of_one(kernel: Kernel, summed: Kernel) -> None:
    rng = np.random.default_rng(0)
    for one in (
        kernel,
        summed,
        compile_function(lambda x: [x, x], {"x": 2}),
        compile_function(lambda x: x[0], {"x": 2}),
    ):
        arguments = [rng.normal(size=n) for n in one.arguments.values()]
        here, there = one(*arguments), one._one_sample(*arguments)
        assert type(here) is type(there)
        pairs = zip(here, there, strict=True) if isinstance(here, tuple) else [(here, there)]
        for mine, other in pairs:
            assert type(mine) is type(other)
            np.testing.assert_array_equal(mine, other)


# Finite numbers


@pytest.fixture(scope="module")
def careful() -> Kernel:
    return compile_function(
        lambda x, y: (x[0] / y[0], Column(a * b for a, b in zip(x, y, strict=True))), {"x": 17, "y": 17}, finite=True
    )


def test_finite_numbers_pass(careful: Kernel) -> None:
    x, y = np.random.default_rng(0).normal(size=(2, 17))
    x[3], y[4] = 1e308, -1e308
    ratio, product = careful(x, y)
    assert ratio == x[0] / y[0]
    np.testing.assert_array_equal(product, x * y)
    np.testing.assert_array_equal(careful.map([x], [y])[1], [x * y])


@pytest.mark.parametrize("place", [0, 1, 7, 8, 15, 16])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_an_argument_that_is_not_finite_is_named(careful: Kernel, place: int, value: float) -> None:
    bad = np.ones(17)
    bad[place] = value
    for name, arguments in (("x", (bad, np.ones(17))), ("y", (np.ones(17), bad)), ("y", (np.ones(17), bad.tolist()))):
        with pytest.raises(NonFiniteError, match=rf"<lambda>: argument '{name}': expected finite numbers, got \[.*"):
            careful(*arguments)
        with pytest.raises(NonFiniteError, match=rf"<lambda>: argument '{name}'"):
            careful.map(*([np.ones(17), x] for x in arguments))


@pytest.mark.parametrize(("x", "y"), [(1.0, 0.0), (0.0, 0.0), (1e200, 1e200)])
def test_a_result_that_is_not_finite_is_refused(careful: Kernel, x: float, y: float) -> None:
    with pytest.raises(NonFiniteError, match="the result is not finite for finite arguments"):
        careful(np.full(17, x), np.full(17, y))
    with pytest.raises(NonFiniteError, match="the result is not finite"):
        careful.map(np.full((3, 17), x), np.full((3, 17), y))


# Many samples


@pytest.mark.parametrize("samples", [0, 1, 57])
@pytest.mark.parametrize("order", ["C", "F"])
def test_map_is_a_call_for_each_sample(kernel: Kernel, samples: int, order: Any) -> None:
    generator = np.random.default_rng(0)
    p, v = (np.asarray(generator.normal(size=(samples, 2)), order=order) for _ in range(2))
    columns, numbers = kernel.map(p, np.empty((samples, 0)), v.astype(np.float32))
    assert columns.shape == (samples, 2)
    assert numbers.shape == (samples,)
    for k in range(samples):
        one = kernel(p[k], [], v[k].astype(np.float32))
        np.testing.assert_array_equal(columns[k], one.column)
        assert numbers[k] == one.number


@pytest.mark.parametrize(
    ("p", "v", "message"),
    [
        (
            np.ones((3, 2)),
            np.ones((4, 2)),
            r"argument 'v': expected shape \(3, 2\), got \(4, 2\) \(one row per sample",
        ),
        (np.ones(3), np.ones(2), r"argument 'p': expected shape \(3, 2\), got \(3,\)"),
        (1.0, 2.0, r"argument 'p': expected shape \(3, 2\), got \(\)"),
    ],
)
def test_map_names_the_argument_without_samples(kernel: Kernel, p: Any, v: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        kernel.map(p, np.ones((3, 0)), v)


def test_what_all_samples_share_is_given_once(kernel: Kernel) -> None:
    p, v = np.arange(10.0).reshape(5, 2), np.array([2.0, 3.0])
    shared, repeated = (kernel.map(p, np.empty((5, 0)), x) for x in (v, np.tile(v, (5, 1))))
    for one, other in zip(shared, repeated, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_map_into_given_memory() -> None:
    kernel, x = compile_function(lambda x: [x, 2.0 * x], {"x": 3}), np.arange(21.0).reshape(7, 3)
    memory = np.empty((7, 2, 3))
    assert kernel.map(x, out=memory) is memory
    np.testing.assert_array_equal(memory, kernel.map(x))
    wrong: dict[str, Any] = {
        "float32": np.empty((7, 2, 3), dtype=np.float32),
        "float64 to write to, of shape": np.empty((6, 2, 3)),
        "contiguous": np.empty((7, 2, 6))[..., ::2],
        "one array per result": [memory, memory],
    }
    for says, out in wrong.items():
        with pytest.raises(InputError, match=says):
            kernel.map(x, out=out)


# Threads


@pytest.fixture
def restless() -> Iterator[None]:
    """Threads that take turns as often as they can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("restless")
def test_threads_do_not_see_each_others_numbers(kernel: Kernel) -> None:
    def work(seed: int) -> float:
        p, v = np.random.default_rng(seed).normal(size=(2, 2000, 2))
        results = [kernel(a, [], b) for a, b in zip(p, v, strict=True)]
        return max(float(abs(r.column - (a + b)).max()) for r, a, b in zip(results, p, v, strict=True))

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(work, range(8))) == [0.0] * 8


@pytest.mark.parametrize("name", ["2dof_planar", "a b", "élan", '"%0"', "-1", ""])
def test_any_name_may_be_compiled(name: str) -> None:
    native = compile_function(lambda x: x + x, {"x": 1}, name=name)
    assert native([1.5]) == 3.0


@pytest.mark.parametrize("width", [1, 2, 3, 7, 8, 9, 16, 21])
@pytest.mark.parametrize("samples", [1, 5, 8, 19])
def test_rows_of_any_width_are_those_of_single_calls(width: int, samples: int) -> None:
    def rows(x: Column) -> list[Column]:
        return [Column(x[0] * k + j * x[1] for k in range(width)) for j in range(3)]

    kernel = compile_function(rows, {"x": 2})
    x = np.random.default_rng(width).normal(size=(samples, 2))
    found = kernel.map(x)
    assert found.shape == (samples, 3, width)
    np.testing.assert_array_equal(found, [kernel(one) for one in x])
