"""A log as it was written: named columns of one length."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import FileError

MAX_ROWS = 20_000_000
MAX_BYTES = 4 * 2**30
"""Logs above these sizes are not read."""


@dataclass(frozen=True, eq=False)
class LogTable:
    """Table of a log as it was written. `columns` are arrays (n,) by name, in the log's own units and with NaN where a
    cell has no number; `units` are the symbols by column that the file itself states, empty by default. `source` is the
    log's file, as text; `len` gives n. Made by `read_log`; nothing is checked at construction."""

    source: str
    columns: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def column(self, name: str, what: str) -> Array:
        """The column (n,) of the given `name`, of the table's n rows, finite in each, in the log's own unit; `what` it
        is needed for, such as "time", goes into the error message. Raises `FileError` for a name that the table does
        not have, with the nearest ones, and for a column with NaN or infinity, with the first such row."""
        if name not in self.columns:
            raise FileError(f"{self.source}: there is no column {name!r} for {what}; {self._known(name)}")
        values = self.columns[name]
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise FileError(
                f"{self.source}: column {name!r} ({what}): row {int(bad[0]) + 1} of {len(values)} is "
                f"{values[bad[0]]}, as are {bad.size - 1} more; cut the log where its numbers are missing"
            )
        return values

    def _known(self, name: str) -> str:
        names = list(self.columns)
        near = get_close_matches(name, names, 3)
        listed = ", ".join(near or names[:12]) + ("" if near or len(names) <= 12 else f", ... ({len(names)} in all)")
        return f"{'did you mean' if near else 'there are'} {listed}"


def table(source: str, columns: Iterable[tuple[str, Array]], units: Mapping[str, str] | None = None) -> LogTable:
    """The table of a log, a `LogTable`, from `columns`, pairs of a name and an array (n,), n rows in each. `source` is
    the log's file, for error messages, and `units` are the symbols of columns that the file states, None for none.
    Raises `FileError` where there is no column or no row, for two columns of one name, and for columns of different
    lengths."""
    found: dict[str, Array] = {}
    for name, values in columns:
        if name in found:
            raise FileError(f"{source}: two columns are named {name!r}; names must be unique")
        found[name] = np.asarray(values, dtype=np.float64)
    first, rows = next(((name, len(values)) for name, values in found.items()), ("", 0))
    if not rows:
        raise FileError(f"{source}: holds no rows of numbers; expected a line of column names and a line a sample")
    for name, values in found.items():
        if len(values) != rows:
            raise FileError(
                f"{source}: column {name!r} has {len(values)} rows, {first!r} has {rows}: all need the same number"
            )
    return LogTable(source, found, units or {})
