"""Filters, spectra and recursions of columns: what is needed of SciPy's signal processing, which takes long to load."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from adaptctl.arrays import Array

# Parameter of Kaiser's window, and numbers that a transform has at least, over the kernel's length.
KAISER, TRANSFORMED = 5.0, 8
# Segments of a spectrum and numbers of a median that are in memory at a time.
SEGMENTS_AT_ONCE, NUMBERS_AT_ONCE = 16, 2**16
# Rows that a recursion solves for at a time.
RECURSED = 64


def windowed_sinc(taps: int, cutoff: float, rate: float) -> Array:
    """Symmetric kernel (t,) of a low-pass filter that sums to 1, by Kaiser's window; `taps` is odd."""
    place = np.arange(taps) - 0.5 * (taps - 1)
    window = np.kaiser(taps, KAISER)
    kernel = np.sinc(2.0 * cutoff / rate * place) * window
    return np.asarray(kernel / kernel.sum())


def convolved(values: Array, kernel: Array) -> Array:
    """Convolution (m, k) of columns (n, k) with a kernel (t,), where that is wholly within them, by transforms."""
    taps, wanted = len(kernel), len(values) - len(kernel) + 1
    length = 1 << (TRANSFORMED * taps - 1).bit_length()
    length = min(length, 1 << (len(values) - 1).bit_length())
    step = length - taps + 1
    blocks = -(-wanted // step)
    whole = np.pad(values, ((0, (blocks - 1) * step + length - len(values)), (0, 0)))
    windows = sliding_window_view(whole, length, axis=0)[::step]
    spectrum = np.fft.rfft(windows) * np.fft.rfft(kernel, length)
    parts = np.fft.irfft(spectrum, length)[..., taps - 1 :]
    return np.asarray(parts.swapaxes(1, 2).reshape(-1, values.shape[1])[:wanted])


def spectrum(column: Array, rate: float, length: int) -> Array:
    """Power (f,) per Hz of a column (n,): mean of segments that overlap by half, under Hann's window (Welch 1967)."""
    step = length - length // 2
    count = (len(column) - length // 2) // step
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    total = np.zeros(length // 2 + 1)
    for first in range(0, count, SEGMENTS_AT_ONCE):
        part = column[first * step : (min(first + SEGMENTS_AT_ONCE, count) - 1) * step + length]
        segments = sliding_window_view(part, length)[::step]
        centred = segments - segments.mean(axis=1, keepdims=True)
        total += np.square(np.abs(np.fft.rfft(centred * window))).sum(axis=0)
    twice = np.full(len(total), 2.0)
    twice[0] = 1.0
    twice[length // 2 if length % 2 == 0 else len(total) :] = 1.0
    return np.asarray(twice * total / (count * rate * np.square(window).sum()))


def recursed(coefficients: Array, values: Array) -> Array:
    """Solution (n, k) of y_t = a_1 y_(t-1) + a_2 y_(t-2) + ... + x_t for columns (n, k) of x, from rest."""
    order, last = len(coefficients), np.zeros((len(coefficients), values.shape[1]))
    bands = np.eye(RECURSED) - sum(a * np.eye(RECURSED, k=-k - 1) for k, a in enumerate(coefficients.tolist()))
    solved, found = np.linalg.inv(bands), np.empty_like(values)
    carried = np.array([np.append(coefficients[i:], np.zeros(i)) for i in range(order)])[:, ::-1]
    for start in range(0, len(values), RECURSED):
        part = values[start : start + RECURSED].copy()
        part[:order] += (carried @ last)[: len(part)]
        found[start : start + RECURSED] = last = solved[: len(part), : len(part)] @ part
        last = last[-order:]
    return found


def median_of_five(column: Array) -> Array:
    """Medians (n,) of each number of a column and the two on either side, the ends repeated."""
    found = np.empty(len(column))
    for start in range(0, len(column), NUMBERS_AT_ONCE):
        first, last = max(start - 2, 0), min(start + NUMBERS_AT_ONCE + 2, len(column))
        around = (2 - start + first, 2 - max(last - start - NUMBERS_AT_ONCE, 0))
        part = np.pad(column[first:last], around, mode="edge")
        found[start : start + NUMBERS_AT_ONCE] = _medians(*sliding_window_view(part, 5).T)
    return found


def _medians(a: Array, b: Array, middle: Array, c: Array, d: Array) -> Array:
    low = np.maximum(np.minimum(a, b), np.minimum(c, d))
    high = np.minimum(np.maximum(a, b), np.maximum(c, d))
    return np.asarray(np.maximum(np.minimum(low, high), np.minimum(middle, np.maximum(low, high))))
