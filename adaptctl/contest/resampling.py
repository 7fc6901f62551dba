"""Medians of paired ratios, with bootstrap intervals over seeds and families of robots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np

from adaptctl.arrays import Array

RESAMPLES, LEVEL = 1000, 0.95
"""bootstrap samples, and what the intervals hold"""


def median(values: Iterable[float]) -> float:
    """Median of numbers that are not NaN, or NaN."""
    known = np.fromiter(values, np.float64)
    known = known[~np.isnan(known)]
    with np.errstate(invalid="ignore"):  # between infinities of both signs
        return float(np.median(known)) if known.size else float("nan")


def median_interval(values: Array, families: Sequence[str]) -> Array:
    """Median of values (R, C, S) of R robots, NaN where there is none, and percentiles of it, (3,).

    Seeds are drawn anew with replacement, and so are families with all their robots, which are not independent."""
    flat = values.ravel()
    found = medians(flat, _counts(tuple(families), values.shape))
    known = found[~np.isnan(found)]
    if not known.size:
        return np.full(3, np.nan)
    tails = 100.0 * np.array([0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL])
    ends = np.percentile(known, tails, method="nearest")
    return np.array([median(flat), *ends])


def medians(values: Array, counts: Array) -> Array:
    """Medians (B,) of values (n,) that are there as often as counts (B, n) say, those of NaN left out."""
    order = np.argsort(values)
    ordered = values[order]
    upto = np.cumsum(counts[:, order] * ~np.isnan(ordered), axis=1)
    total = upto[:, -1]
    places = [(upto <= at[:, None]).sum(axis=1) for at in ((total - 1) // 2, total // 2)]
    low, high = (ordered[np.minimum(place, len(values) - 1)] for place in places)
    with np.errstate(invalid="ignore"):  # of two infinities that are the same
        middle: Array = np.where(low == high, low, 0.5 * (low + high))
    return np.where(total > 0, middle, np.nan)


@lru_cache(maxsize=2)  # for one condition and for all; each pair of laws asks
def _counts(families: tuple[str, ...], shape: tuple[int, ...]) -> Array:
    """Numbers (B, R C S) of times that runs are in each bootstrap sample."""
    rng, names = np.random.default_rng(0), sorted(set(families))
    seeds = _drawn(rng, shape[2])
    robots = _drawn(rng, len(names))[:, [names.index(family) for family in families]]
    counts = robots[:, :, None, None] * seeds[:, None, None, :]
    return np.broadcast_to(counts, (RESAMPLES, *shape)).reshape(RESAMPLES, -1)


def _drawn(rng: np.random.Generator, count: int) -> Array:
    """Numbers (B, count) of times that each of `count` is drawn."""
    drawn = rng.integers(0, count, (RESAMPLES, count))
    return np.asarray((drawn[:, :, None] == np.arange(count)).sum(axis=1))
