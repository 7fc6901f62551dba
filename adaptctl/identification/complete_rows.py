"""Rows of a log that have all numbers: what is left out, repeated or between two topics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.errors import FileError
from adaptctl.logs.on_disk import one_by_one
from adaptctl.logs.table import LogTable

# Periods of a column over which a straight line joins its numbers.
MAX_BRIDGED_PERIODS = 8.0
# Columns that number episodes, and periods between two of them.
EPISODES, PAUSE_PERIODS = ("episode_index", "episode"), 100.0
# Rows below which a column says nothing.
MIN_ROWS = 2


def complete_rows(log: LogTable, names: Sequence[str], time: str | None) -> LogTable:
    """Table whose rows have numbers in all the columns named, with a note on each kind of row left out."""
    names = [name for name in dict.fromkeys(names) if name in log.columns]
    stamped = [] if time is None or time not in log.columns else [time]
    empty = _empty(log, [*stamped, *names])
    if time is None and any(mask.any() for mask in empty.values()):
        count = int(np.any(list(empty.values()), axis=0).sum())
        raise FileError(
            f"{log.source}: {count} rows have empty cells, so that rows are not evenly spaced in time; give the column "
            "of time and not --sample-rate"
        )
    if stamped and names:
        log = _after_each_other(_without_empty(log, names, stamped[0]), stamped[0])
    log = _without_ends(log, [*stamped, *names])
    return _without_repeated(log, names, stamped[0]) if stamped and names else log


def _empty(log: LogTable, names: Sequence[str]) -> dict[str, NDArray[np.bool_]]:
    none = np.zeros(len(log), dtype=np.bool_)
    return {name: log.empty.get(name, none) for name in names}


def _without_empty(log: LogTable, names: Sequence[str], time: str) -> LogTable:
    """Table without rows of other topics, and with straight lines between the numbers of each topic."""
    empty = _empty(log, [time, *names])
    void = empty[time] | reduce(np.logical_and, [empty[name] for name in names])
    if void.all():
        raise FileError(f"{log.source}: the columns {', '.join(names)} are empty in all rows that have a {time!r}")
    log = log.rows(~void, f"{int(void.sum())} rows without content were left out")
    empty = _empty(log, names)
    if not any(mask.any() for mask in empty.values()):
        return log
    return _bridged(log, empty, time)


def _bridged(log: LogTable, empty: dict[str, NDArray[np.bool_]], time: str) -> LogTable:
    stamps, base = log.column(time, "time"), empty[next(iter(empty))]
    columns, kept = dict(log.columns), ~base
    for name, mask in empty.items():
        if (~mask).sum() < MIN_ROWS:
            count = f"{int((~mask).sum())} numbers, and empty cells else"
            raise FileError(f"{log.source}: column {name!r} has {count}; give another column, or a log that has it")
        columns[name], near = _lines(stamps, log.columns[name], ~mask)
        kept &= near
    filled = int(sum((mask & kept).sum() for mask in empty.values()))
    lost = int((~base & ~kept).sum())
    notes = [f"{filled} empty cells were filled by straight lines between the numbers around them"] if filled else []
    notes += [f"{lost} rows far from numbers of other columns were left out"] if lost else []
    if not kept.any():
        raise FileError(f"{log.source}: the columns {', '.join(empty)} have no numbers near to each other in time")
    whole = replace(log, columns=columns, empty={}, notes=(*log.notes, *notes))
    return replace(whole.rows(kept), notes=whole.notes)


def _lines(stamps: Array, values: Array, given: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Column on straight lines between its numbers, and a mask of the rows that are near to such on both sides."""
    own = stamps[given]
    far = MAX_BRIDGED_PERIODS * max(float(np.median(np.diff(own))), 0.0)
    after = np.searchsorted(own, stamps, side="left")
    inside = (stamps >= own[0]) & (stamps <= own[-1])
    width = own[np.minimum(after, len(own) - 1)] - own[np.maximum(after - 1, 0)]
    return np.where(given, values, np.interp(stamps, own, values[given])), given | (inside & (width <= far))


def _without_ends(log: LogTable, names: Sequence[str]) -> LogTable:
    """Table without rows at its ends that have no number, as before a publisher's first message."""
    columns = one_by_one(log.columns[name] for name in names)
    good = reduce(np.logical_and, map(np.isfinite, columns), np.ones(len(log), dtype=bool))
    if good.all() or not good.any():
        return log
    first, last = int(good.argmax()), len(good) - int(good[::-1].argmax())
    if any(name in log.words for name in names):
        return log
    kept = np.zeros(len(log), dtype=np.bool_)
    kept[first:last] = True
    return log.rows(kept, f"{int((~kept).sum())} rows at the ends that are not finite were left out")


def _without_repeated(log: LogTable, names: Sequence[str], time: str) -> LogTable:
    """Table in which rows that are equal in stamp and values are there once."""
    again = np.ones(len(log), dtype=np.bool_)
    for column in one_by_one(log.columns[name] for name in (time, *names)):
        again[1:] &= column[1:] == column[:-1]
    again[:1] = False
    return log.rows(~again, f"{int(again.sum())} rows that repeat the one before were left out")


def _after_each_other(log: LogTable, time: str) -> LogTable:
    """Table in which episodes, whose stamps begin anew, follow each other after a pause."""
    episode = next((log.columns[name] for name in EPISODES if name in log.columns), None)
    stamps = log.columns[time]
    if episode is None or not np.isfinite(stamps).all():
        return log
    steps = np.diff(stamps)
    anew = (np.diff(episode) != 0.0) & (steps <= 0.0)
    if not anew.any():
        return log
    forward = steps[steps > 0.0]
    pause = PAUSE_PERIODS * float(np.median(forward)) if forward.size else 1.0
    shift = np.concatenate([[0.0], np.cumsum(np.where(anew, pause - steps, 0.0))])
    notes = (*log.notes, f"{int(anew.sum()) + 1} episodes, whose stamps begin anew, are taken one after another")
    return replace(log, columns={**log.columns, time: stamps + shift}, notes=notes)
