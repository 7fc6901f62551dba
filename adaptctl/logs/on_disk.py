"""Long columns in temporary files, of which memory holds only what is being read."""

from __future__ import annotations

import mmap
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryFile, gettempdir
from typing import IO
from weakref import WeakSet, finalize

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.errors import FileError

# Bytes from which on columns are on disk, and rows of them that are computed at a time.
LARGE, ROWS_AT_ONCE = 2**25, 2**16

_maps: WeakSet[mmap.mmap] = WeakSet()


def is_large(columns: int, rows: int) -> bool:
    """True for columns that belong on disk."""
    return 8 * columns * rows >= LARGE


class ColumnFile:
    """Temporary file without a name for k columns of at most n rows, which takes no more space than what is written."""

    def __init__(self, columns: int, rows: int) -> None:
        self._file, self._shape = TemporaryFile(), (columns, rows)  # noqa: SIM115
        finalize(self, self._file.close)

    def write(self, column: int, first: int, values: Array) -> None:
        """Write a column's values (m,) from a row on."""
        data = np.ascontiguousarray(values, dtype=np.float64).view(np.uint8).data
        place = 8 * (column * self._shape[1] + first)
        try:
            while data:
                done = os.pwrite(self._file.fileno(), data, place)
                place, data = place + done, data[done:]
        except OSError as error:
            why = (error.strerror or str(error)).lower()
            raise FileError(
                f"{gettempdir()}: {why}; long logs are kept there: set TMPDIR to a folder with room"
            ) from error

    def columns(self, rows: int) -> Array:
        """All columns (k, rows), which cannot be changed."""
        return _mapped(self._file, self._shape)[:, :rows]


def _mapped(file: IO[bytes], shape: tuple[int, int]) -> Array:
    """Numbers (k, n) in a file, read as they are used."""
    if 0 in shape:
        return np.empty(shape)
    size = 8 * shape[0] * shape[1]
    if os.fstat(file.fileno()).st_size < size:
        os.truncate(file.fileno(), size)
    content = mmap.mmap(file.fileno(), size, access=mmap.ACCESS_READ)
    _maps.add(content)
    return np.frombuffer(content, dtype=np.float64).reshape(shape)


def columns_of_file(path: Path, shape: tuple[int, int]) -> Array:
    """Numbers (k, n) of a file, which may be removed from then on."""
    if not is_large(*shape):
        return np.fromfile(path, dtype=np.float64).reshape(shape)
    with path.open("rb") as file:
        return _mapped(file, shape)


def release() -> None:
    """Give back the memory of what has been read of all columns on disk; they are read again at need."""
    for content in list(_maps):
        content.madvise(mmap.MADV_DONTNEED)


def each_column(values: Array) -> Iterator[Array]:
    """Columns (n,) of an array (n, k), one after the other."""
    return one_by_one(values.T)


def one_by_one(columns: Iterable[Array]) -> Iterator[Array]:
    """Columns (n,), one after the other, of which memory holds one."""
    for column in columns:
        yield column
        release()


def rowwise(compute: Callable[..., Array], *values: Array) -> Array:
    """Array (n, k) of a function of rows of arrays (n, ...), by chunks and on disk if it is large."""
    n = len(values[0])
    width = compute(*(own[:1] for own in values)).shape[1]
    if not is_large(width, n):
        return compute(*values)
    file = ColumnFile(width, n)
    for start in range(0, n, ROWS_AT_ONCE):
        part = compute(*(own[start : start + ROWS_AT_ONCE] for own in values))
        for k in range(width):
            file.write(k, start, part[:, k])
        release()
    return file.columns(n).T


def of_columns(columns: Iterable[Array], rows: int, width: int) -> Array:
    """Array (n, k) of columns (n,) as they are made, on disk if it is large."""
    if not is_large(width, rows):
        return np.stack(list(columns), axis=-1)
    file = ColumnFile(width, rows)
    for k, own in enumerate(columns):
        file.write(k, 0, own)
        release()
    return file.columns(rows).T


def chosen(columns: Sequence[Array], kept: NDArray[np.bool_]) -> Sequence[Array]:
    """Rows of columns (n,) by a mask (n,), on disk if they are large."""
    rows = int(np.count_nonzero(kept))
    if not is_large(len(columns), rows):
        return [own[kept] for own in columns]
    file = ColumnFile(len(columns), rows)
    for k, own in enumerate(columns):
        file.write(k, 0, own[kept])
        release()
    return list(file.columns(rows))
