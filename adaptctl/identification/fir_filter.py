"""Zero-phase filters of finite length, and derivatives through them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import firwin, oaconvolve

from adaptctl.arrays import Array
from adaptctl.errors import InputError

WIDTH = 2.0
"""Length of a kernel, in periods of its cut-off."""
DIFFERENCE = np.array([-1.0, 8.0, 0.0, -8.0, 1.0]) / 12.0
"""Of fourth order, to convolve with: what it takes off a sine of a tenth of the rate is 0.5 %."""
AROUND = len(DIFFERENCE) // 2


def low_pass(cutoff: float, rate: float) -> Array:
    """The kernel (t,) of a low-pass filter without phase lag: symmetric weights that sum to 1, for a signal sampled at
    `rate` Hz. It halves the amplitude of a sine of `cutoff` Hz; t is 2 round(rate/cutoff) + 1. Raises `ValueError` for
    a cut-off below zero or not below half the rate, `ZeroDivisionError` for 0."""
    taps = 2 * round(0.5 * WIDTH * rate / cutoff) + 1
    return np.asarray(firwin(taps, cutoff, window=("kaiser", 5.0), fs=rate))


def padded(kernel: Array) -> Array:
    """The `kernel` (t,) of a filter, t weights, with two zeros before and two after, (t + 4,), so that it is as long as
    that of `derivative`. Nothing is checked."""
    return np.pad(kernel, AROUND)


def derivative(kernel: Array, rate: float) -> Array:
    """The kernel (t + 4,), 1/s, that gives the time derivative of a signal filtered by `kernel` (t,), t weights, by
    central differences of fourth order; `rate` is the signal's sampling rate (Hz). Its samples are at the same times as
    those of `padded(kernel)`, which filters the signal itself. Nothing is checked."""
    return np.convolve(kernel, DIFFERENCE) * rate


def filtered(signal: ArrayLike, kernel: Array, every: int = 1) -> Array:
    """The convolution (m, ...) of a `signal` (n, ...), along its first axis, with a filter's `kernel` (t,), in the
    signal's unit times the kernel's. It has the values at which the kernel lies wholly within the signal, n - t + 1 in
    all, or only every `every`-th of them (1 by default), beginning with the first; m is (n - t + 1)/every, rounded up.

    Nothing is assumed of the signal beyond its ends, so there is no transient. Raises `InputError` for a signal that is
    shorter than the kernel.
    """
    values = np.asarray(signal, dtype=np.float64)
    if len(values) < len(kernel):
        raise InputError(f"signal: expected at least {len(kernel)} samples, as the kernel has, got {len(values)}")
    flat = values.reshape(len(values), -1)
    if every == 1:
        out = oaconvolve(flat, kernel[:, None], mode="valid", axes=0)
    else:
        count = len(flat) - len(kernel) + 1
        out = sum((weight * flat[k : k + count : every] for k, weight in enumerate(kernel[::-1])), np.zeros(()))
    return np.asarray(out).reshape(-1, *values.shape[1:])
