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
    """Sums of the tracking errors (positions less the reference's) of a run of r joints over its control periods so
    far: Columns, vectors of scalars of any kind (floats, arrays, or symbols to be compiled), or arrays (M, r) or (M, 1)
    for M runs. From the period on in which the run diverges, an error being NaN or larger than its bound `beyond`, rad
    (m if prismatic), (r,), errors are not counted any more. Nothing is checked.

    `squares` (r,), rad^2 (m^2), are sums of the errors' squares, and `final_squares` (r,) those of the periods at the
    run's end over which its final error is taken; `largest` (r,), rad (m), are the errors' largest magnitudes.
    `outside` (1,) is the number of periods up to and including the last one with an error larger than its bound
    `within`, rad (m), (r,), 0 where there was none; `diverged` (1,) is the number of periods up to and including the
    one in which the run diverged, 0 where it did not; `joint` (1,) is the number, from 1, of the first joint whose
    error made it diverge, 0 where none did.
    """

    squares: Any
    """(r,) of the errors' squares"""
    final_squares: Any
    """(r,) the same since the time from which the final error counts"""
    largest: Any
    """(r,) the errors' largest magnitudes"""
    outside: Any
    """(1,) the number of control periods up to the last one with an error beyond `within`, that one included; 0 while
    none was"""
    diverged: Any
    """(1,) the number of control periods up to the first one with an error beyond `beyond`, that one included; 0 while
    none was"""
    joint: Any
    """(1,) the number of the first joint that was, from 1; 0 while none was"""


def sum_sizes(joints: int) -> dict[str, int]:
    """Lengths, by name, of the columns (vectors) that hold a run's `ErrorSums`, which are sums of tracking errors of r
    `joints`: r for "squares", "final_squares" and "largest", 1 for "outside", "diverged" and "joint". Nothing is
    checked."""
    return ErrorSums(joints, joints, joints, 1, 1, 1)._asdict()


def judged_by(joints: int) -> dict[str, int]:
    """Lengths, by name, of the columns (vectors) of the criteria for tracking errors of r `joints`. They are r for the
    bounds, rad (m if prismatic), of the errors' magnitudes, "within", to which a run is to return, and "beyond", past
    which it has diverged; 1 for "final", the zero-based index of the control period from which on errors count as
    final. Nothing is checked."""
    return {"within": joints, "beyond": joints, "final": 1}


def summed(clock: Scalar, error: Column, columns: Mapping[str, Column]) -> ErrorSums:
    """The `ErrorSums`, sums of a run's tracking errors, after one more control period, over Columns, vectors of scalars
    of any kind (floats, arrays, or symbols to be compiled).

    `clock` is the period's index, from 0, and `error` (r,) are its tracking errors, positions of r joints less the
    reference's, rad (m if prismatic). `columns` has, by name, the sums before the period, "squares", "final_squares"
    and "largest" (r,), "outside", "diverged" and "joint" (1,), and the criteria for errors: the bounds "within" and
    "beyond" (r,), rad (m), and "final" (1,), the index of the first period whose errors are final. An error that is NaN
    or larger than `beyond` makes the run diverge: from this period on all sums stay. Raises `KeyError` where a column
    is missing, `IndexError` where "beyond" is too short, `ValueError` where "within" or "largest" has another length.
    """
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
    """Summaries of the tracking errors, positions less the reference's, of M runs of r joints. Nothing is checked.

    (M, r), rad (m if prismatic): `rms_error`, root mean square, and `largest_error`, largest magnitude, both, in a run
    that diverged, of the time before, or NaN if no joint's bound for divergence was finite; `final_rms_error`, root
    mean square over the last SETTLED (2) s, NaN in shorter runs and those that diverged before. (M,): `return_time`, s,
    after which every error stayed within the bounds asked for, NaN where the last one did not or the run diverged;
    `diverged_at`, s, at which an error was first not finite or beyond the bound for divergence, NaN where none was;
    `diverged_joint`, the index from 0 of the first joint with such an error, -1 where none was.
    """

    rms_error: Array
    largest_error: Array
    final_rms_error: Array
    return_time: Array
    diverged_at: Array
    diverged_joint: NDArray[np.int64]


def summary(sums: ErrorSums, count: int, final: int, period: float, beyond: Array) -> ErrorSummary:
    """The `ErrorSummary` of M runs of r joints, from their `sums`, arrays (M, r) or (M, 1), after `count` control
    periods of `period` (s): root mean squares and largest magnitudes of tracking errors, rad (m if prismatic), and
    times of return and divergence, s.

    Errors count as final from the period of index `final` on. `beyond` (r,), rad (m), are the bounds by which runs
    diverged. In a run that diverged, `rms_error` and `largest_error` are NaN if all bounds are infinite; else they are
    of the time before. `final_rms_error` is NaN where a run diverged before the period `final` and where it is shorter
    than 2 s. Nothing is checked.
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
