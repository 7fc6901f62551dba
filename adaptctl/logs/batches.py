"""Columns of a long log, read batch by batch and kept on disk."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from adaptctl.logs.arrow import LogColumn
from adaptctl.logs.on_disk import ColumnFile


class UnlikeBeforeError(Exception):
    """A batch has other columns than the one before: the log is to be read at once."""


class Batches:
    """Columns of at most so many rows, of which each batch is written to disk."""

    def __init__(self, rows: int) -> None:
        self.rows, self._most = 0, rows
        self._columns: dict[str, LogColumn] = {}
        self._empty: dict[str, list[tuple[int, NDArray[np.bool_]]]] = {}
        self._file: ColumnFile | None = None

    def first(self, name: str) -> int | None:
        """Whole number that is taken off a column of the file."""
        one = self._columns.get(name) or self._columns.get(f"{name}[0]")
        return None if one is None else one.first

    def add(self, found: Iterable[LogColumn], length: int) -> None:
        """Add a batch of so many rows."""
        batch = list(found)
        if self._file is None:
            self._file, self._columns = ColumnFile(len(batch), self._most), {one.name: one for one in batch}
        alike = all(one.first == self._columns[one.name].first for one in batch if one.name in self._columns)
        if not alike or [one.name for one in batch] != list(self._columns) or self.rows + length > self._most:
            raise UnlikeBeforeError
        for k, one in enumerate(batch):
            self._file.write(k, self.rows, one.values)
            if one.empty is not None:
                self._empty.setdefault(one.name, []).append((self.rows, one.empty))
        self.rows += length

    def columns(self) -> list[LogColumn]:
        """Columns of all batches."""
        if self._file is None:
            return []
        pairs = zip(self._columns.values(), self._file.columns(self.rows), strict=True)
        return [one._replace(values=values, empty=self._mask(one.name)) for one, values in pairs]

    def _mask(self, name: str) -> NDArray[np.bool_] | None:
        if name not in self._empty:
            return None
        mask = np.zeros(self.rows, dtype=np.bool_)
        for start, part in self._empty[name]:
            mask[start : start + len(part)] = part
        return mask
