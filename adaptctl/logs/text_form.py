"""Form of a text table: marks, names, units and the lines before the numbers."""

from __future__ import annotations

import codecs
import csv
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from adaptctl.errors import FileError
from adaptctl.logs.table import MAX_COLUMNS
from adaptctl.logs.units import is_unit, spaced

HEAD = 1_000_000
"""bytes by which the form of a file is known"""
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
MARKED = re.compile(r"\d[,'\u2019 \u00a0\u202f]\d|\.\d+\.")
"""marks in a number that a decimal point alone does not have"""


@dataclass(frozen=True)
class TextForm:
    """Form of a text table: mark between cells, decimal mark, names and units, and the lines before the numbers."""

    mark: str
    decimal: str
    skipped: int
    names: list[str] | None
    units: dict[str, str]
    count: int
    encoding: str
    notes: tuple[str, ...] = ()
    heads: tuple[str, ...] = ()


def form_of(path: str | Path) -> TextForm:
    """Form of a file, by its beginning."""
    with Path(path).open("rb") as file:
        sample = file.read(HEAD)
    encoding = _encoding(sample)
    return _form(_lines(sample, encoding), path, encoding)


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


def _form(lines: list[str], path: str | Path, encoding: str) -> TextForm:
    mark = _mark(lines)
    first = next((i for i, line in enumerate(lines) if _is_row(line, mark)), None)
    if first is None:
        raise FileError(f"{path}: no rows of numbers; expected a line of column names and one line per sample")
    before, width = lines[:first], len(cells(lines[first], mark))
    if width > MAX_COLUMNS:
        raise FileError(f"{path}: has {width} columns, more than the limit of {MAX_COLUMNS}")
    heads = [(i, _names(line, mark, width)) for i, line in enumerate(before) if line.strip()]
    is_title = {i: width > 1 and COMMENT.match(before[i]) and not any(names[1:]) for i, names in heads}
    named = [(i, names) for i, names in heads if names and not is_title[i]]
    units: list[str] | None = None
    if len(named) > 1 and named[-1][0] == named[-2][0] + 1 and all(is_unit(_unit(cell)) for cell in named[-1][1]):
        units = [_unit(cell) for cell in named.pop()[1]]
    if not named and heads and not COMMENT.match(before[heads[-1][0]]):
        line, told = heads[-1][0], len(cells(before[heads[-1][0]], mark))
        raise FileError(
            f"{path}: not a text table (line {line + 1} has {told} names, and line {first + 1} {width} numbers)"
        )
    decimal = _decimal(lines[first : first + 5000], mark)
    names = named[-1][1] if named else None
    names = None if names is None else [name or f"({i + 1})" for i, name in enumerate(names)]
    own = {} if names is None or units is None else {n: u for n, u in zip(names, units, strict=False) if u}
    notes = () if units is None else ("the line after the names was read as units",)
    lead = tuple(line.strip() for line in before if line.strip())
    return TextForm(mark, decimal, first, names, own, width, encoding, notes, lead)


def _decimal(lines: list[str], mark: str) -> str:
    """Mark before decimals: that after thousands, if any, else a comma where no number has a point."""
    text = "\n".join(lines)
    if '"' not in text and not MARKED.search(text.replace(mark, "\n")):
        return "."
    given = [cell for line in lines for cell in cells(line, mark)]
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
    return found if width == len(found) and any(found) else []


def _unit(cell: str) -> str:
    return spaced(cell.strip("[]() "))
