"""Vectors, columns and dual numbers keep the laws of their algebra."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adaptctl.compilation import Op, trace
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import (
    ZERO,
    Column,
    Dual,
    Mat,
    Vec,
    absolute,
    clip,
    column,
    cos,
    cross,
    dot,
    each,
    log,
    maximum,
    minimum,
    product,
    sin,
    spread,
    sqrt,
    where,
)

reals = st.floats(-3.0, 3.0)
vectors = st.builds(Vec, reals, reals, reals)


@given(vectors, vectors, vectors)
def test_triple_product_is_cyclic(a: Vec, b: Vec, c: Vec) -> None:
    assert dot(a, cross(b, c)) == pytest.approx(dot(b, cross(c, a)), abs=1e-12)


@given(vectors)
def test_the_zero_vector_costs_no_operations(a: Vec) -> None:
    assert a + ZERO is a
    assert cross(a, ZERO) is ZERO
    assert dot(a, ZERO) == 0.0


@given(vectors, vectors)
def test_transpose_moves_across_the_inner_product(a: Vec, b: Vec) -> None:
    m = Mat(Vec(1.0, 2.0, 3.0), Vec(-4.0, 5.0, 6.0), Vec(7.0, 8.0, -9.0))
    assert dot(a, m @ b) == pytest.approx(dot(m.T @ a, b), abs=1e-10)


def test_the_product_of_matrices_is_a_matrix() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 3, 3))
    for both in (Mat.of(a) @ Mat.of(b), product(Mat.of(a), Mat.of(b))):
        assert isinstance(both, Mat)
        np.testing.assert_allclose([list(row) for row in both], a @ b, rtol=1e-13)


@pytest.mark.parametrize("rows", [np.ones((2, 3)), np.ones((3, 2)), [[1.0], [1.0, 2.0], [3.0]], 3.0, [["a", 0, 0]] * 3])
def test_a_matrix_of_another_shape_is_refused(rows: object) -> None:
    with pytest.raises(InputError, match=r"matrix: expected"):
        Mat.of(rows)  # type: ignore[arg-type]
    with pytest.raises(NonFiniteError, match="matrix: expected finite numbers, got nan"):
        Mat.of(np.full((3, 3), np.nan))


def test_arrays_of_samples_multiply_vectors_and_columns() -> None:
    samples = np.array([1.0, 2.0])
    np.testing.assert_array_equal((samples * Vec(1.0, 0.0, 3.0)).z, [3.0, 6.0])
    np.testing.assert_array_equal((samples * Column((1.0, 2.0)))[1], [2.0, 4.0])


def test_a_scalar_multiplies_a_column_from_either_side() -> None:
    column, samples = Column((1.0, -2.0)), np.array([3.0, 4.0])
    assert (column * 2.0).of == (2.0 * column).of == (2.0, -4.0)
    np.testing.assert_array_equal((column * samples).of, (samples * column).of)
    traced = trace(lambda x, y: (x * y[0], y[0] * x), {"x": 2, "y": 1})
    assert traced.operations[Op.MULTIPLY] == 2  # the same two products from either side


def test_columns_of_different_lengths_do_not_add() -> None:
    with pytest.raises(ValueError, match="longer"):
        Column((1.0,)) + Column((1.0, 2.0))


@pytest.mark.parametrize("places", [(-1, 0), (0, 3), (1, 1), (0,), (0, 1, 2)])
def test_entries_are_spread_over_places_that_there_are_once_each(places: tuple[int, ...]) -> None:
    assert spread(Column((1.0, 2.0)), (2, 0), 3).of == (2.0, 0.0, 1.0)
    with pytest.raises(InputError, match=r"spread: expected 2 different indices from 0 to 2, got \[.*\]"):
        spread(Column((1.0, 2.0)), places, 3)


def test_lists_make_columns_and_a_number_makes_none() -> None:
    assert column([1, 2.5]).of == column((1.0, 2.5)).of == column(np.array([1.0, 2.5])).of == (1.0, 2.5)
    for wrong in (1.0, np.array(1.0), "ab", None):
        with pytest.raises(InputError, match="column: expected"):
            column(wrong)


def test_one_number_stands_for_each_entry_and_what_is_none_is_refused() -> None:
    dual, doubled = Dual(1.0, 2.0), trace(lambda x: sum(each(x[0], 2).of), {"x": 1})
    assert each(2.0, 2).of == each(np.float64(2.0), 2).of == each([2.0], 2).of == each(np.full(2, 2.0), 2).of
    assert each(dual, 2).of == (dual, dual)
    assert doubled.operations[Op.ADD] > 0
    wrongs = ("abc", "1", b"1", None, {1.0}, {}, True, 1j, ["a", "b", "c"], [1.0, 2.0], np.ones((3, 2)), [[1.0], "a"])
    for wrong in wrongs:
        with pytest.raises(InputError, match=r"each: expected .*3.*, got"):
            each(wrong, 3)


def everything(x: object) -> object:
    """Uses every function and operator once, smooth at the tested points."""
    y = sin(x) * cos(x) + sqrt(x * x + 1.0) / (2.0 + absolute(x)) - 1.0 / (x - 5.0)
    y = y + minimum(x, 10.0) * maximum(x, -10.0) + clip(x, -7.0, 7.0)
    return -where(x > 0.5, y * y, 3.0 - y)


@given(st.floats(-3.0, 3.0).filter(lambda x: min(abs(x), abs(x - 0.5)) > 1e-2))
def test_dual_numbers_differentiate(x: float) -> None:
    h = 1e-5
    slope = (everything(x + h) - everything(x - h)) / (2.0 * h)
    outcome = everything(Dual(x, 1.0))
    assert outcome.value == pytest.approx(everything(x), rel=1e-14)
    assert outcome.slope == pytest.approx(slope, rel=1e-6, abs=1e-6)


def test_dual_numbers_of_arrays_are_dual_numbers_of_their_entries() -> None:
    x = np.linspace(-2.0, 2.0, 7)
    together = everything(Dual(x, np.ones(7)))
    alone = [everything(Dual(float(entry), 1.0)) for entry in x]
    np.testing.assert_allclose(together.value, [d.value for d in alone], rtol=1e-14)
    np.testing.assert_allclose(together.slope, [d.slope for d in alone], rtol=1e-13)


def test_a_dual_number_may_not_steer_an_if() -> None:
    with pytest.raises(TypeError, match="where"):
        bool(Dual(1.0))


def test_a_derivative_that_there_is_not_is_an_error_of_floats_and_not_finite_in_arrays() -> None:
    for function in (sqrt, log):
        with pytest.raises(ZeroDivisionError):
            function(Dual(0.0, 1.0))
        with np.errstate(divide="ignore"):
            assert np.isinf(function(Dual(np.zeros(2), np.ones(2))).slope).all()


def test_functions_numpy_has_and_dual_numbers_have_not_are_refused() -> None:
    with pytest.raises(TypeError):
        np.arctan(Dual(1.0))


def test_elementary_functions_of_floats_stay_floats() -> None:
    assert sin(0.3) == math.sin(0.3)
    assert where(True, 1.0, 2.0) == 1.0
    assert where(np.bool_(False), 1.0, 2.0) == 2.0
