"""Reader of logs as Parquet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from adaptctl.errors import FileError
from adaptctl.identification.log_formats.arrow import numbers
from adaptctl.identification.log_table import LogTable, table, validate_size, whole_stamps
from adaptctl.simulation.rollout_file import validate_own


def read_parquet(path: str | Path) -> LogTable:
    """Table of a Parquet file: columns of numbers, booleans and dates, lists split into `name[0]`, `name[1]`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, memory_map=True) as file:
            validate_size(path, file.metadata.num_rows, file.metadata.num_columns)
            read, metadata = file.read(), file.metadata.metadata
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({(error.strerror or str(error)).splitlines()[0].lower()})") from error
    except (pa.ArrowException, UnicodeDecodeError) as error:
        raise FileError(f"{path}: not a Parquet file ({str(error).splitlines()[0]})") from error
    validate_own(path, read, metadata)
    try:
        return arrow_table(str(path), read)
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: a name or unit is not UTF-8 ({error.reason})") from error


def arrow_table(source: str, read: Any) -> LogTable:
    """Table of one of Arrow."""
    found = [one for entry in read.schema for one in numbers(entry.name, read.column(entry.name), _unit(entry))]
    units = {one.name: one.unit for one in found if one.unit}
    empty = {one.name: one.empty for one in found if one.empty is not None}
    return whole_stamps(table(source, ((one.name, one.values) for one in found), units, empty))


def _unit(entry: Any) -> str:
    return str((entry.metadata or {}).get(b"unit", b"").decode())
