"""Operations on matrices: one text, the same numbers as loops, straight line, samples, lanes and C."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from c_evaluation import functions_of
from hypothesis import given, settings
from hypothesis import strategies as st
from levels import usable
from nightly import mostly_at_night

from adaptctl.arrays import Array
from adaptctl.codegen.c_function import CNumber
from adaptctl.codegen.c_program import CProgram
from adaptctl.compilation import Op, compile_function, compile_step, llvm, trace
from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.llvm import program
from adaptctl.compilation.loops import Interpreter, vector
from adaptctl.compilation.matrix_operation import MatrixOperation
from adaptctl.compilation.native import Processor
from adaptctl.control.adaptation import low_pass, recalled_step, symmetric
from adaptctl.control.adaptation.sample_stack import sample_stack
from adaptctl.control.adaptation.symmetric import Equation, directional_update, rank_update, solve, symmetric_product
from adaptctl.scalars import Column, Dual, column, cos, sin, where

pytestmark = pytest.mark.usefixtures("optimized")

SIZES = st.integers(1, 45)


def positive(rng: np.random.Generator, k: int) -> Array:
    root = rng.normal(size=(k, k))
    return root @ root.T


def triangle(A: Array) -> Array:
    rows, columns = np.triu_indices(A.shape[-1])
    return A[..., rows, columns]


def operation_and_arguments(name: str, k: int, r: int, rng: np.random.Generator) -> tuple[MatrixOperation, list[Array]]:
    A, b, W = triangle(positive(rng, k)), rng.normal(size=k), rng.normal(size=r * k)
    shares = [rng.uniform(size=r) for _ in range(5)]
    match name:
        case "product":
            return symmetric._product(k), [A, b]
        case "rows":
            return symmetric._rows_product(k), [positive(rng, k).ravel(), b]
        case "solve":
            return symmetric._solver(k), [A, b, np.ones(1)]
        case "rank":
            return symmetric._rank_updater(k, r), [A, W, shares[0], np.array([0.9, 0.5])]
        case "recall":
            flow, (x, right) = np.array([0.9, 0.1, 0.8, 0.05]), rng.normal(size=(2, k))
            lines = np.concatenate([W, rng.normal(size=2 * k)])  # two beside the rows
            return recalled_step._period(k, r, 2), [A, 0.5 * A, lines, shares[0], flow, x, right]
        case "stack":
            places = tuple(tuple(range(i % k, k)) for i in range(r))
            size = sum(map(len, places))
            given = [b, positive(rng, k).ravel(), rng.normal(size=3 * size), rng.normal(size=3 * r)]
            given += [rng.normal(size=size), shares[0], shares[1], np.array([1.0, 0.5, 1e-3])]
            return sample_stack(places, 3, k, is_whole=True), given
        case "filter":
            return low_pass._washed_out(len(A)), [A, A[::-1], 0.5 * A, np.array([10.0, 0.99, 0.4, 0.3])]
        case "hold":
            return low_pass._low_pass(len(A)), [A, A[::-1], np.array([0.99, 0.01])]
        case "scale":
            return symmetric._scaler(len(A)), [A, np.array([0.7])]
    learns = name == "learn"
    return symmetric._updater(k, r, learns=learns), [A, b, W, *shares, np.array([0.8])]


OPERATIONS = ["product", "rows", "solve", "rank", "scale", "filter", "hold", "recall", "stack", "learn", "forget"]
NAMES = pytest.mark.parametrize("name", OPERATIONS)


@pytest.mark.parametrize("lanes", [1, 4])
def test_pieces_beside_loops_have_the_bits_of_the_whole(lanes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are a module of their own, made at another level of optimization."""
    product, k = symmetric._product(14), 14

    def equation(A: Column, b: Column) -> tuple[Column, Column]:
        (first,) = product(A, b)
        (then,) = product(A, Column(where(x < 0.0, sin(x), y * x - 1.0) for x, y in zip(first, b, strict=True)))
        return then, Column(map(cos, then))

    def values() -> list[Any]:
        ensemble = compile_step(equation, state={}, constants={"A": 105, "b": k}, lanes=lanes).ensemble(2 * lanes - 1)
        rng = np.random.default_rng(0)
        ensemble.held["A"] = rng.normal(size=(ensemble.members, 105))
        ensemble.held["b"] = rng.normal(size=(ensemble.members, k))
        return [part.tolist() for part in ensemble.run()]

    routine, whole = trace(equation, {"A": 105, "b": k}), values()
    made = program(routine, Lanes(lanes))
    assert not made.pieces
    assert not made.quick
    monkeypatch.setattr(llvm, "MAX_WHOLE_EXPRESSIONS", 0)
    monkeypatch.setattr(llvm, "PIECE_EXPRESSIONS", 20)
    assert program(routine, Lanes(lanes)).pieces
    assert values() == whole


def bits(columns: Any) -> list[list[float]]:
    return [np.asarray(part, dtype=np.float64).tolist() for part in columns]


@NAMES
@settings(max_examples=12, deadline=None)
@given(k=SIZES, r=st.integers(1, 7), seed=st.integers(0, 2**32 - 1))
def test_floats_and_samples_have_the_same_bits(name: str, k: int, r: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    operation, arguments = operation_and_arguments(name, k, r, rng)
    straight = bits(operation._unrolled([column(x) for x in arguments]))
    assert bits(operation._sampled([column(x) for x in arguments])) == straight
    several = [Column(np.stack([x, 2.0 * x], axis=-1)) for x in arguments]
    assert [np.asarray(part.of)[:, 0].tolist() for part in operation._sampled(several)] == straight


UNFUSED = Processor.host().limited("sse2") if "sse2" in usable() else Processor.host()


def native(operation: MatrixOperation, arguments: list[Array], lanes: int, processor: Processor) -> list[list[float]]:
    """Results of one step whose constants are the arguments, of the last of five members."""
    columns = {f"x{k}": len(x) for k, x in enumerate(arguments)}
    outputs = {f"y{k}": shape.size for k, shape in enumerate(operation.routine.shapes[1])}

    def step(**given: Column) -> tuple[Column, ...]:
        return operation(*(given[name] for name in columns))

    stepper = compile_step(step, state=outputs, constants=columns, lanes=lanes, name="step", processor=processor)
    members = stepper.ensemble(5)
    for name, x in zip(columns, arguments, strict=True):
        members.held[name] = np.linspace(2.0, 1.0, 5)[:, None] * x
    members.run(steps=1)
    return [members.state[name][-1].tolist() for name in outputs]


@pytest.mark.skipif("sse2" not in usable(), reason="products and sums are fused")
@NAMES
@pytest.mark.parametrize("lanes", mostly_at_night([1, 2, 4], 2))
@settings(max_examples=2, deadline=None)
@given(k=SIZES, r=st.integers(1, 7), seed=st.integers(0, 2**32 - 1))
def test_native_loops_without_fused_operations_have_the_bits_of_floats(
    name: str, lanes: int, k: int, r: int, seed: int
) -> None:
    operation, arguments = operation_and_arguments(name, k, r, np.random.default_rng(seed))
    straight = bits(operation._unrolled([column(x) for x in arguments]))
    assert native(operation, arguments, lanes, UNFUSED) == straight


@NAMES
@pytest.mark.parametrize("k", mostly_at_night([13, 15, 36, 37], 13, 36))
def test_native_loops_in_lanes_have_the_bits_of_one(name: str, k: int) -> None:
    operation, arguments = operation_and_arguments(name, k, 3, np.random.default_rng(k))
    one = native(operation, arguments, 1, Processor.host())
    assert native(operation, arguments, Processor.host().lanes, Processor.host()) == one
    for found, straight in zip(one, operation._unrolled([column(x) for x in arguments]), strict=True):
        np.testing.assert_allclose(found, straight.of, rtol=1e-9, atol=1e-9)


@NAMES
def test_loops_in_c_have_the_bits_of_floats(name: str) -> None:
    """And the stack that is told holds all the numbers that they declare."""
    operation, arguments = operation_and_arguments(name, 13, 3, np.random.default_rng(0))
    sizes = {f"x{k}": len(x) for k, x in enumerate(arguments)}
    routine = trace(lambda **given: operation(*given.values()), sizes)
    program = CProgram("a", CNumber("double", {}))
    source = program.source(routine, program.on_arrays(routine, "a_f", list(sizes)))
    made = [[np.nan] * size for size in routine.layout.sizes]
    functions_of(source.text, "a")["a_f"](*(x.tolist() for x in arguments), *made)
    assert made == bits(operation._unrolled([column(x) for x in arguments]))
    loops = source.text[: source.text.index("static void a_f(")]
    declared = [int(size or 1) for size in re.findall(r"^ *a_real \w+(?:\[(\d+)\])?(?:;| = {)", loops, re.MULTILINE)]
    assert source.stack >= 8 * sum(declared)


@settings(max_examples=20, deadline=None)
@given(k=SIZES, r=st.integers(1, 5), seed=st.integers(0, 2**32 - 1))
def test_the_algebra_is_that_of_numpy(k: int, r: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, b, W, weights = positive(rng, k), rng.normal(size=k), rng.normal(size=(r, k)), rng.uniform(size=r)
    entries, x = column(triangle(A)), column(b)
    np.testing.assert_allclose(symmetric_product(entries, x).of, A @ b, atol=1e-10)
    np.testing.assert_allclose(solve(entries, x, 1.0).of, np.linalg.solve(A + np.eye(k), b), atol=1e-9)
    after = rank_update(entries, [column(w) for w in W], column(weights), 0.9, 0.5)
    expected = 0.9 * (A + 0.5 * np.eye(k)) + W.T @ np.diag(weights) @ W
    np.testing.assert_allclose(after.of, triangle(expected), atol=1e-10)


@settings(max_examples=20, deadline=None)
@given(k=SIZES, r=st.integers(1, 7), learned=st.sampled_from([0.0, 0.7]), seed=st.integers(0, 2**32 - 1))
def test_equations_are_learned_one_after_the_other(k: int, r: int, learned: float, seed: int) -> None:
    """The products of all rows are taken at once; what they make is what a loop over the equations makes."""
    rng = np.random.default_rng(seed)
    A, z, W = positive(rng, k), rng.normal(size=k), rng.normal(size=(r, k))
    equations = [Equation(column(w), 0.3, 1e-9, 0.5, learned, 0.2) for w in W]
    found = directional_update(column(triangle(A)), column(z), equations, 0.9)
    A = 0.9 * A
    for w in W:
        g = A @ w
        loss = 0.3 / (w @ g + 1e-9)
        z = z - loss * (w @ z - 0.5) * g + 0.2 * w
        A = A - loss * np.outer(g, g) + learned * np.outer(w, w)
    for part, expected in zip(found, (triangle(A), z), strict=True):
        np.testing.assert_allclose(part.of, expected, rtol=1e-7, atol=1e-7)


@settings(max_examples=30, deadline=None)
@given(k=SIZES, rank=st.integers(0, 45), negative=st.integers(0, 45), seed=st.integers(0, 2**32 - 1))
def test_pivots_of_no_size_leave_zeros_and_nothing_that_is_not_finite(
    k: int, rank: int, negative: int, seed: int
) -> None:
    """Semidefinite, indefinite and negative matrices, as loops and as samples."""
    rng = np.random.default_rng(seed)
    basis, _ = np.linalg.qr(rng.normal(size=(k, k)))
    values = np.where(np.arange(k) < rank, 1.0, 0.0) * np.where(np.arange(k) < negative, -1.0, 1.0)
    entries, b = triangle(basis @ np.diag(values) @ basis.T), rng.normal(size=k)
    kernel = compile_function(lambda A, b: solve(A, b), {"A": len(entries), "b": k}, name="solve")
    assert np.isfinite(kernel(entries, b)).all()
    assert np.isfinite(solve(column(entries), column(b)).of).all()


@pytest.mark.parametrize("k", [3, 20])
def test_where_nothing_is_known_nothing_is_solved(k: int) -> None:
    """A zero matrix and one that is negative give zeros; a pivot that is left stands for itself."""
    b = np.ones(k)
    for diagonal in (np.zeros(k), -np.ones(k)):
        assert solve(column(triangle(np.diag(diagonal))), column(b)).of == (0.0,) * k
    half = np.where(np.arange(k) % 2, 2.0, 0.0)
    assert solve(column(triangle(np.diag(half))), column(b)).of == tuple(np.where(np.arange(k) % 2, 0.5, 0.0))


@pytest.mark.parametrize("k", [3, 20])
def test_an_equation_whose_denominator_is_not_positive_takes_nothing(k: int) -> None:
    rng = np.random.default_rng(0)
    A, z, w = -positive(rng, k), rng.normal(size=k), rng.normal(size=k)
    after, left = directional_update(column(triangle(A)), column(z), [Equation(column(w), 0.5, 1e-300)])
    assert np.array_equal(after.of, triangle(A))
    assert np.array_equal(left.of, z)


def test_derivatives_pass_through_an_operation() -> None:
    """Of dual numbers: d (A + 1)^-1 b = (A + 1)^-1 db."""
    A, b, k = positive(np.random.default_rng(1), 15), np.ones(15), 15
    moved = solve(column(triangle(A)), Column(Dual(1.0, 1.0) for _ in b), 1.0)
    np.testing.assert_allclose([x.slope for x in moved], np.linalg.solve(A + np.eye(k), b), rtol=1e-9)


@pytest.mark.parametrize("k", [13, 36])
def test_operations_are_counted(k: int) -> None:
    """As many as are carried out on floats, by hand for a product: k^2 products and sums, and the factor of A."""
    routine = trace(symmetric_product, {"entries": k * (k + 1) // 2, "x": k}, name="product")
    (called,) = routine.subroutines
    assert routine.operations == called.operations
    assert called.operations[Op.MULTIPLY] == k * k + k * (k + 1) // 2
    assert called.operations[Op.ADD] == k * k


def test_columns_beside_those_asked_for_are_never_kept() -> None:
    """Loops that begin and end anywhere, over two variables and over none."""

    def body(m: Interpreter, x: Any, out: Any) -> None:
        inner, last = m.scratch(3, 21), m.scratch(21)
        for i in m.range(3):
            for j in m.columns(5 * i + 1, 21):
                inner[i, j] = x[j] * 2.0
        for j in m.columns(3, 21):
            first, second = m.variable(inner[0, j]), m.variable(1.0)
            for i in m.range(1, 3):
                first.value = first.value + inner[i, j]
                second.value = second.value * first.value
            last[j] = second.value
        for j in m.columns(0, 3):
            out[j] = x[j]
        for j in m.columns(3, 19):
            out[j] = last[j]
        for j in m.columns(19, 21):
            out[j] = x[j]

    operation = MatrixOperation(body, [vector(21)], [vector(21)], 21)
    x = np.linspace(0.5, 1.5, 21)
    straight = bits(operation._unrolled([column(x)]))
    assert native(operation, [x], 1, UNFUSED) == straight
    assert native(operation, [x], 2, UNFUSED) == straight
    assert bits(operation._sampled([column(x)])) == straight
