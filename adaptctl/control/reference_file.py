"""Reference positions in a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import FileError, printable, suggested_name
from adaptctl.files import read_text

TIME, POSITION = "time", "position."


class Waypoints(NamedTuple):
    """Times (w,) in s, and positions (w, r) in rad (m)."""

    times: Array
    positions: Array


def read_waypoints(path: str | Path, joints: Sequence[str]) -> Waypoints:
    """Times and positions of a CSV file with a header, in the order of the joints."""
    lines = enumerate(csv.reader(read_text(path).splitlines()), 1)
    rows = [(number, row) for number, row in lines if row and not row[0].lstrip().startswith("#")]
    if not rows:
        raise FileError(f"{path}: empty; expected a header, {TIME} and the joints' names, and a row for each time")
    names = [name.strip() for name in rows[0][1]]
    places = [_place(path, names, TIME, (TIME,)), *(_place(path, names, j, (POSITION + j, j)) for j in joints)]
    values = np.array([[_number(path, number, row, names, k) for k in places] for number, row in rows[1:]])
    values = values.reshape(len(rows) - 1, len(places))
    late = np.flatnonzero(np.diff(values[:, 0]) <= 0.0)
    if late.size:
        number, t = rows[late[0] + 2][0], values[late[0] + 1, 0]
        raise FileError(f"{path}: line {number}: {TIME} {t:g} s is not after that of the row before")
    return Waypoints(values[:, 0], values[:, 1:])


def _place(path: str | Path, names: Sequence[str], wanted: str, known: Sequence[str]) -> int:
    """Index of a column under one of the names that it may have."""
    for name in known:
        if names.count(name) > 1:
            raise FileError(f"{path}: two columns {name!r}")
        if name in names:
            return names.index(name)
    there = ", ".join(printable(name) for name in names[:20])
    expected = " or ".join(map(repr, known))
    raise FileError(f"{path}: no column {expected}{suggested_name(wanted, names)}; there are: {there}")


def _number(path: str | Path, line: int, row: Sequence[str], names: Sequence[str], k: int) -> float:
    text = row[k].strip() if k < len(row) else ""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise FileError(
            f"{path}: line {line}: {printable(names[k])}: expected a finite number, got {printable(text)!r}"
        )
    return value
