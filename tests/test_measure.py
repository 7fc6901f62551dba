"""The regressor that excitation is measured by, and triangular factors, against whole matrices."""

from __future__ import annotations

import numpy as np
import pytest
from sampled_loops import full, reduced

from adaptctl.control import PriorRanges
from adaptctl.control.excitation.measure import _triangular, scaled_regressor
from adaptctl.identifiability import ReducedModel

ARM = "puma560_arm3"


@pytest.mark.parametrize("model", [reduced(ARM), full(ARM)], ids=["fundamental", "all"])
def test_a_scaled_regressor_is_the_torque_per_range_of_each_parameter(model: ReducedModel) -> None:
    """Column j is the torque by as much of parameter j as its range: large where little is known of it."""
    k = len(model.columns)
    rng = np.random.default_rng(0)
    motion, ranges = rng.normal(size=(4, 5, 3)), rng.uniform(0.2, 5.0, k)
    torques = [model.slotine_li_regressor(*motion) @ (ranges[j] * np.eye(k)[j]) for j in range(k)]
    expected = np.stack(torques, axis=-1)
    np.testing.assert_allclose(scaled_regressor(model, *motion, ranges), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        scaled_regressor(model, *motion),
        scaled_regressor(model, *motion, 1.0) * PriorRanges().for_parameters(model.names),
        rtol=1e-12,
    )


@pytest.mark.parametrize(("m", "k"), [(1, 1), (2, 5), (5, 5), (11, 5), (64, 3), (97, 4)])
def test_triangular_factors_have_the_gram_matrices_of_the_whole(m: int, k: int) -> None:
    rows = np.random.default_rng(m).normal(size=(3, m, k))
    R = _triangular(rows)
    assert R.shape == (3, k, k)
    np.testing.assert_allclose(R.mT @ R, rows.mT @ rows, atol=1e-12 * m)
