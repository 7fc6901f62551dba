"""Zero-phase filters of finite length, and derivatives through them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import firwin, oaconvolve

from adaptctl.arrays import Array

WIDTH = 2.0
"""Length of a kernel, in periods of its cut-off."""
DIFFERENCE = np.array([-1.0, 8.0, 0.0, -8.0, 1.0]) / 12.0
"""Of fourth order, to convolve with: what it takes off a sine of a tenth of the rate is 0.5 %."""
AROUND = len(DIFFERENCE) // 2


def low_pass(cutoff: float, rate: float) -> Array:
    """A symmetric kernel of odd length that halves a sine of `cutoff` Hz at a sampling rate (Hz)."""
    taps = 2 * round(0.5 * WIDTH * rate / cutoff) + 1
    return np.asarray(firwin(taps, cutoff, window=("kaiser", 5.0), fs=rate))


def padded(kernel: Array) -> Array:
    """The kernel (t,) with zeros around it, as long as that of its derivative."""
    return np.pad(kernel, AROUND)


def derivative(kernel: Array, rate: float) -> Array:
    """The kernel of `padded(kernel)`'s derivative in time, at a sampling rate (Hz)."""
    return np.convolve(kernel, DIFFERENCE) * rate


def filtered(signal: ArrayLike, kernel: Array, every: int = 1) -> Array:
    """The signal (n, ...) through a kernel (t,), every so many samples of the n - t + 1 where it fits wholly.

    Nothing is assumed of the signal beyond its ends, so there is no transient.
    """
    values = np.asarray(signal, dtype=np.float64)
    flat = values.reshape(len(values), -1)
    if every == 1:
        out = oaconvolve(flat, kernel[:, None], mode="valid", axes=0)
    else:
        count = len(flat) - len(kernel) + 1
        out = sum((weight * flat[k : k + count : every] for k, weight in enumerate(kernel[::-1])), np.zeros(()))
    return np.asarray(out).reshape(-1, *values.shape[1:])
