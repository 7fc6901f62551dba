"""Columns of numbers, dates and texts in a text table."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from adaptctl.logs.arrow import LogColumn, numbers
from adaptctl.logs.text_form import CLOCK, GROUPED


def text_column(name: str, column: Any, decimal: str) -> LogColumn:
    """Column of numbers, dates or times of day; NaN where a cell is text."""
    import pyarrow as pa

    if pa.types.is_time(column.type):
        column = column.cast(pa.string())
    found = next(numbers(name, column), None)
    return _texts(name, column, decimal) if found is None else found


def _texts(name: str, column: Any, decimal: str) -> LogColumn:
    """Column of texts: times of day in s, or the numbers among them."""
    mask = ~np.asarray(column.combine_chunks().is_valid())
    empty = mask if mask.any() else None
    given = [str(cell) for cell in column.drop_null().to_pylist()]
    is_clock = bool(given) and all(map(CLOCK.match, given))
    values, word = np.full(len(column), np.nan), None
    groups = _groups(given, decimal)
    each = [_clock(cell) if is_clock else _number(cell, groups, decimal) for cell in given]
    values[~mask] = each
    if not is_clock:
        word = next((cell for cell, value in zip(given, each, strict=True) if math.isnan(value)), None)
    return LogColumn(name, values, "s" if is_clock else "", empty, word)


def _clock(cell: str) -> float:
    hours, minutes, seconds = cell.replace(",", ".").split(":")
    return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)


def _groups(given: list[str], decimal: str) -> str:
    """Mark between thousands of a column; none where it may be that before decimals."""
    found = [m for cell in given if (m := GROUPED.match(cell)) and m["group"] != decimal]
    sure = any(m["decimal"] or m["group"] not in ".," or m[0].count(m["group"]) > 1 for m in found)
    marks = {m["group"] for m in found}
    return marks.pop() if sure and len(marks) == 1 else ""


def _number(cell: str, groups: str, decimal: str) -> float:
    try:
        whole = cell.replace(groups, "") if groups and GROUPED.match(cell) else cell
        return float(whole if decimal == "." else whole.replace(".", "?").replace(decimal, "."))
    except ValueError:
        return math.nan
