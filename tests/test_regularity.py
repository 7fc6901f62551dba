"""Regularity of loops natively: determinants, and a bound that is sure."""

from __future__ import annotations

import numpy as np
import pytest
from sampled_loops import arm

from adaptctl.compilation import compile_function
from adaptctl.dynamics.loops.continuation import MIN_REGULARITY, determinant
from adaptctl.errors import InputError
from adaptctl.scalars import Column


@pytest.mark.parametrize("size", [1, 2, 3, 6])
def test_determinants_are_numpys(size: int) -> None:
    rng = np.random.default_rng(size)
    names = [f"row{k}" for k in range(size)]
    kernel = compile_function(lambda **rows: determinant(rows.values()), dict.fromkeys(names, size))
    for _ in range(20):
        matrix = rng.normal(size=(size, size))
        expected = np.linalg.det(matrix)
        assert kernel(*matrix) == pytest.approx(expected, rel=1e-10)
        assert determinant(map(Column, matrix.tolist())) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("leading", [0.0, 1e-20, 3.0])
def test_a_determinant_pivots_by_the_largest_of_its_column(leading: float) -> None:
    rows = [[leading, 1.0, 2.0], [1.0, 0.0, 3.0], [1.0, 0.0, -1.0]]
    assert determinant([Column(row) for row in rows]) == pytest.approx(np.linalg.det(rows), rel=1e-14)


@pytest.mark.parametrize("name", ["semi_direct_drive", "semi_direct_drive_parallelogram"])
def test_what_is_surely_regular_is_regular(name: str) -> None:
    continuation = arm(name).continuation
    assert continuation is not None
    sure = compile_function(continuation.surely_regular, {"q": len(continuation.reference)})
    rng = np.random.default_rng(0)
    near = continuation.reference + rng.uniform(-0.3, 0.3, (50, 3))[:, :1] * 0.0
    far = rng.uniform(-np.pi, np.pi, (2000, len(continuation.reference)))
    closed = continuation._closed(far[:, continuation.primary], far)
    q = np.concatenate((near, far, closed[np.isfinite(closed).all(axis=1)]))
    found, regularity = np.array([sure(row) for row in q]), continuation.regularity(q)
    assert np.all(regularity[found == 1.0] >= MIN_REGULARITY)
    assert found[0] == 1.0
    assert np.mean(found[regularity >= 2.0 * MIN_REGULARITY]) > 0.99


@pytest.mark.parametrize("name", ["semi_direct_drive", "semi_direct_drive_parallelogram"])
def test_regular_is_what_the_regularity_says(name: str) -> None:
    continuation = arm(name).continuation
    assert continuation is not None
    far = np.random.default_rng(1).uniform(-np.pi, np.pi, (300, len(continuation.reference)))
    closed = continuation._closed(far[:, continuation.primary], far)
    q = np.concatenate((closed, far, np.full((1, 5), np.nan), continuation.reference[None]))
    expected = continuation.regularity(q) >= MIN_REGULARITY
    assert expected.any()
    assert not expected.all()
    np.testing.assert_array_equal(continuation.is_regular(q), expected)
    np.testing.assert_array_equal(continuation.is_regular(q.reshape(2, -1, 5)), expected.reshape(2, -1))
    np.testing.assert_array_equal([continuation.is_regular(row) for row in q[::20]], expected[::20])
    assert continuation.is_regular(q[:0]).shape == (0,)
    with pytest.raises(InputError):
        continuation.is_regular(q[:, :4])
