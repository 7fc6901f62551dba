"""Several files of one log, joined."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adaptctl.errors import FileError
from adaptctl.logs.table import LogTable

TIME = "time"


def joined(source: str, parts: Sequence[LogTable]) -> LogTable:
    """Table of all columns of several files, joined by time stamps, or by rows where all files have equally many."""
    names = _names(parts)
    if all(TIME in part.columns for part in parts):
        parts = _of_one_clock(source, parts)
        if not _same_stamps(parts):
            return _interleaved(source, parts, names)
    rows = [len(part) for part in parts]
    if len(set(rows)) > 1:
        told = ", ".join(f"{Path(part.source).name} {n}" for part, n in zip(parts, rows, strict=True))
        raise FileError(
            f"{source}: the files have other numbers of rows ({told}); to be joined by stamps, each needs a column "
            f"{TIME!r}"
        )
    pairs = list(zip(parts, names, strict=True))
    return LogTable(
        source,
        {own[name]: values for part, own in pairs for name, values in part.columns.items()},
        {own[name]: unit for part, own in pairs for name, unit in part.units.items()},
        {own[name]: mask for part, own in pairs for name, mask in part.empty.items()},
        {own[name]: word for part, own in pairs for name, word in part.words.items()},
        all(part.numbered for part in parts),
        _notes(parts, "row by row"),
    )


def _of_one_clock(source: str, parts: Sequence[LogTable]) -> list[LogTable]:
    """Tables whose stamps count from the first file's beginning."""
    if len({part.units.get(TIME) for part in parts}) > 1:
        raise FileError(f"{source}: the stamps of the files have other units than each other; write them in one")
    if len({TIME in part.begin for part in parts}) > 1:
        raise FileError(f"{source}: the stamps of some files count since 1970 and of others not; write them alike")
    first = parts[0].begin.get(TIME, 0.0)
    shifts = [part.begin.get(TIME, 0.0) - first for part in parts]
    return [
        replace(part, columns={**part.columns, TIME: part.columns[TIME] + shift})
        for part, shift in zip(parts, shifts, strict=True)
    ]


def _notes(parts: Sequence[LogTable], how: str) -> tuple[str, ...]:
    return (*(note for part in parts for note in part.notes), f"{len(parts)} files were joined {how}")


def _names(parts: Sequence[LogTable]) -> list[dict[str, str]]:
    """New names of each file's columns: those that several have are preceded by the name of the file."""
    if all(part.numbered for part in parts):
        firsts = np.cumsum([0, *(len(part.columns) for part in parts)]).tolist()
        return [
            {name: str(first + i + 1) for i, name in enumerate(part.columns)}
            for part, first in zip(parts, firsts, strict=False)
        ]
    count = Counter(name for part in parts for name in part.columns)
    return [
        {
            name: name if count[name] == 1 or name == TIME else f"{Path(part.source).stem}.{name}"
            for name in part.columns
        }
        for part in parts
    ]


def _same_stamps(parts: Sequence[LogTable]) -> bool:
    first = parts[0].columns[TIME]
    return all(np.array_equal(first, part.columns[TIME]) for part in parts[1:])


def _interleaved(source: str, parts: Sequence[LogTable], names: Sequence[dict[str, str]]) -> LogTable:
    """Table of the rows of all files by their stamps, with empty cells for those of the others."""
    stamps = np.unique(np.concatenate([part.columns[TIME] for part in parts]))
    columns, own_units = {TIME: stamps}, dict[str, str]()
    empty: dict[str, NDArray[np.bool_]] = {}
    for part, own in zip(parts, names, strict=True):
        place = np.searchsorted(stamps, part.columns[TIME])
        own_units |= {own[name]: unit for name, unit in part.units.items()}
        for name, values in part.columns.items():
            if name == TIME:
                continue
            whole, mask = np.full(len(stamps), np.nan), np.ones(len(stamps), dtype=np.bool_)
            whole[place] = values
            mask[place] = part.empty.get(name, np.zeros(len(part), dtype=np.bool_))
            columns[own[name]] = whole
            empty |= {own[name]: mask} if mask.any() else {}
    words = {own[name]: word for part, own in zip(parts, names, strict=True) for name, word in part.words.items()}
    return LogTable(source, columns, own_units, empty, words, notes=_notes(parts, "by their stamps"))
