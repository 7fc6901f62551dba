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
    """A table of a log: columns (n,) by name, and the units that the file itself states of them, if any."""

    source: str
    columns: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def column(self, name: str, what: str) -> Array:
        """A column (n,), finite in every row. Raises `FileError` naming the column and the first bad row."""
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
    """A table of checked size and names. Raises `FileError` without a row, and for two columns of one name."""
    found: dict[str, Array] = {}
    for name, values in columns:
        if name in found:
            raise FileError(f"{source}: two columns are named {name!r}; names must be unique")
        found[name] = np.asarray(values, dtype=np.float64)
    if not found or not len(next(iter(found.values()))):
        raise FileError(f"{source}: holds no rows of numbers; expected a line of column names and a line a sample")
    return LogTable(source, found, units or {})
