"""Means over moving windows are those of each window by itself."""

from __future__ import annotations

import numpy as np
import pytest

from adaptctl.recording.moving_average import moving_mean, moving_rms


@pytest.mark.parametrize("count", [1, 2, 7, 10, 100])
@pytest.mark.parametrize("width", [1, 2, 5, 7, 10, 200])
def test_a_mean_is_that_of_its_window(count: int, width: int) -> None:
    values = np.random.default_rng(0).normal(size=(count, 2))
    own = [values[max(0, i + 1 - width) : i + 1].mean(axis=0) for i in range(count)]
    np.testing.assert_allclose(moving_mean(values, 0.5 * width, 0.5), own, rtol=1e-12, atol=1e-14)


def test_errors_that_fall_by_many_powers_are_not_lost_in_round_off() -> None:
    """Squares of 100 mrad at first are 1e18 times those of 1e-7 mrad at the end."""
    errors = 100.0 * np.exp(-np.arange(20_000) / 400.0)[:, None]
    left = errors[-250:]
    assert moving_rms(errors, 0.25, 1e-3)[-1] == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-12)
