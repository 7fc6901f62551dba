"""Averages over a moving window."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array


def moving_mean(values: Array, window: float, sample_time: float) -> Array:
    """Means (T, ...) of values (T, ...) over a window in s before each sample."""
    sums = np.cumsum(np.concatenate((np.zeros_like(values[:1]), values)), axis=0)
    stop = np.arange(1, len(values) + 1)
    start = np.maximum(stop - max(1, round(min(window / sample_time, len(values)))), 0)
    count = (stop - start).reshape(-1, *[1] * (values.ndim - 1))
    with np.errstate(invalid="ignore"):
        return np.asarray((sums[stop] - sums[start]) / count)


def moving_rms(errors: Array, window: float, sample_time: float) -> Array:
    """Root mean squares (T,) of errors (T, r) over a window in s before each sample."""
    means = moving_mean(np.mean(errors**2, axis=1), window, sample_time)
    return np.sqrt(np.maximum(means, 0.0))
