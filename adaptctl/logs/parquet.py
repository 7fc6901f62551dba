"""Reader of logs as Parquet."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from adaptctl.errors import FileError, printable
from adaptctl.logs import on_disk
from adaptctl.logs.arrow import LogColumn, numbers
from adaptctl.logs.batches import Batches, UnlikeBeforeError
from adaptctl.logs.table import LogTable, table, validate_size, whole_stamps

MAX_UNPACKED = 8 * 2**30
BUFFER = 1_000_000
"""bytes of a column that are read at a time"""
MAX_RATIO, FREE = 1000, 400 * 2**20
"""declared bytes for each one of the file, besides some that any file may have"""


def read_parquet(path: str | Path) -> LogTable:
    """Table of a Parquet file: columns of numbers, booleans and dates, lists split into `name[0]`, `name[1]`."""
    try:
        found = _long(path) or arrow_table(str(path), read_arrow(path))
        return whole_stamps(found)
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: a name or unit is not UTF-8 ({error.reason})") from error


def _long(path: str | Path) -> LogTable | None:
    """Table of a large file, read batch by batch; None of others, of our own runs', and of what cannot be read so."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    irregular = suppress(OSError, pa.ArrowException, ValueError, OverflowError, UnlikeBeforeError)
    with irregular, pq.ParquetFile(path, buffer_size=BUFFER, page_checksum_verification=True) as file:
        told = file.metadata
        if not on_disk.is_large(told.num_columns, told.num_rows) or b"sha256" in (told.metadata or {}):
            return None
        validate_size(path, told.num_rows, told.num_columns)
        _validate_unpacked(path, told)
        read = Batches(told.num_rows)
        _add(read, file)
        return _table(str(path), read.columns())
    return None


def _add(read: Batches, file: Any, columns: Sequence[str] | None = None) -> None:
    """Add the batches of a file of Parquet, of some of its columns if given."""
    for group in range(file.metadata.num_row_groups):  # one by one, as Arrow keeps what it read of those it is given
        for batch in file.iter_batches(on_disk.ROWS_AT_ONCE, [group], columns, use_threads=False):
            read.add(_columns(batch, read.first), len(batch))


def read_in_turn(source: str, paths: Sequence[Path], columns: Sequence[str]) -> LogTable:
    """Table of some columns of Parquet files that follow each other, read batch by batch."""
    rows = 0
    for path in paths:
        with _opened(path) as file:
            rows += file.metadata.num_rows
    validate_size(source, rows, len(columns))
    read = Batches(rows)
    for path in paths:
        with _opened(path) as file:
            try:
                _add(read, file, [name for name in columns if name in file.schema_arrow.names])
            except UnlikeBeforeError as error:
                raise FileError(f"{source}: its files have other columns than each other") from error
    return _table(source, read.columns())


@contextmanager
def _opened(path: str | Path) -> Iterator[Any]:
    """File of Parquet, whose errors are told by its path."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, buffer_size=BUFFER, page_checksum_verification=True) as file:
            validate_size(path, file.metadata.num_rows, file.metadata.num_columns)
            _validate_unpacked(path, file.metadata)
            yield file
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({(error.strerror or str(error)).splitlines()[0].lower()})") from error
    except (pa.ArrowException, UnicodeDecodeError, ValueError, OverflowError) as error:
        raise FileError(f"{path}: not a Parquet file ({printable(str(error).splitlines()[0])})") from error


def read_arrow(path: str | Path) -> Any:
    """Table of Arrow in a Parquet file, with checksums verified."""
    with _opened(path) as file:
        read, metadata = file.read(use_threads=False), file.metadata.metadata
    if metadata and b"sha256" in metadata:
        from adaptctl.simulation.rollout_file import validate_own

        validate_own(path, read, metadata)
    return read


def _validate_unpacked(path: str | Path, metadata: Any) -> None:
    """Refuse a file that says to be very much larger unpacked."""
    groups = (metadata.row_group(i) for i in range(metadata.num_row_groups))
    declared = sum(group.total_byte_size for group in groups)
    if not 0 <= declared <= min(MAX_UNPACKED, FREE + MAX_RATIO * Path(path).stat().st_size):
        raise FileError(f"{path}: declares {declared} bytes unpacked, more than is read from a file of its size")


def arrow_table(source: str, read: Any) -> LogTable:
    """Table of one of Arrow."""
    return _table(source, list(_columns(read)))


def _columns(read: Any, first: Callable[[str], int | None] = lambda name: None) -> Iterator[LogColumn]:
    """Columns of a table or batch of Arrow, with a function of what was taken off each by its name."""
    for entry in read.schema:
        yield from numbers(entry.name, read.column(entry.name), _unit(entry), first(entry.name))


def _table(source: str, found: Sequence[LogColumn]) -> LogTable:
    units = {one.name: one.unit for one in found if one.unit}
    empty = {one.name: one.empty for one in found if one.empty is not None}
    begin = {one.name: one.begin for one in found if one.begin}
    return table(source, ((one.name, one.values) for one in found), units, empty, begin=begin)


def _unit(entry: Any) -> str:
    return str((entry.metadata or {}).get(b"unit", b"").decode())
