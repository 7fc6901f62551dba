"""Logs as tables of named columns."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import MAX_SETTING, Array
from adaptctl.errors import FileError, printable
from adaptctl.logs.on_disk import chosen, release

MAX_ROWS = 20_000_000
MAX_COLUMNS = 10_000
MAX_NUMBERS = 400_000_000
# Logs above these sizes are not read.
MAX_BYTES = 4 * 2**30
# Names of columns that only count within another one's second, after the name of that one.
FRACTIONS = re.compile(r"^(.*?)(nanosecs?|nanoseconds|nsecs?)$", re.IGNORECASE)
SECONDS = ("sec", "secs", "seconds", "second", "s")
WHOLE = "use a part of the log without missing numbers"


@dataclass(frozen=True, eq=False)
class LogTable:
    """Columns (n,) of a log by name, in its own units, NaN where a cell has no number."""

    source: str
    columns: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)
    empty: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    """masks of cells without content, of columns that have such"""
    words: Mapping[str, str] = field(default_factory=dict)
    """first cell of a column that is text"""
    numbered: bool = False
    """True if names of columns are their numbers from 1, for want of others"""
    notes: tuple[str, ...] = ()
    """what was left out or joined in reading"""
    begin: Mapping[str, float] = field(default_factory=dict)
    """what was taken off columns of large whole numbers and dates"""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def column(self, name: str, what: str) -> Array:
        """Column (n,) that is finite in each row."""
        if name not in self.columns:
            raise FileError(
                f"{self.source}: no column {name!r} for {what}; {self.near(name) or f'columns: {self.listed()}'}"
            )
        values = self.columns[name]
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            told = f"; its first text is {printable(repr(self.words[name]))}" if name in self.words else ""
            dated = told and what == "time" and bad[0] == 0
            right = "write s, or dates as 2026-09-01 12:00:00.005" if dated else WHOLE
            raise FileError(
                f"{self.source}: column {name!r} ({what}): {bad.size} of {len(values)} rows not finite, the first "
                f"is row {int(bad[0]) + 1} ({values[bad[0]]}){told}; {right}"
            )
        size = float(max(values.max(initial=0.0), -values.min(initial=0.0)))
        if size != 0.0 and not 1.0 / MAX_SETTING <= size <= MAX_SETTING:
            row = int(np.abs(values).argmax())
            raise FileError(
                f"{self.source}: column {name!r} ({what}): the largest number, {values[row]:g} in row {row + 1}, is "
                f"beyond {1.0 / MAX_SETTING:g} to {MAX_SETTING:g}; expected readings in SI units or those of --units"
            )
        release()
        return values

    def near(self, name: str) -> str:
        """Words that offer columns of a similar name; empty where there are none."""
        names = list(self.columns)
        near = [other for other in names if other.startswith(f"{name} (")] or get_close_matches(name, names, 3)
        near = near or [other for other in names if name and other.startswith(name)][:3]
        return f"did you mean {', '.join(near)}" if near else ""

    def listed(self, most: int = 12) -> str:
        """Names of the first columns, and how many there are if these are not all."""
        names = list(self.columns)
        return ", ".join(names[:most]) + (f", ... ({len(names)} in all)" if len(names) > most else "")

    def rows(self, kept: NDArray[np.bool_], note: str = "") -> LogTable:
        """Part of the rows by a mask (n,), and a note on the others where there are any."""
        if kept.all():
            return self
        columns = dict(zip(self.columns, chosen(list(self.columns.values()), kept), strict=True))
        empty = {name: mask[kept] for name, mask in self.empty.items()}
        return replace(self, columns=columns, empty=empty, notes=(*self.notes, note))


def table(
    source: str,
    columns: Iterable[tuple[str, Array]],
    units: Mapping[str, str] | None = None,
    empty: Mapping[str, NDArray[np.bool_]] | None = None,
    words: Mapping[str, str] | None = None,
    begin: Mapping[str, float] | None = None,
) -> LogTable:
    """Table of pairs of a name and a column; columns of one name have their numbers behind it."""
    pairs = list(columns)
    own, notes = _distinct([name for name, _ in pairs])
    if len(set(own)) < len(own):
        raise FileError(f"{source}: several columns have one name, and cannot be numbered; names must be unique")
    found = {name: np.asarray(values, dtype=np.float64) for name, (_, values) in zip(own, pairs, strict=True)}
    first, rows = next(((name, len(values)) for name, values in found.items()), ("", 0))
    if not rows:
        raise FileError(f"{source}: no rows of numbers; expected a line of column names and one line per sample")
    for name, values in found.items():
        if len(values) != rows:
            raise FileError(f"{source}: column {name!r} has {len(values)} rows, but {first!r} has {rows}")
    return LogTable(source, found, units or {}, empty or {}, words or {}, notes=notes, begin=begin or {})


def _distinct(names: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Names that are of one column each, and notes on those that were of several."""
    number, found = Counter[str](), list[str]()
    several = [name for name, count in Counter(names).items() if count > 1]
    for name in names:
        number[name] += 1
        found.append(f"{name} ({number[name]})" if name in several else name)
    notes = [f"{number[n]} columns are named {n!r}, and are {n} (1) to {n} ({number[n]}) here" for n in several]
    return found, tuple(notes)


def validate_size(source: object, rows: int, columns: int) -> None:
    """Raise `FileError` for a table that is larger than logs are read."""
    if rows > MAX_ROWS:
        raise FileError(f"{source}: has {rows} rows, more than the limit of {MAX_ROWS}")
    if columns > MAX_COLUMNS or rows * columns > MAX_NUMBERS:
        raise FileError(
            f"{source}: has {rows} rows of {columns} columns, more than the limit of {MAX_COLUMNS} columns and "
            f"{MAX_NUMBERS} numbers; leave out columns, or split it into several logs"
        )


def whole_stamps(log: LogTable) -> LogTable:
    """Table in which a column of seconds and its column of nanoseconds both are the whole stamp, from 0."""
    columns, units, begin, joined = dict(log.columns), dict(log.units), dict(log.begin), []
    for name in log.columns:
        second = _seconds_of(name, log)
        if second is None:
            continue
        least = float(np.nanmin(log.columns[second]))
        total = log.columns[second] - least + 1e-9 * log.columns[name]
        begin |= {second: begin.get(second, 0.0) + least, name: 1e9 * (begin.get(second, 0.0) + least)}
        columns |= {name: 1e9 * total, second: total}
        units |= {name: "ns", second: "s"}
        joined.append(f"{second} and {name} are taken as one stamp")
    changed = {"columns": columns, "units": units, "begin": begin, "notes": (*log.notes, *joined)}
    return replace(log, **changed) if joined else log  # type: ignore[arg-type]


def _seconds_of(name: str, log: LogTable) -> str | None:
    """Column of whole seconds to which one of nanoseconds belongs."""
    found = FRACTIONS.match(name)
    if found is None:
        return None
    others = {other.lower(): other for other in log.columns}
    second = next((others[found[1].lower() + end] for end in SECONDS if found[1].lower() + end in others), None)
    if second is None:
        return None
    whole, part = log.columns[second], log.columns[name]
    given = np.isfinite(whole) & np.isfinite(part)
    within = (part[given] >= 0.0) & (part[given] < 1e9) & (part[given] % 1.0 == 0.0)
    return second if given.any() and within.all() and (whole[given] % 1.0 == 0.0).all() else None
