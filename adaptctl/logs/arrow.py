"""LogColumn of Arrow columns."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.logs.units import TIME

EXACT = 2**53
"""size from which floating-point numbers have no ones"""


class LogColumn(NamedTuple):
    """Column (n,) of a table with its unit, the mask of its empty cells, and its first text."""

    name: str
    values: Array
    unit: str = ""
    empty: NDArray[np.bool_] | None = None
    word: str | None = None
    begin: float = 0.0
    """what was taken off the values, of which these have no ones"""
    first: int | None = None
    """likewise, as the whole number that it is in the file; None if nothing was"""


def forget(tables: list[Any]) -> None:
    """Empty a list of what has been read, and give its memory back to the system, which Arrow keeps for itself."""
    from pyarrow import default_memory_pool

    tables.clear()
    default_memory_pool().release_unused()


def numbers(name: str, column: Any, unit: str = "", first: int | None = None) -> Iterator[LogColumn]:
    """
    Columns of numbers in an Arrow column: one per place of a fixed-length list, none for texts.

    A whole number that was taken off the batch before is taken off this one too.
    """
    import pyarrow as pa

    kind = column.type
    if isinstance(column, pa.ChunkedArray):
        column = column.combine_chunks()
    if pa.types.is_dictionary(kind):
        column, kind = column.dictionary_decode(), kind.value_type
    if pa.types.is_fixed_size_list(kind) or pa.types.is_list(kind) or pa.types.is_large_list(kind):
        yield from _places(name, column, unit, first)
    elif pa.types.is_timestamp(kind) or pa.types.is_date(kind):
        yield _moments(name, column, first)
    elif pa.types.is_duration(kind):
        values, own = _floats(column.cast(pa.int64()), first)
        yield LogColumn(name, TIME[kind.unit] * values, "s", _empty(column), first=own)
    elif _holds_numbers(kind):
        values, own = _floats(column, first)
        yield LogColumn(name, values, unit, _empty(column), begin=own or 0, first=own)


def _places(name: str, column: Any, unit: str, first: int | None) -> Iterator[LogColumn]:
    """Columns of the places of lists that all have one length; rows without a list are empty in each."""
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = column.type
    if not _holds_numbers(kind.value_type):
        return
    given = np.asarray(column.is_valid())
    if pa.types.is_fixed_size_list(kind):
        size, cells = kind.list_size, column.drop_null().flatten()
    else:
        lengths = np.asarray(pc.list_value_length(column).drop_null())
        if not lengths.size or lengths.min() != lengths.max():
            return
        size, cells = int(lengths[0]), column.flatten()
    values = np.full((len(column), size), np.nan)
    numbers_of_cells, own = _floats(cells, first)
    values[given] = numbers_of_cells.reshape(-1, size)
    empty = None if given.all() else ~given
    yield from (LogColumn(f"{name}[{i}]", values[:, i].copy(), unit, empty, first=own) for i in range(size))


def _moments(name: str, column: Any, first: int | None) -> LogColumn:
    """Times in s since the first moment of a column of dates."""
    import pyarrow as pa

    unit = getattr(column.type, "unit", None)
    if unit is None:
        column, unit = column.cast(pa.timestamp("ms")), "ms"
    whole = column.cast(pa.int64())
    values, own = _from_first(whole, first)
    return LogColumn(name, TIME[unit] * values, "s", _empty(column), begin=TIME[unit] * (own or 0), first=own)


def _floats(column: Any, first: int | None) -> tuple[Array, int | None]:
    """Floating-point numbers (n,); of whole ones that these cannot tell apart, the differences from the first."""
    import pyarrow as pa

    if first is not None:
        return _from_first(column, first)
    if pa.types.is_integer(column.type) and len(column) > column.null_count:
        given = _given(column)
        least, most = int(given.min()), int(given.max())
        if max(abs(least), abs(most)) >= EXACT and most - least < 2**62:
            return _from_first(column, None)
    whole = column.cast(pa.float64(), safe=False) if column.null_count else column
    return np.asarray(whole.to_numpy(zero_copy_only=False), dtype=np.float64), None


def _given(column: Any) -> NDArray[Any]:
    """Values (m,) of a column that are not null; of Arrow's functions, which take long to load, where some are."""
    return np.asarray((column.drop_null() if column.null_count else column).to_numpy())


def _from_first(column: Any, first: int | None) -> tuple[Array, int | None]:
    """Differences (n,) of whole numbers from the first, NaN where there is none, and the first."""
    given = np.asarray(column.is_valid())
    whole = _given(column)
    out = np.full(len(column), np.nan)
    if len(whole):
        first = int(whole[0]) if first is None else first
        out[given] = (whole.astype(np.int64) - np.int64(first)).astype(np.float64)
    return out, first


def _empty(column: Any) -> NDArray[np.bool_] | None:
    return ~np.asarray(column.is_valid()) if column.null_count else None


def _holds_numbers(kind: Any) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind))
