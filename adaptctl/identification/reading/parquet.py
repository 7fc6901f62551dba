"""Logs as Parquet, those of our own runs with the units that they state."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import FileError
from adaptctl.identification.reading.table import MAX_ROWS, LogTable, table


def read_parquet(path: str | Path) -> LogTable:
    """The table of a log in the Parquet file `path`, a `LogTable`: its columns of numbers, and of booleans as 0 and 1,
    with missing cells as NaN. A column of fixed-size lists of them, `name`, is split into `name[0]`, `name[1]` ...,
    unless a list is missing. Other columns are left out. Units are those in the metadata `unit` of the file's fields,
    by the names of the columns made of them. Raises `FileError` for a file that cannot be read or is no Parquet file,
    without columns of numbers or rows, or with more than 20 million rows."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, memory_map=True) as file:
            if file.metadata.num_rows > MAX_ROWS:
                raise FileError(f"{path}: has {file.metadata.num_rows} rows, more than the {MAX_ROWS} that are read")
            read = file.read()
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({(error.strerror or str(error)).splitlines()[0].lower()})") from error
    except pa.ArrowException as error:
        raise FileError(f"{path}: not a Parquet file ({str(error).splitlines()[0]})") from error
    units = {name: _unit(field) for field in read.schema for name in _names(field)}
    return table(str(path), _columns(read), {name: unit for name, unit in units.items() if unit})


def _unit(field: Any) -> str:
    return str((field.metadata or {}).get(b"unit", b"").decode())


def _names(field: Any) -> list[str]:
    """Names of the columns made of a field."""
    import pyarrow as pa

    if pa.types.is_fixed_size_list(field.type):
        return [f"{field.name}[{i}]" for i in range(field.type.list_size)]
    return [field.name]


def _columns(read: object) -> Iterator[tuple[str, Array]]:
    import pyarrow as pa

    for field in read.schema:  # type: ignore[attr-defined]
        column = read.column(field.name).combine_chunks()  # type: ignore[attr-defined]
        if _holds_numbers(field.type):
            yield field.name, _numbers(column)
            continue
        lists = pa.types.is_fixed_size_list(field.type) and not column.null_count
        if lists and _holds_numbers(field.type.value_type):
            cells = _numbers(column.flatten()).reshape(-1, field.type.list_size)
            yield from zip(_names(field), cells.T, strict=True)


def _holds_numbers(kind: Any) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind))


def _numbers(column: Any) -> Array:
    import pyarrow as pa

    return np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False), dtype=np.float64)
