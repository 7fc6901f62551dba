"""Faults of a log's positions that no row shows by itself: slips, frozen stretches, equal columns, wrong stamps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description.joint import Joint

# Step over those of the rows around it, over the 99th percentile of steps, and in rad (m), from where on it is a slip.
SLIP_RATIO, SLIP_PERCENTILE_RATIO, LEAST_SLIP = 4.0, 8.0, 0.01
# Seconds and samples of one position, right before or after rows of a share of the top speed that move by so many of
# the smallest steps: joints stop and start gradually.
FROZEN_TIME, FROZEN_SAMPLES, SIDE, STOP_SHARE, LEAST_STEPS = 0.1, 20, 4, 0.25, 4.0
# Rows that are compared, and share of a period by which even stamps differ.
COMPARED, EVEN = 2**17, 0.1
# Of joints' speeds: the least over their noise, joints that have it, how far their ratios to those around differ at
# most, how far these are from 1, and the share and number of such rows.
CLEAR, LEAST_JOINTS, ALIKE, ODD, ODD_SHARE, ODD_ROWS = 5.0, 2, 0.15, 0.4, 5e-4, 5

# rad, beyond which angles that jump by full turns are in another unit: fifty turns.
FAR = 100.0 * np.pi


def other_unit(angles: Array) -> str:
    """Words on the unit that angles (n,) in rad may have instead, none where rad are likely."""
    if np.array_equal(angles, np.round(angles)):
        return "; it has whole numbers, as counts are: give their unit, such as position=rev/4096"
    reaches = f"; it goes from {angles.min():.4g} to {angles.max():.4g} rad: give its unit, such as position=mrad"
    return reaches if np.ptp(angles) > FAR else ""


def slips(values: Array, periods: Array, wrong: NDArray[np.bool_]) -> list[int]:
    """Rows to which a column steps, and stays there, where the rows around it move slowly."""
    steps = np.abs(np.diff(values)) / periods
    around = np.maximum(np.append(steps[1:], 0.0), np.append(0.0, steps[:-1]))
    most = max(SLIP_PERCENTILE_RATIO * float(np.percentile(steps, 99.0)), LEAST_SLIP)
    found = np.flatnonzero((steps > most) & (steps > SLIP_RATIO * around)) + 1
    return [row for row in found.tolist() if not (wrong[row - 1] or wrong[row])]


def slip_words(time: Array, values: Array, rows: Sequence[int], joint: Joint) -> Iterator[str]:
    """Sentence on the first of the rows at which a joint's encoder slips."""
    for row in rows[:1]:
        step, more = values[row] - values[row - 1], f", and so in {len(rows) - 1} more rows" if rows[1:] else ""
        yield (
            f"the position of joint {joint.name!r} steps by {step:.3g} {joint.kind.position_unit} in row {row + 1}, at "
            f"{time[row]:.6g} s, and stays there{more}: its encoder slipped, or rows are missing; cut the log there "
            "and give its parts as logs, the zero of each right"
        )


def frozen_position(time: Array, values: Array, joint: Joint) -> Iterator[str]:
    """Sentence on the longest stretch in which a position is the same, if the joint moved right before or after."""
    steps = np.abs(np.diff(values))
    edges = np.concatenate([[0], np.flatnonzero(steps) + 1, [len(values)]])
    at = int(np.argmax(np.diff(edges)))
    start, end = int(edges[at]), int(edges[at + 1])
    if end - start < FROZEN_SAMPLES or time[end - 1] - time[start] < FROZEN_TIME or not steps.any():
        return
    ways = np.abs(values[SIDE:] - values[:-SIDE])
    sides = [(a, a + SIDE) for a in (start - SIDE, end) if 0 <= a < len(values) - SIDE]
    moved = max((abs(float(values[b] - values[a])) for a, b in sides), default=0.0)
    quick = max(STOP_SHARE * float(np.percentile(ways, 99.0)), LEAST_STEPS * float(steps[steps > 0.0].min()))
    if moved > quick:
        held = f"frozen at {values[start]:.4g} {joint.kind.position_unit} from {time[start]:.6g} to {time[end - 1]:.6g}"
        yield f"the position of joint {joint.name!r} is {held} s; cut this stretch out of the log"


def equal_columns(what: str, columns: Sequence[Array], joints: Sequence[Joint]) -> Iterator[str]:
    """Sentences on two joints whose columns are the same."""
    for i, j in combinations(range(len(columns)), 2):
        if np.array_equal(columns[i][:COMPARED], columns[j][:COMPARED]) and np.ptp(columns[i][:COMPARED]) > 0.0:
            names = f"{joints[i].name!r} and {joints[j].name!r}"
            yield f"the {what} of joints {names} are equal in all rows: one column is a copy; record that of each joint"


def odd_stamps(time: Array, position: Array) -> list[str]:
    """
    Sentence on rows with even stamps in which all joints move alike much further or less far than around them.

    Then the stamps are wrong, such as numbers of rows, of which some were lost.
    """
    steps = np.diff(time)
    if float(np.percentile(np.abs(steps / np.median(steps) - 1.0), 99.0)) > EVEN:
        return []
    speeds = np.diff(position, axis=0) / steps[:, None]
    size = np.sqrt(np.mean(np.square(speeds), axis=0))
    speeds = speeds[:, size > 0.0] / size[size > 0.0]
    if len(speeds) < ODD_ROWS or speeds.shape[1] < LEAST_JOINTS:
        return []
    near = 0.5 * (speeds[:-2] + speeds[2:])
    ratio = np.sum(speeds[1:-1] * near, axis=1) / np.maximum(np.sum(near**2, axis=1), np.finfo(float).tiny)
    off = np.abs(speeds[1:-1] - ratio[:, None] * near)
    quantum = np.min(np.abs(speeds), axis=0, where=speeds != 0.0, initial=np.inf)
    clear = np.abs(near) > np.maximum(CLEAR * np.maximum(np.median(off, axis=0), quantum), ALIKE)
    told = (clear.sum(axis=1) >= LEAST_JOINTS) & np.all((off < ALIKE * np.abs(near)) | ~clear, axis=1)
    odd = told & (np.abs(ratio - 1.0) > ODD)
    count = int(odd.sum())
    if count < max(ODD_ROWS, ODD_SHARE * told.sum()):
        return []
    row = int(np.argmax(odd)) + 2
    return [
        f"in {count} rows, the first row {row + 1}, at {time[row]:.6g} s, all joints move {ratio[row - 2]:.2g} times "
        "as far as around it: rows were lost or came late, and the stamps do not say so; record each row's own time"
    ]
