"""Small dense systems: as accurate as backward stable methods are, judged by exact fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adaptctl.arrays import Array
from adaptctl.dynamics.loops.posture import Factored, TwoByTwo, factored
from adaptctl.scalars import Column

EPSILON = float(np.finfo(np.float64).eps)


def solved(A: Array, b: Array) -> Array:
    return np.array(Factored([Column(column) for column in A.T.tolist()]).solve(Column(b.tolist())).of)


def exact(A: Array, b: Array) -> Array:
    """The least-squares solution of these very floats, by normal equations in fractions."""
    columns = [[Fraction(x) for x in column] for column in A.T.tolist()]
    right = [Fraction(x) for x in b.tolist()]
    rows = [
        [sum((x * y for x, y in zip(one, other, strict=True)), Fraction()) for other in (*columns, right)]
        for one in columns
    ]
    for k, pivot in enumerate(rows):  # positive definite: no pivot vanishes
        for row in rows:
            if row is not pivot:
                factor = row[k] / pivot[k]
                row[:] = [x - factor * y for x, y in zip(row, pivot, strict=True)]
    return np.array([float(row[-1] / row[k]) for k, row in enumerate(rows)])


def assert_backward_stable(A: Array, b: Array) -> None:
    """Errors grow with the condition number, not with its square (Bjorck 1967)."""
    expected, condition = exact(A, b), float(np.linalg.cond(A))
    assert condition > 1e6
    error = np.linalg.norm(solved(A, b) - expected) / np.linalg.norm(expected)
    assert error < 30 * EPSILON * condition


@pytest.mark.parametrize("size", [6, 7, 8])
def test_vandermonde_systems(size: int) -> None:
    A = np.vander(np.linspace(1.0, 1.5, size), increasing=True)
    assert_backward_stable(A, A @ np.ones(size))


@pytest.mark.parametrize("small", [1e-6, 1e-7, 4e-8])
def test_lauchlis_columns(small: float) -> None:
    """Nearly parallel columns: what is left of the right-hand side decides all but the first unknown."""
    A = np.vstack([np.ones(4), small * np.eye(4)])
    assert_backward_stable(A, A @ np.array([1.0, -2.0, 3.0, 0.5]))


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 6), st.floats(6.5, 9.0))
def test_random_ill_conditioned_blocks(seed: int, size: int, digits: float) -> None:
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.normal(size=(size, size)))[0] for _ in range(2))
    A = left * np.geomspace(1.0, 10.0**-digits, size) @ right
    assert_backward_stable(A, A @ rng.normal(size=size))


@settings(max_examples=80, deadline=None)
@given(st.lists(st.floats(-10.0, 10.0), min_size=6, max_size=6))
def test_two_by_two_systems_are_solved_as_accurately(numbers: list[float]) -> None:
    A, b = np.array(numbers[:4]).reshape(2, 2), np.array(numbers[4:])
    if abs(A).max() < 1e-3 or np.linalg.cond(A) > 1e8:
        return
    found = np.array(factored([Column(column) for column in A.T.tolist()]).solve(Column(b.tolist())).of)
    error = np.abs(A @ found - b).max()
    assert error <= 50 * EPSILON * np.linalg.cond(A) * (np.abs(b).max() + 1e-300)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 1), (2, 2), (3, 2), (3, 3)])
def test_only_two_equations_of_two_unknowns_are_solved_by_determinants(rows: int, columns: int) -> None:
    A = np.random.default_rng(rows + columns).normal(size=(rows, columns))
    system = factored([Column(column) for column in A.T.tolist()])
    assert isinstance(system, TwoByTwo) == (rows == columns == 2)
    found = np.array(system.solve(Column((A @ np.ones(columns)).tolist())).of)
    np.testing.assert_allclose(found, 1.0, rtol=1e-12)
