"""Compiled equations: native code gives what the same equation gives on floats, arrays and dual numbers."""

from __future__ import annotations

import gc
import itertools
import math
import time
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from expression_trees import Tree, evaluated, size, trees
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import nightly

from adaptctl.compilation import Kernel, compile_function, compile_step, llvm, outlined, trace
from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.llvm import program
from adaptctl.scalars import Column, Dual, absolute, clip, cos, maximum, minimum, nearest_whole, sin, sqrt, where

pytestmark = pytest.mark.usefixtures("optimized")

moderate = st.floats(-3.0, 3.0)
triples = st.tuples(moderate, moderate, moderate)

OPERATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "+": lambda x, y: x + y,
    "-": lambda x, y: x - y,
    "*": lambda x, y: x * y,
    "/": lambda x, y: x / y,
    "neg": lambda x, y: -x,
    "sqrt": lambda x, y: sqrt(x),
    "nearest whole": lambda x, y: nearest_whole(x),
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
@settings(max_examples=120, deadline=None)
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


QUOTIENTS: tuple[Callable[[Any, Any], Any], ...] = (
    lambda x, y: x / y,
    lambda x, y: x / 1.0,
    lambda x, y: x / -1.0,
    lambda x, y: x / -4.0,
    lambda x, y: -x / 4.0,
    lambda x, y: -x / y,
    lambda x, y: x / -y,
    lambda x, y: -x / -y,
    lambda x, y: (x - y) / -y,
    lambda x, y: -3.0 * x / y,
    lambda x, y: 1.0 / y,
    lambda x, y: 2.0 / -y,
    lambda x, y: -2.0 / -y,
    lambda x, y: 0.0 / y,
)


@pytest.mark.parametrize(("x", "y"), [(3.0, 0.75), (-1.5, 2.0), (0.25, -8.0), (-5.0, -0.1)])
def test_quotients_whose_signs_are_moved_are_those_of_floats(x: float, y: float) -> None:
    """What is negated above or below the line, and constants of either sign: exactly, for a sign is no rounding."""
    kernel = compile_function(lambda x, y: Column(f(x[0], y[0]) for f in QUOTIENTS), {"x": 1, "y": 1})
    np.testing.assert_array_equal(kernel([x], [y]), [f(x, y) for f in QUOTIENTS])


@given(trees, triples)
@settings(max_examples=25, deadline=None)
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
    assert len(routine.subroutines) == 4
    assert len(set(routine.subroutines)) == 1
    assert program(routine, Lanes())[0].count("call void @of_pendulum") == 4
    assert program(routine, Lanes())[0].count("define internal void @of_pendulum") == 1
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


# Memory, time


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


@nightly
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


@pytest.mark.parametrize("lanes", [1, 2, 8])
@pytest.mark.parametrize("length", [2, 10_000])
def test_constants_are_written_once_and_many_zeros_at_once(
    lanes: int, length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the function that calls the pieces: by each of them, LLVM took 20 times as long for a sparse matrix."""
    monkeypatch.setattr(llvm, "MAX_WHOLE_EXPRESSIONS", 0)
    monkeypatch.setattr(llvm, "PIECE_EXPRESSIONS", length)

    def sparse(x: Column) -> tuple[list[Column], Column]:
        rows = [Column((x[i] * x[j] if i == j else 2.0 if i == j + 1 else 0.0) for j in range(12)) for i in range(12)]
        return rows, Column((0.0, x[0], 3.0))

    kind = Lanes(lanes)
    text = program(trace(sparse, {"x": 12}), kind).text
    assert text.count("@llvm.memset") == 1
    assert [text.count(f"store {kind.value} {kind.constant(x)},") for x in (0.0, 2.0, 3.0)] == [1, 11, 1]
    ensemble = compile_step(sparse, state={}, constants={"x": 12}, lanes=lanes).ensemble(lanes)
    ensemble.held["x"] = x = np.arange(1.0, 12.0 * lanes + 1.0).reshape(lanes, 12)
    matrix, few = ensemble.run()
    expected = np.array([np.diag(row**2) + 2.0 * np.eye(12, k=-1) for row in x])
    np.testing.assert_array_equal(matrix, expected)
    np.testing.assert_array_equal(few, np.column_stack([np.zeros(lanes), x[:, 0], np.full(lanes, 3.0)]))


@pytest.mark.parametrize("lanes", [1, 4])
@pytest.mark.parametrize("length", [1, 2, 3, 7, 40])
def test_pieces_make_up_the_whole(length: int, lanes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever passes from one to the next: numbers, comparisons, angles, and what is called."""
    inner = outlined(lambda x, y: (x * y + Column(map(sin, x)), x @ y, x))

    def equation(x: Column, y: Column) -> tuple[Any, ...]:
        first, dot, back = inner(x, y)
        bent = Column(where(a < b, cos(a), b + dot) for a, b in zip(first, y, strict=True))
        again, _, _ = inner(bent, back)
        return again, Column(where(a < b, c, 2.0) for a, b, c in zip(first, y, again, strict=True)), dot, x, 3.0

    def values() -> list[Any]:
        stepper = compile_step(equation, state={}, constants={"x": 3, "y": 3}, lanes=lanes)
        ensemble = stepper.ensemble(2 * lanes - 1)
        shape = (ensemble.members, 3)
        ensemble.held["x"], ensemble.held["y"] = np.random.default_rng(0).uniform(-2.0, 2.0, (2, *shape))
        return [part.tolist() for part in ensemble.run()]

    whole = values()
    monkeypatch.setattr(llvm, "MAX_WHOLE_EXPRESSIONS", 0)
    monkeypatch.setattr(llvm, "PIECE_EXPRESSIONS", length)
    np.testing.assert_allclose(
        np.concatenate([np.ravel(a) for a in values()]),
        np.concatenate([np.ravel(a) for a in whole]),
        rtol=1e-14,
        atol=1e-15,
    )


def test_long_code_is_compiled_in_time_that_grows_with_its_length() -> None:
    """Not with its square: each function is short."""

    def equation(x: Column) -> Column:
        a, b = x
        for k in range(8000):
            a, b = b + 0.1 * a, a - 0.1 * b * (1.0 + k)
        return Column((a, b))

    text = program(trace(equation, {"x": 2}), Lanes()).text
    assert max(function.count("\n") for function in text.split("\ndefine ")) < 3 * llvm.PIECE_EXPRESSIONS


def test_places_do_not_depend_on_the_order_in_which_values_were_found() -> None:
    """A set of expressions has the order of their addresses: other text in each process would be compiled anew."""
    one, other = {0, 8}, {8, 0}
    assert list(one) != list(other)
    assert llvm._places({0: 0, 8: 0}, [set(), one]) == llvm._places({0: 0, 8: 0}, [set(), other])


def test_a_routine_is_freed_with_its_last_user_not_by_a_search_for_cycles() -> None:
    routine = trace(lambda x: Column(map(sin, x)), {"x": 3})
    freed, gc_was_on = weakref.ref(routine), gc.isenabled()
    gc.disable()
    try:
        program(routine, Lanes())
        del routine
        assert freed() is None
    finally:
        gc.enable() if gc_was_on else gc.disable()


def test_functions_of_many_lanes_have_the_stack_that_their_numbers_need() -> None:
    assert "alignstack" not in Lanes().attributes
    assert "alignstack(32)" in Lanes(4).attributes
