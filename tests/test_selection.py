"""Independent rows and columns: the same as in exact arithmetic, and as by pivoted Householder factors."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from hypothesis import assume, given
from hypothesis import strategies as st

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.identifiability.regrouping import Regrouping, independent_columns, removable


def test_round_off_does_not_pass_for_independence() -> None:
    """Läuchli's rows (1961): orthogonalised once, directions are off by their distance, e = 7e-9.

    The third row is (first - second) / e without rounding, so nothing is left of it; orthogonalised once, e is.
    """
    e = 2.0**-27
    rows: Array = np.array([[1, e, 0, 0], [1, 0, e, 0], [0, 1, -1, 0], [1, 0, 0, e], [0, 1, 0, 0]])
    assert removable(rows, range(5), 1e-9) == (0, 1, 3, 4)


@given(st.integers(0, 2**32 - 1), st.integers(1, 8), st.integers(0, 8), st.floats(0.0, 9.0))
def test_nearly_dependent_rows_are_told_apart(seed: int, needed: int, more: int, decades: float) -> None:
    """Against what Householder factors of the rows before leave of each, by definition of the walk."""
    rng = np.random.default_rng(seed)
    near = rng.normal(size=needed) + np.logspace(0, -decades, needed)[:, None] * rng.normal(size=(needed, needed))
    rows = np.linalg.qr(np.vstack([near, rng.normal(size=(more, needed))]))[0]
    tolerance = 1e-3 / np.sqrt(len(rows))
    taken: list[int] = []
    for j, row in enumerate(rows):
        span = np.linalg.qr(rows[taken].T)[0]
        left = np.linalg.norm(row - span @ (span.T @ row))
        assume(abs(left / tolerance - 1.0) > 1e-3)
        taken += [j] if left > tolerance and len(taken) < needed else []
    assert removable(rows, range(len(rows)), tolerance) == tuple(taken)


@given(st.integers(0, 2**32 - 1), st.integers(1, 8), st.integers(1, 8))
def test_without_a_tolerance_columns_are_pivoted_by_size(seed: int, rows: int, columns: int) -> None:
    matrix = np.random.default_rng(seed).normal(size=(rows, columns))
    taken, directions = independent_columns(matrix, np.inf, 0.0)
    _, R, pivots = scipy.linalg.qr(matrix, pivoting=True, mode="economic")
    assert taken == pivots[: min(rows, columns)].tolist()
    np.testing.assert_allclose(directions @ directions.T, np.eye(len(taken)), atol=1e-10)
    np.testing.assert_allclose(np.abs(directions @ matrix[:, pivots]), np.abs(R), atol=1e-10)


@given(st.integers(0, 2**32 - 1))
def test_no_column_is_taken_twice(seed: int) -> None:
    """What round-off leaves of the first columns is larger than the last ones."""
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(8, 8)) * np.logspace(0, -40, 8)
    assert independent_columns(matrix, np.inf, 0.0)[0] == list(range(8))


def test_the_first_beyond_the_tolerance_is_taken_before_the_largest() -> None:
    columns = np.array([[1e-4, 1.0, 2.0, 0.0], [0.0, 0.0, 1e-5, 0.0]])
    assert independent_columns(columns, 1e-3, 1e-8)[0] == [1, 2]
    assert independent_columns(columns, 1e-5 / 2, 1e-8)[0] == [0, 2]
    assert independent_columns(columns, 1e-3, 1e-4)[0] == [1]


@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(1, 6))
def test_the_condition_of_a_regrouping_is_within_its_bound(seed: int, k: int, removed: int) -> None:
    """F2'V2 for V2 = [-C; 1] Z, orthonormal, has the singular values of (1 + C'C)^-1/2."""
    C = np.random.default_rng(seed).normal(scale=3.0, size=(k, removed))
    found = Regrouping(tuple(range(k)), tuple(range(k, k + removed)), C, k)
    values = np.linalg.svd(C, compute_uv=False)
    assert found.bound >= np.sqrt(1.0 + values[0] ** 2) * (1.0 - 1e-12)
    own = Regrouping((0,), (1,), np.array([[3.0]]), 1)
    assert own.bound == np.sqrt(10.0)
    assert Regrouping((0,), (), np.zeros((1, 0)), 1).bound == 1.0


@pytest.mark.parametrize(("largest", "determined"), [(1.0, True), (9.9e3, True), (1.1e4, False)])
def test_a_condition_beyond_bounds_determines_nothing(largest: float, determined: bool) -> None:
    """One removed parameter of two that are far apart: the condition is about the coefficient itself."""
    found = Regrouping((0,), (1, 2), np.array([[largest, 0.0]]), 1)
    assert found.condition == pytest.approx(np.sqrt(1.0 + largest**2), rel=1e-12)
    assert found.determined is determined


def test_a_condition_within_bounds_is_enough_where_its_bound_is_not() -> None:
    found = Regrouping((0, 1), (2, 3), 1e5 * np.eye(2), 2)
    assert found.bound > 1e4 > found.condition
    assert found.determined


@pytest.mark.parametrize("negligible", [0.0, 1e-12])
def test_zeros_have_no_independent_columns(negligible: float) -> None:
    taken, directions = independent_columns(np.zeros((3, 4)), np.inf, negligible)
    assert (taken, directions.shape) == ([], (0, 3))


@pytest.mark.parametrize("tolerance", [0.0, -1.0, 0.5, np.nan])
def test_a_tolerance_that_could_not_find_all_rows_is_refused(tolerance: float) -> None:
    """Of four rows it must be below a half."""
    with pytest.raises(InputError, match=r"tolerance: expected a number between 0 and 0\.5"):
        removable(np.eye(4)[:, :2], range(4), tolerance)
