"""Logs as delimited text: a line of column names, then a line a sample."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import FileError
from adaptctl.identification.reading.table import MAX_ROWS, LogTable, table


def read_delimited(path: str | Path) -> LogTable:
    """The table of a log in the text file `path`, a `LogTable`. The file has a line of column names, then a line of
    numbers for each sample, separated by commas, semicolons or tabs, whichever the first line has most of. Names lose
    spaces around them; no units are read. Numbers have decimal points, or, where no comma separates, commas.

    An empty cell, NaN, nan, NA or null becomes NaN. A column with any other cell that is not a number becomes NaN in
    all rows. Raises `FileError` for a file that cannot be read or is no table, with no rows or more than 20 million, or
    with two columns of one name.
    """
    from pyarrow import ArrowInvalid
    from pyarrow.csv import ConvertOptions, ParseOptions, read_csv

    try:
        with Path(path).open("rb") as file:
            head, rows = file.readline(1_000_000), file.read(1_000_000)
        mark = max((",", ";", "\t"), key=lambda mark: head.count(mark.encode()))
        read = read_csv(
            path,
            parse_options=ParseOptions(delimiter=mark),
            convert_options=ConvertOptions(
                strings_can_be_null=True,
                null_values=["", "NaN", "nan", "NA", "null"],
                decimal_point="," if mark != "," and _has_decimal_commas(rows) else ".",
            ),
        )
        names = [name.strip() for name in read.column_names]
    except (ArrowInvalid, UnicodeDecodeError) as error:
        raise FileError(f"{path}: not a table in text ({str(error).splitlines()[0]})") from error
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({(error.strerror or str(error)).lower()})") from error
    if read.num_rows > MAX_ROWS:
        raise FileError(f"{path}: has {read.num_rows} rows, more than the {MAX_ROWS} that are read")
    return table(str(path), ((name, _numbers(read.column(i))) for i, name in enumerate(names)))


def _has_decimal_commas(rows: bytes) -> bool:
    """True if numbers have commas before their decimals, and none has a point there."""
    return re.search(rb"\d,\d", rows) is not None and re.search(rb"\d\.\d", rows) is None


def _numbers(column: Any) -> Array:
    """The column as floats, NaN where a cell is no number."""
    from pyarrow import ArrowInvalid, ArrowNotImplementedError, float64

    try:
        return np.asarray(column.cast(float64()).to_numpy(), dtype=np.float64)
    except (ArrowInvalid, ArrowNotImplementedError):
        return np.full(len(column), np.nan)
