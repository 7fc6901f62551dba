"""Reader of logs as text."""

from __future__ import annotations

import codecs
import csv
import math
import re
from contextlib import suppress
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.errors import FileError, printable
from adaptctl.logs.arrow import LogColumn, numbers
from adaptctl.logs.table import MAX_COLUMNS, LogTable, table, validate_size, whole_stamps
from adaptctl.logs.units import is_unit, spaced

HEAD = 1_000_000
"""bytes by which the form of a file is known"""
MAX_SPACED = 2**30
"""bytes of a file with blanks between its numbers, or with repeated names, which is rewritten in memory"""
MARKS = (",", ";", "\t", "|", " ")
"""marks between cells; a blank stands for any number of blanks"""
NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?$|[+-]?(?:nan|inf|infinity)$", re.IGNORECASE)
DATE = re.compile(r"\d{4}-\d\d-\d\d([ T]\d\d:\d\d(:\d\d([.,]\d+)?)?)?(Z|[+-]\d\d:?\d\d)?$")
CLOCK = re.compile(r"\d\d:\d\d:\d\d([.,]\d+)?$")
COMMENT = re.compile(r"\s*(#|//|%(?=\s))")
CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f]")
GROUPED = re.compile(
    r"[+-]?[1-9]\d{0,2}(?P<group>[.,'\u2019 \u00a0\u202f])\d{3}(?:(?P=group)\d{3})*"
    r"(?:(?!(?P=group))(?P<decimal>[.,])\d*(?:[eE][+-]?\d+)?)?$"
)
"""number with marks between thousands"""
EMPTY = ("", "NA", "N/A", "#N/A", "null", "NULL", "None", "none", "nan", "NaN", "NAN", "-nan", "-NaN")


@dataclass(frozen=True)
class _Form:
    """Form of a text table: mark between cells, decimal mark, names and units, and the lines before the numbers."""

    mark: str
    decimal: str
    skipped: int
    names: list[str] | None
    units: dict[str, str]
    count: int
    notes: tuple[str, ...] = ()
    heads: tuple[str, ...] = ()


def read_delimited(path: str | Path) -> LogTable:
    """Table of a text file: names, perhaps, then rows of numbers, separated by commas, semicolons, tabs or blanks."""
    try:
        with Path(path).open("rb") as file:
            sample = file.read(HEAD)
        encoding = _encoding(sample)
        form = _form(_lines(sample, encoding), path)
        read, notes = _read(path, form, encoding)
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: not a text table ({error})") from error
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({(error.strerror or str(error)).lower()})") from error
    validate_size(path, read.num_rows, read.num_columns)
    names = form.names or [str(i + 1) for i in range(read.num_columns)]
    found = [_column(name, read.column(i), form.decimal) for i, name in enumerate(names)]
    units = form.units | {one.name: one.unit for one in found if one.unit}
    empty = {one.name: one.empty for one in found if one.empty is not None}
    begin = {one.name: one.begin for one in found if one.begin}
    words = {one.name: one.word for one in found if one.word is not None}
    log = table(str(path), ((one.name, one.values) for one in found), units, empty, words, begin)
    return whole_stamps(replace(log, numbered=form.names is None, notes=(*form.notes, *notes)))


def _encoding(sample: bytes) -> str:
    """Encoding of a file by its beginning: Latin-1 if it is text, but no UTF-8."""
    if sample[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(sample)
    except UnicodeDecodeError:
        return "utf-8-sig" if CONTROL.search(sample) else "latin-1"
    return "utf-8-sig"


def _lines(sample: bytes, encoding: str) -> list[str]:
    """Whole lines at the beginning of a file, the last one too where the file ends with it."""
    text = codecs.getincrementaldecoder(encoding)().decode(sample)
    whole = text if len(sample) < HEAD or "\n" not in text else text[: text.rindex("\n")]
    return whole.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def cells(line: str, mark: str) -> list[str]:
    """Cells of a line without blanks and quotation marks around them."""
    parts = re.split(r"[ \t]+", line.strip()) if mark == " " else line.split(mark)
    if mark != " " and '"' in line:
        with suppress(csv.Error):  # of cells beyond any number's length
            parts = next(csv.reader([line], delimiter=mark), [])
    return [part.strip().strip("\"'").strip() for part in parts]


def _is_number(cell: str) -> bool:
    return any(form.match(cell) for form in (NUMBER, DATE, CLOCK, GROUPED))


def _mark(lines: list[str]) -> str:
    """Mark by which most of the cells in the lines are numbers."""
    sample = [line for line in lines[:200] if line.strip() and not COMMENT.match(line)]

    def share(mark: str) -> tuple[float, int, int]:
        each = [cells(line, mark) for line in sample]
        rows = [[_is_number(cell) for cell in row if cell] for row in each if any(map(_is_number, row))]
        numeric = sum(map(sum, rows))
        return round(numeric / max(1, sum(map(len, rows))), 2), numeric, sum(map(len, each))

    return max(MARKS, key=share)


def _form(lines: list[str], path: str | Path) -> _Form:
    mark = _mark(lines)
    first = next((i for i, line in enumerate(lines) if _is_row(line, mark)), None)
    before = lines if first is None else lines[:first]
    width = len(cells(lines[first], mark)) if first is not None else 0
    if width > MAX_COLUMNS:
        raise FileError(f"{path}: has {width} columns, more than the limit of {MAX_COLUMNS}")
    heads = [(i, _names(line, mark, width)) for i, line in enumerate(before) if line.strip()]
    named = [(i, names) for i, names in heads if names and not (COMMENT.match(before[i]) and len(names) == 1 < width)]
    units: list[str] | None = None
    if len(named) > 1 and named[-1][0] == named[-2][0] + 1 and all(is_unit(_unit(cell)) for cell in named[-1][1]):
        units = [_unit(cell) for cell in named.pop()[1]]
    if first is None:
        if not named:
            raise FileError(f"{path}: no rows of numbers; expected a line of column names and one line per sample")
        first, width = named[-1][0] + 1, len(named[-1][1])
    if not named and heads and not COMMENT.match(before[heads[-1][0]]):
        line, told = heads[-1][0], len(cells(before[heads[-1][0]], mark))
        raise FileError(
            f"{path}: not a text table (line {line + 1} has {told} names, and line {first + 1} {width} numbers)"
        )
    decimal = _decimal([cell for line in lines[first : first + 5000] for cell in cells(line, mark)])
    names = named[-1][1] if named else None
    names = None if names is None else [name or f"({i + 1})" for i, name in enumerate(names)]
    own = {} if names is None or units is None else {n: u for n, u in zip(names, units, strict=False) if u}
    notes = () if units is None else ("the line after the names was read as units",)
    lead = tuple(line.strip() for line in before if line.strip())
    return _Form(mark, decimal, first, names, own, width, notes, lead)


def _decimal(given: list[str]) -> str:
    """Mark before decimals: that after thousands, if any, else a comma where no number has a point."""
    told = next(filter(None, map(_after_thousands, given)), None)
    if told is not None:
        return told
    commas = any(re.search(r"\d,\d", cell) for cell in given)
    points = commas and any(re.search(r"\d\.\d", cell) and NUMBER.match(cell) for cell in given)
    return "," if commas and not points else "."


def _after_thousands(cell: str) -> str | None:
    """Decimal mark that a number with marks between thousands tells, None if it does not."""
    found = GROUPED.match(cell)
    if found is None or found["decimal"] or found["group"] not in ".," or cell.count(found["group"]) < 2:
        return found and found["decimal"]
    return "," if found["group"] == "." else "."


def _is_row(line: str, mark: str) -> bool:
    """True for a line of numbers: at least one cell is one, and the first that is not empty is, or most are."""
    found = [cell for cell in cells(line, mark) if cell]
    numeric = [_is_number(cell) for cell in found]
    return not COMMENT.match(line) and any(numeric) and (numeric[0] or 2 * sum(numeric) >= len(numeric))


def _names(line: str, mark: str, width: int) -> list[str]:
    """Names in a line before the numbers; none where their number is another."""
    found = cells(COMMENT.sub("", line, count=1), mark)
    if len(found) == width + 1 and not found[-1]:
        found = found[:-1]
    if len(found) == width - 1:  # rows end with a mark
        found = [*found, ""]
    return found if width in (0, len(found)) and any(found) else []


def _unit(cell: str) -> str:
    return spaced(cell.strip("[]() "))


def _read(path: str | Path, form: _Form, encoding: str) -> tuple[Any, list[str]]:
    """Columns of a file, and notes on lines left out."""
    read, odd = _parsed(path, form, encoding, _source(path, form, encoding))
    notes: list[str] = []
    if form.names is not None and any(_is_in(n, read.column(i)) for i, n in enumerate(form.names[: read.num_columns])):
        source, count = _rewritten(path, form, encoding)
        read, odd = _parsed(path, form, encoding, source)
        notes = [f"{count} lines that repeat those above the numbers were left out"]
    return read, [*notes, *_passed_over(path, form, encoding, odd)]


def _is_in(name: str, column: Any) -> bool:
    """True if a cell of a column is its name."""
    import pyarrow as pa
    from pyarrow import compute

    return bool(pa.types.is_string(column.type) and compute.index(column, name).as_py() >= 0)


def _parsed(path: str | Path, form: _Form, encoding: str, source: Any) -> tuple[Any, list[tuple[int, str]]]:
    """Columns of a file, and lines of another length with their numbers of cells."""
    from pyarrow import ArrowInvalid, default_memory_pool
    from pyarrow.csv import ConvertOptions, ParseOptions, ReadOptions, read_csv

    odd: list[tuple[int, str]] = []

    def is_passed_over(row: Any) -> str:
        odd.append((row.actual_columns, row.text))
        return "skip" if len(odd) < 10_000 else "error"

    try:
        read = read_csv(
            source,
            read_options=ReadOptions(
                skip_rows=form.skipped,
                column_names=form.names,
                autogenerate_column_names=form.names is None,
                encoding="utf8" if encoding == "utf-8-sig" else encoding,
            ),
            parse_options=ParseOptions(
                delimiter="\t" if form.mark == " " else form.mark, invalid_row_handler=is_passed_over
            ),
            convert_options=ConvertOptions(
                strings_can_be_null=True, null_values=list(EMPTY), decimal_point=form.decimal
            ),
        )
    except ArrowInvalid as error:
        if "Empty CSV" in str(error):
            raise FileError(
                f"{path}: no rows of numbers; expected a line of column names and one line per sample"
            ) from error
        raise FileError(f"{path}: not a text table ({printable(str(error).splitlines()[0])})") from error
    default_memory_pool().release_unused()  # several times the numbers, of text that has been read
    return read, odd


def _source(path: str | Path, form: _Form, encoding: str) -> Any:
    """File, or its content: without half a character at the end, and with one tab for the blanks between numbers."""
    import pyarrow as pa

    if form.mark == " ":
        return _rewritten(path, replace(form, heads=()), encoding)[0]
    size = Path(path).stat().st_size
    if encoding == "utf-16" and size % 2:
        return pa.BufferReader(pa.memory_map(str(path)).read_buffer(size - 1))
    return path


def _rewritten(path: str | Path, form: _Form, encoding: str) -> tuple[BytesIO, int]:
    """File with one tab for the blanks between numbers, and without lines that repeat its heads; their count."""
    if Path(path).stat().st_size > MAX_SPACED:
        raise FileError(f"{path}: more than {MAX_SPACED} bytes, which have to be rewritten; use commas, or split it")
    text = codecs.getincrementaldecoder(encoding)().decode(Path(path).read_bytes())
    lines = re.split("\r\n|\r|\n", text)
    kept = [line for i, line in enumerate(lines) if i < form.skipped or line.strip() not in form.heads]
    text = "\n".join(kept)
    if form.mark == " ":
        text = re.sub(r"[ \t]+", "\t", re.sub(r"^[ \t]+|[ \t]+$", "", text, flags=re.MULTILINE))
    return BytesIO(text.encode(encoding)), len(lines) - len(kept)


def _passed_over(path: str | Path, form: _Form, encoding: str, odd: list[tuple[int, str]]) -> list[str]:
    """Notes on comments and a last line that was cut off; `FileError` for other lines of another length."""
    comments = [text for _, text in odd if COMMENT.match(text)]
    others = [(count, text) for count, text in odd if not COMMENT.match(text)]
    notes = [f"{len(comments)} lines of comments left out"] if comments else []
    for count, text in others[:1]:
        first, *more = text.splitlines()
        number, last = _place(path, form, encoding, first)
        if len(others) == 1 and count < form.count and last and not more:
            return [*notes, "the last line, which is cut off, was left out"]
        why = "opens a quotation mark that is not closed" if more else f"has {count} cells, not {form.count}"
        raise FileError(f"{path}: not a text table (line {number} {why}: {printable(repr(first[:60]))})")
    return notes


def _place(path: str | Path, form: _Form, encoding: str, text: str) -> tuple[int | str, bool]:
    """Number of the first line among the rows that reads so, and whether the file ends with it."""
    number: int | str = "?"
    with Path(path).open(encoding=encoding, errors="ignore") as file:
        for i, line in enumerate(file, 1):
            if number != "?" and line.strip():
                return number, False
            if i > form.skipped and number == "?" and line.split() == text.split():
                number = i
    return number, number != "?"


def _column(name: str, column: Any, decimal: str) -> LogColumn:
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
