"""Filters and spectra of logs are those of SciPy's signal processing, which is too slow to load."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import median_filter
from scipy.signal import firwin, lfilter, oaconvolve, welch

from adaptctl.arrays import Array
from adaptctl.identification import convolution

RNG = np.random.default_rng(4)


def near(one: Array, other: Array) -> None:
    np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-12 * np.abs(other).max())


@pytest.mark.parametrize(("taps", "cutoff"), [(3, 40.0), (41, 10.0), (801, 2.5)])
def test_a_kernel_is_kaiser_s(taps: int, cutoff: float) -> None:
    near(convolution.windowed_sinc(taps, cutoff, 200.0), firwin(taps, cutoff, window=("kaiser", 5.0), fs=200.0))


@pytest.mark.parametrize(
    ("rows", "taps", "columns"), [(60, 5, 2), (3000, 401, 3), (50, 50, 1), (100, 1, 2), (999, 998, 1)]
)
def test_a_convolution_is_that_of_the_whole(rows: int, taps: int, columns: int) -> None:
    values, kernel = RNG.normal(size=(rows, columns)), RNG.normal(size=taps)
    near(convolution.convolved(values, kernel), oaconvolve(values, kernel[:, None], mode="valid", axes=0))


@pytest.mark.parametrize(("rows", "length"), [(1000, 64), (777, 65), (300, 300)])
@pytest.mark.parametrize("at_once", [1, 3, 100])
def test_a_spectrum_is_welch_s(rows: int, length: int, at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(convolution, "SEGMENTS_AT_ONCE", at_once)
    column = RNG.normal(size=rows)
    near(convolution.spectrum(column, 50.0, length), welch(column, 50.0, nperseg=length)[1])


def test_a_recursion_is_a_filter_s() -> None:
    coefficients, values = np.array([0.5, 0.2, -0.1, 0.05]), RNG.normal(size=(300, 4))
    near(convolution.recursed(coefficients, values), lfilter([1.0], [1.0, *-coefficients], values, axis=0))


@pytest.mark.parametrize("at_once", [3, 7, 499, 500, 1000])
def test_a_median_is_that_of_five(at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(convolution, "NUMBERS_AT_ONCE", at_once)
    column = np.round(RNG.normal(size=500), 1)
    assert np.array_equal(convolution.median_of_five(column), median_filter(column, 5, mode="nearest"))
