"""Averages over a moving window."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array


def moving_mean(values: Array, window: float, sample_time: float) -> Array:
    """Means (T, ...) of values (T, ...) over a window in s before each sample."""
    count, rest = len(values), values.shape[1:]
    width = max(1, round(min(window / sample_time, count)))
    # Differences of one sum would be lost where values fall by many powers: sums begin anew with each block.
    padded = np.zeros(((count // width + 2) * width, *rest))
    padded[width - 1 : width - 1 + count] = values
    blocks = padded.reshape(-1, width, *rest)
    before = np.zeros_like(blocks)
    before[:, 1:] = np.cumsum(blocks[:, :-1], axis=1)
    after = np.cumsum(blocks[:, ::-1], axis=1)[:, ::-1].reshape(padded.shape)
    sums = after[:count] + before.reshape(padded.shape)[width : width + count]
    return np.asarray(sums / np.minimum(np.arange(1, count + 1), width).reshape(-1, *[1] * len(rest)))


def moving_rms(errors: Array, window: float, sample_time: float) -> Array:
    """Root mean squares (T,) of errors (T, r) over a window in s before each sample."""
    return np.sqrt(moving_mean(np.mean(errors**2, axis=1), window, sample_time))
