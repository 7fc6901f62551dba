"""Summaries of a run's errors that are kept while it runs, so that no sample has to be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.scalars import Column, Scalar, absolute, maximum, where

SETTLED = 2.0
"""s at the end of a run over which its final error is taken."""
LARGEST = float(np.finfo(np.float64).max)


class ErrorSums(NamedTuple):
    """Sums of tracking errors over the control periods so far, until a run diverges; as columns, or as arrays (M,
    n)."""

    squares: Any
    """(r,) of the errors' squares"""
    final_squares: Any
    """(r,) the same since the time from which the final error counts"""
    largest: Any
    """(r,) the errors' largest magnitudes"""
    outside: Any
    """(1,) the number of control periods when an error was last beyond `within`, that one included"""
    diverged: Any
    """(1,) the number of control periods before an error was first beyond `beyond`, less one; 0 while none was"""
    joint: Any
    """(1,) the number of the first joint that was, from 1; 0 while none was"""


def sum_sizes(joints: int) -> dict[str, int]:
    """Lengths of the sums' columns, by name."""
    return ErrorSums(joints, joints, joints, 1, 1, 1)._asdict()


def judged_by(joints: int) -> dict[str, int]:
    """Lengths, by name, of the columns that errors are judged by: bounds, and the control period from which they are
    final."""
    return {"within": joints, "beyond": joints, "final": 1}


def summed(clock: Scalar, error: Column, columns: Mapping[str, Column]) -> ErrorSums:
    """The sums after a control period, whose number is on the clock, with these tracking errors (r,)."""
    before = ErrorSums(*(columns[name] for name in ErrorSums._fields))
    sizes = Column(map(absolute, error))
    joint = before.joint[0]
    for i in reversed(range(len(sizes))):
        sound = where(sizes[i] <= columns["beyond"][i], 1.0, 0.0)  # what is not a number is beyond
        joint = where(before.joint[0] > 0.5, before.joint[0], where(sound > 0.5, joint, i + 1.0))
    runs, first = joint < 0.5, before.joint[0] < 0.5
    counted = Column(where(runs, x, 0.0) for x in error)
    late = where(clock < columns["final"][0], 0.0, 1.0)
    squares = counted * counted
    outside = before.outside[0]
    for size, bound in zip(sizes, columns["within"], strict=True):
        outside = where(size <= bound, outside, clock + 1.0)
    return ErrorSums(
        before.squares + squares,
        before.final_squares + late * squares,
        Column(where(runs, maximum(x, y), x) for x, y in zip(before.largest, sizes, strict=True)),
        Column((where(runs, outside, before.outside[0]),)),
        Column((where(runs, 0.0, where(first, clock + 1.0, before.diverged[0])),)),
        Column((joint,)),
    )


class ErrorSummary(NamedTuple):
    """Summaries of the tracking errors of M runs of r joints, rad or m, and of when they returned or diverged, s."""

    rms_error: Array
    largest_error: Array
    final_rms_error: Array
    return_time: Array
    diverged_at: Array
    diverged_joint: NDArray[np.int64]


def summary(sums: ErrorSums, count: int, final: int, period: float, beyond: Array) -> ErrorSummary:
    """Summaries of sums (M, n) after `count` control periods of `period` s, of which those from `final` on are final.

    Where no bound was asked for, the errors of runs that diverged are NaN; so are final ones of runs too short to have
    a beginning besides.
    """
    joint = sums.joint[:, 0].astype(np.int64) - 1
    lost = joint >= 0
    counted = np.where(lost, sums.diverged[:, 0] - 1.0, count)
    rms = np.sqrt(sums.squares / np.maximum(counted, 1.0)[:, None])
    last = np.sqrt(sums.final_squares / np.maximum(counted - final, 1.0)[:, None])
    last[(counted <= final) | (count < round(SETTLED / period))] = np.nan
    largest = sums.largest.copy()
    if np.isinf(beyond).all():
        rms[lost], largest[lost] = np.nan, np.nan
    back = np.where(lost | (sums.outside[:, 0] >= count), np.nan, sums.outside[:, 0] * period)
    gone = np.where(lost, counted * period, np.nan)
    return ErrorSummary(rms, largest, last, back, gone, joint)
