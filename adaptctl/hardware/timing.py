"""Times of a loop."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from adaptctl.arrays import Array

TOLERANCE = 0.2
"""share of a period by which it may be off and still be learned from"""
BINS, WIDTH = 60, 0.05
"""number and width, in periods, of the histogram's bins"""


class LoopTimes:
    """
    Histogram of a loop's periods.

    Parameters
    ----------
    period : float
        Control period in s.

    Notes
    -----
    `histogram` counts periods by their length in steps of 0.05 periods, the last bin all longer ones; `off` counts
    those more than 20 % off, `longest_late` is the longest run of late ones, `worst` the longest period in s, `busy`
    the longest time in s between a measurement and its torque.

    Examples
    --------
    >>> from adaptctl.hardware import LoopTimes
    >>> times = LoopTimes(0.001)
    >>> times.count(0.001), times.count(0.0013)
    (True, False)
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self.histogram = np.zeros(BINS, dtype=np.int64)
        self.off = self.late = self.longest_late = 0
        self.worst = self.busy = 0.0

    def count(self, passed: float) -> bool:
        """
        Count a period.

        Parameters
        ----------
        passed : float
            Length in s.

        Returns
        -------
        bool
            True if it is as long as it should be, within 20 %.
        """
        ratio = passed / self.period
        self.histogram[min(max(int(ratio / WIDTH), 0), BINS - 1)] += 1
        self.worst = max(self.worst, passed)
        self.late = self.late + 1 if ratio > 1.0 + TOLERANCE else 0
        self.longest_late = max(self.longest_late, self.late)
        on_time = abs(ratio - 1.0) <= TOLERANCE
        self.off += not on_time
        return on_time

    def answered(self, since: float) -> None:
        """
        Note that a torque was sent.

        Parameters
        ----------
        since : float
            `time.perf_counter()` at its measurement.
        """
        self.busy = max(self.busy, time.perf_counter() - since)

    @property
    def edges(self) -> Array:
        """Edges of the histogram's bins in s."""
        return np.linspace(0.0, BINS * WIDTH * self.period, BINS + 1)


@contextmanager
def without_collections() -> Iterator[None]:
    """Context without garbage collections, which would stop a loop for milliseconds."""
    was = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
