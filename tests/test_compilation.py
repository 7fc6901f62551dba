"""Compiled equations: native code gives what the same equation gives on floats, arrays and dual numbers."""

from __future__ import annotations

import gc
import itertools
import math
import sys
import time
import tracemalloc
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import pytest
from expression_trees import Tree, evaluated, size, trees
from hypothesis import given, settings
from hypothesis import strategies as st

from adaptctl.compilation import Kernel, compile_function, outlined, trace
from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.llvm import program
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column, Dual, absolute, clip, cos, maximum, minimum, sin, sqrt, where

moderate = st.floats(-3.0, 3.0)
triples = st.tuples(moderate, moderate, moderate)

OPERATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "+": lambda x, y: x + y,
    "-": lambda x, y: x - y,
    "*": lambda x, y: x * y,
    "/": lambda x, y: x / y,
    "neg": lambda x, y: -x,
    "sqrt": lambda x, y: sqrt(x),
    "absolute": lambda x, y: absolute(x),
    "minimum": minimum,
    "maximum": maximum,
    "clip": lambda x, y: clip(x, -1.0, y),
    "<": lambda x, y: where(x < y, x, y),
    "<=": lambda x, y: where(x <= y, 1.0, 2.0),
    ">": lambda x, y: where(x > y, 1.0, 2.0),
    ">=": lambda x, y: where(x >= y, 1.0, 2.0),
    "infinite constant": lambda x, y: maximum(x, math.inf) + minimum(y, 0.1),
    "undefined constant": lambda x, y: where(x < y, math.nan, x),
}


@pytest.fixture(scope="module")
def operations() -> Kernel:
    return compile_function(lambda x, y: Column(f(x[0], y[0]) for f in OPERATIONS.values()), {"x": 1, "y": 1})


@given(st.floats(), st.floats())
@settings(max_examples=300, deadline=None)
def test_operations_are_numpys(operations: Kernel, x: float, y: float) -> None:
    with np.errstate(all="ignore"):
        expected = [np.ravel(f(np.array([x]), np.array([y])))[0] for f in OPERATIONS.values()]
    np.testing.assert_array_equal(operations([x], [y]), expected)  # NaN equals NaN here, and -0.0 equals 0.0


ODD = (-0.0, 0.0, 5e-324, 1.5, -2.5, math.inf, -math.inf, math.nan)


@pytest.mark.parametrize("name", ["absolute", "minimum", "maximum", "clip", "<", "<=", ">", ">="])
def test_choices_among_odd_numbers_are_the_same_on_floats(operations: Kernel, name: str) -> None:
    k = list(OPERATIONS).index(name)
    for x, y in itertools.product(ODD, ODD):
        np.testing.assert_array_equal(operations([x], [y])[k], OPERATIONS[name](x, y))


@pytest.mark.parametrize("x", [-0.0, 0.0, 1.5, math.inf, math.nan])
def test_extrema_of_ties_and_of_nan(operations: Kernel, x: float) -> None:
    where_extrema = [list(OPERATIONS).index(name) for name in ("minimum", "maximum")]
    np.testing.assert_array_equal(operations([x], [x])[where_extrema], [x, x])
    np.testing.assert_array_equal(operations([x], [math.nan])[where_extrema], [math.nan, math.nan])
    np.testing.assert_array_equal(operations([math.nan], [x])[where_extrema], [math.nan, math.nan])


@given(st.sampled_from((-0.0, 0.0, 1.0, -1.0)), st.sampled_from((-0.0, 0.0, 2.0, -2.0)))
@settings(deadline=None)
def test_unknown_zeros_keep_their_sign_where_nothing_is_folded(operations: Kernel, x: float, y: float) -> None:
    expected = [x + y, x - y, x * y]
    np.testing.assert_array_equal(np.signbit(operations([x], [y])[:3]), np.signbit(expected))


def test_folding_loses_the_sign_of_zero_and_an_undefined_factor_of_zero() -> None:
    kernel = compile_function(lambda x: Column((x[0] + 0.0, 0.0 * x[0], x[0] - x[0])), {"x": 1})
    assert math.copysign(1.0, kernel([-0.0])[0]) == -1.0  # -0.0 + 0.0 is 0.0 in IEEE 754
    np.testing.assert_array_equal(kernel([math.nan]), [math.nan, 0.0, 0.0])


@given(trees, triples)
@settings(max_examples=150, deadline=None)
def test_random_equations_agree_with_floats_and_arrays(tree: Tree, x: tuple[float, float, float]) -> None:
    kernel = compile_function(lambda x: evaluated(tree, x), {"x": 3})
    expected, tolerance = float(evaluated(tree, x)), 1e-12 * size(tree, x)
    assert kernel(x) == pytest.approx(expected, rel=0.0, abs=tolerance)
    on_arrays = evaluated(tree, [np.array([a]) for a in x]) + np.zeros(1)
    np.testing.assert_allclose(kernel.map([x]), on_arrays, rtol=0.0, atol=tolerance)


# Derivatives


def smooth(p: Column) -> Column:
    """Smooth near every tested point, and uses every operation."""
    x, y = p
    a = sin(x) * cos(y) + sqrt(x * x + 1.0) / (2.0 + absolute(y)) - 1.0 / (x - 5.0)
    b = minimum(x, 10.0) * maximum(-y, -10.0) + clip(x, -7.0, 7.0)
    return Column((a + b, -where(x > -4.0, b * b, 3.0 - a), where(y < 4.0, a, b)))


def directional(p: Column, v: Column) -> tuple[Column, Column]:
    """The value of `smooth` and its derivative along v."""
    outcome = smooth(Column(Dual(x, slope) for x, slope in zip(p, v, strict=True)))
    return Column(d.value for d in outcome), Column(d.slope for d in outcome)


@pytest.fixture(scope="module")
def derivative() -> Kernel:
    return compile_function(directional, {"p": 2, "v": 2})


points = st.tuples(moderate, moderate.filter(lambda y: abs(y) > 1e-3))


@given(points, st.tuples(moderate, moderate))
@settings(deadline=None)
def test_derivatives_compile(derivative: Kernel, p: tuple[float, float], v: tuple[float, float]) -> None:
    value, slope = derivative(p, v)
    expected_value, expected_slope = directional(Column(p), Column(v))
    np.testing.assert_allclose(value, expected_value.of, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(slope, expected_slope.of, rtol=1e-12, atol=1e-11)


@given(points, st.tuples(moderate, moderate))
@settings(deadline=None)
def test_derivatives_are_central_differences(
    derivative: Kernel, p: tuple[float, float], v: tuple[float, float]
) -> None:
    h, x, direction = 1e-5, np.array(p), np.array(v)
    ahead, behind = derivative(x + h * direction, v)[0], derivative(x - h * direction, v)[0]
    np.testing.assert_allclose(derivative(p, v)[1], (ahead - behind) / (2.0 * h), rtol=1e-6, atol=1e-6)


# Functions that are called


def pendulum(p: Column, v: Column, tau: Column) -> Column:
    """Something with a body worth sharing."""
    return Column(t - sin(x) - 0.1 * w * w for x, w, t in zip(p, v, tau, strict=True))


def rk4(acceleration: Callable[..., Column], h: float = 0.1) -> Callable[..., tuple[Column, Column]]:
    def step(p: Column, v: Column, tau: Column) -> tuple[Column, Column]:
        k1 = acceleration(p, v, tau)
        v2 = v + (0.5 * h) * k1
        k2 = acceleration(p + (0.5 * h) * v, v2, tau)
        v3 = v + (0.5 * h) * k2
        k3 = acceleration(p + (0.5 * h) * v2, v3, tau)
        v4 = v + h * k3
        k4 = acceleration(p + h * v3, v4, tau)
        return p + (h / 6.0) * (v + 2.0 * (v2 + v3) + v4), v + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)

    return step


SIZES = {"p": 2, "v": 2, "tau": 2}


def test_four_stages_share_one_body() -> None:
    routine = trace(rk4(outlined(pendulum)), SIZES)
    assert len(routine.calls) == 4
    assert len(set(routine.calls)) == 1
    assert program(routine, Lanes())[0].count("call void @pendulum") == 4
    assert program(routine, Lanes())[0].count("define internal void @pendulum") == 1
    unrolled = trace(rk4(pendulum), SIZES)
    assert routine.operations["sin"] == unrolled.operations["sin"] == 8


@given(triples, triples)
@settings(deadline=None)
def test_a_called_function_gives_what_it_gives_unrolled(
    steps: tuple[Kernel, Kernel], x: tuple[float, ...], y: tuple[float, ...]
) -> None:
    arguments = x[:2], (x[2], y[0]), y[1:]
    called, unrolled = (np.concatenate(step(*arguments)) for step in steps)
    np.testing.assert_allclose(called, unrolled, rtol=1e-14, atol=1e-14)
    reference = rk4(pendulum)(*(Column(argument) for argument in arguments))
    np.testing.assert_allclose(called, [a for column in reference for a in column], rtol=1e-14, atol=1e-14)


@pytest.fixture(scope="module")
def steps() -> tuple[Kernel, Kernel]:
    return compile_function(rk4(outlined(pendulum)), SIZES), compile_function(rk4(pendulum), SIZES)


def test_calls_nest_and_the_innermost_body_is_shared() -> None:
    inner = outlined(lambda a: (a * a, Column((a, 2.0 * a, 7.0))))
    outer = outlined(lambda u: Column((inner(u[0])[0], inner(u[1])[1] @ Column((1.0, 1.0, 1.0)))))

    def equation(x: Column) -> Column:
        return outer(x) + outer(2.0 * x) + Column((inner(x[0])[0], 0.0))

    kernel = compile_function(equation, {"x": 2})
    np.testing.assert_allclose(kernel([3.0, 5.0]), equation(Column((3.0, 5.0))).of, rtol=1e-15)
    assert program(trace(equation, {"x": 2}), Lanes())[0].count("define internal") == 3


def test_a_call_on_other_scalars_is_just_a_call() -> None:
    square = outlined(lambda x: x * x)
    assert square(3.0) == 9.0
    np.testing.assert_array_equal(square(np.arange(3.0)), [0.0, 1.0, 4.0])
    assert square(Dual(3.0, 1.0)).slope == 6.0
    kernel = compile_function(lambda x: square(Dual(x[0], 1.0)).slope, {"x": 1})
    assert kernel([4.0]) == 8.0


def test_calls_on_known_scalars_differ_from_calls_on_others() -> None:
    product = outlined(lambda a, b: a * b)
    kernel = compile_function(lambda x: Column((product(x[0], 2.0), product(3.0, x[0]), product(x[0], 4.0))), {"x": 1})
    np.testing.assert_array_equal(kernel([5.0]), [10.0, 15.0, 20.0])


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


@pytest.mark.parametrize("length", [-1, 1.5])
def test_lengths_are_counts(length: Any) -> None:
    with pytest.raises(InputError, match=rf"<lambda>: expected whole numbers as lengths, got .'x': {length}"):
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
    with pytest.raises(NonFiniteError, match="the result is not finite, though all it was given is"):
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
        (np.ones((3, 2)), np.ones((4, 2)), r"argument 'v': expected shape \(3, 2\), got \(4, 2\) \(one row a sample"),
        (np.ones(2), np.ones(2), r"argument 'p': expected shape \(2, 2\), got \(2,\)"),
        (1.0, 2.0, r"argument 'p': expected shape \(2,\), got \(\)"),
    ],
)
def test_map_names_the_argument_without_samples(kernel: Kernel, p: Any, v: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        kernel.map(p, np.ones((3, 0)), v)


# Threads, memory, time


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


def test_a_kernel_outlives_its_trace_and_frees_its_code() -> None:
    graphs = []

    def equation(x: Column) -> Any:
        graphs.append(weakref.ref(x[0].graph))
        return x[0] + 1.0

    kernel = compile_function(equation, {"x": 1})
    code = weakref.ref(kernel._code.engine)
    gc.collect()
    assert graphs[0]() is None
    assert kernel([1.0]) == 2.0
    del kernel
    gc.collect()
    assert code() is None


def mixed(x: Column, rounds: int) -> Column:
    """Eleven operations on six numbers in each round, none of them like another."""
    for k in range(rounds):
        shifted = Column((*x.of[1:], x[0]))
        x = 0.5 * (x + shifted) * Column((shifted[0], *[1.0 + 1e-3 * k] * 5))
    return x


def test_four_thousand_operations_compile_in_seconds() -> None:
    start = time.perf_counter()
    kernel = compile_function(lambda x: mixed(x, 400), {"x": 6})
    elapsed = time.perf_counter() - start
    assert kernel.operations.flops > 4000
    assert elapsed < 10.0  # about 0.2 s on an idle core


def test_fifty_thousand_operations_compile_in_seconds_too_and_are_right(monkeypatch: pytest.MonkeyPatch) -> None:
    """LLVM's usual way would take a minute."""
    monkeypatch.setenv("ADAPTCTL_CACHE", "off")

    def equation(x: Column) -> Column:
        parts = [mixed(sin(k * x[0]) * x, 300) for k in range(1, 17)]
        return Column(sum(column) for column in zip(*parts, strict=True))

    start = time.perf_counter()
    kernel = compile_function(equation, {"x": 6})
    assert kernel.operations.flops > 50_000
    assert time.perf_counter() - start < 20.0  # about 1.5 s on an idle core
    x = [0.3, -0.2, 0.9, 0.4, 0.6, -0.7]
    np.testing.assert_allclose(kernel(x), equation(Column(x)).of, rtol=1e-12)
