"""Unscaled bases of null spaces, and the torque that a vector makes which is none."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

from adaptctl.identifiability.regrouping import null_residual, unscaled_bases


@given(st.integers(0, 2**32 - 1), st.integers(2, 8), st.data())
def test_unscaled_bases_are_orthonormal_and_span_the_scaled_vectors(seed: int, n: int, data: st.DataObject) -> None:
    rng, size = np.random.default_rng(seed), data.draw(st.integers(0, n))
    scaled = scipy.linalg.qr(rng.normal(size=(n, n)))[0][:, :size]
    scales = 10.0 ** rng.uniform(-3.0, 3.0, n)
    null, rest = unscaled_bases(scaled, scales)
    both = np.hstack((null, rest))
    np.testing.assert_allclose(both.T @ both, np.eye(n), atol=1e-13)
    assert null.shape == (n, size)
    vectors = scaled * scales[:, None]
    assert np.abs(rest.T @ (vectors / np.linalg.norm(vectors, axis=0))).max(initial=0.0) < 1e-12


def test_a_residual_is_the_torque_over_the_largest_that_could_be() -> None:
    """Of columns 1 and -4 a vector along the first makes 1, and the largest of its size would be 4; in any units."""
    regressor, along, null = np.array([[1.0, -4.0]]), np.array([[0.5], [0.0]]), np.array([[4.0], [1.0]])
    for scales in np.array([[1.0, 1.0], [1e-3, 1e-3]]):
        assert null_residual(regressor, along, scales) == pytest.approx(0.25, rel=1e-14)
        assert null_residual(regressor, np.hstack((null, along)), scales) == pytest.approx(0.25, rel=1e-14)
        assert null_residual(regressor, null, scales) == 0.0
    units = np.array([100.0, 1.0])
    assert null_residual(regressor / units, along * units[:, None], units) == pytest.approx(0.25, rel=1e-14)
    assert null_residual(0.0 * regressor, along, np.ones(2)) == 0.0
    assert null_residual(regressor, np.zeros((2, 0)), np.ones(2)) == 0.0


@given(st.integers(0, 2**32 - 1), st.integers(2, 8), st.data())
def test_small_rows_are_as_accurate_as_large_ones(seed: int, n: int, data: st.DataObject) -> None:
    """Entry by entry: what null vectors leave of a regressor in units that are up to 1e12 apart, against round-off."""
    rng, size = np.random.default_rng(seed), data.draw(st.integers(1, n - 1))
    orthogonal = scipy.linalg.qr(rng.normal(size=(n, n)))[0]
    scales = 10.0 ** rng.uniform(-6.0, 6.0, n)
    null, _ = unscaled_bases(orthogonal[:, :size], scales)
    assert null_residual(orthogonal[:, size:].T / scales, null, scales) < 1e-13
