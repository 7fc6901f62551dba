"""Contents of the paper: its tables and sayings, from ``printed.toml``, digits and all."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from typing import Literal, TypeAlias

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.files import read_toml

BLANK, MARK = ".", "x"


class PrintedTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Table as Sheu and Walker (1991) print it: `title`; `columns`, their labels; and `rows`, which maps labels to
    texts with an entry for each column, separated by spaces, and a dot for a blank. Raises `ValueError` at construction
    for a row with another number of entries."""

    title: str
    columns: list[str]
    rows: dict[str, str]

    def __post_init__(self) -> None:
        for label, row in self.rows.items():
            if len(row.split()) != len(self.columns):
                raise ValueError(f"row {label!r} has {len(row.split())} entries, expected {len(self.columns)}")

    def entries(self) -> Iterator[tuple[str, str, str]]:
        """Iterator over the entries of the printed table, row by row: for each a tuple of its row's label, its column's
        label and its text, "." for a blank. Nothing is checked."""
        for label, row in self.rows.items():
            for column, text in zip(self.columns, row.split(), strict=True):
                yield label, column, text

    def values(self, *labels: str) -> Array:
        """Numbers (rows, columns) in the rows of the printed table with these `labels`, in the order given, or without
        any in all rows, as printed. Raises `KeyError` for an unknown label, `ValueError` for a blank or other entry
        that is no number."""
        rows = [self.rows[label].split() for label in labels or self.rows]
        return np.array([[float(text) for text in row] for row in rows])


Table: TypeAlias = PrintedTable


class Saying(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Quotation from Sheu and Walker (1991) that is to be judged: `where`, the number of its section; `quote`, the
    sentence; and `numbers`, the numbers in it that are in question, as text separated by spaces. Types are checked
    where a file is read, not at construction."""

    where: str
    quote: str
    numbers: str


class Printed(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Contents of Sheu and Walker (1991) that can be computed again: `tables`, a `Table` each, and `claims`,
    quotations, a `Saying` each, by short names, such as "table7" or "puma_rank"; `schema` is the file format's name.
    Types are checked where a file is read, not at construction."""

    schema: Literal["adaptctl/printed/1"]
    tables: dict[str, Table]
    claims: dict[str, Saying]


@cache
def printed() -> Printed:
    """Contents of Sheu and Walker (1991), a `Printed` of tables and quotations, from the file printed.toml in this
    package, read once and then cached. Nothing is raised."""
    with as_file(files("adaptctl.experiments.replication") / "printed.toml") as path:
        return read_toml(path, Printed)


@dataclass(frozen=True)
class Number:
    """Number as a table of Sheu and Walker (1991) prints it: `text`, its characters; `value`, what they stand for;
    `unit`, the value of one unit in the last printed digit, such as 0.0001 for "-0.0805"; and `digits`, the count of
    printed digits by which agreement is measured.

    For a number with decimals and without an exponent, `digits` is the count of its decimals, since the numbers in a
    column share it; otherwise it is the count of significant digits. Nothing is checked at construction.
    """

    text: str
    value: float
    unit: float
    digits: int

    @classmethod
    def of(cls, text: str) -> Number:
        """The `Number` that a printed `text` such as "-0.0805" or "4.4E+04" stands for. Raises `InputError` for a text
        that is no number."""
        mantissa, _, exponent = text.upper().partition("E")
        decimals = len(mantissa.partition(".")[2])
        significant = len(mantissa.lstrip("+-").replace(".", "").lstrip("0")) or 1
        digits = decimals if decimals and not exponent else significant
        try:
            return cls(text, float(text), 10.0 ** (int(exponent or 0) - decimals), digits)
        except ValueError as error:
            raise InputError(f"{text!r} is not a printed number") from error

    def digits_met(self, computed: float) -> int:
        """Count of the printed number's digits, from 0 to all, with which a `computed` value in the same physical unit
        agrees: all where it is within half a unit of the last digit, one less for each tenfold of that. Raises
        `ValueError` for NaN, `OverflowError` for infinity."""
        off = abs(computed - self.value) / self.unit
        lost = 0 if off <= 0.5 + 1e-9 else math.ceil(math.log10(2.0 * off) - 1e-12)
        return max(self.digits - lost, 0)

    def styled(self, computed: float) -> str:
        """Number `computed`, formatted as text in the style of this printed number: with as many decimals, and with an
        exponent where the printed number has one; a value without exponent that rounds to zero has no minus sign.
        Nothing is checked."""
        decimals = len(self.text.upper().partition("E")[0].partition(".")[2])
        if "E" in self.text.upper():
            return f"{computed:.{decimals}E}"
        rounded = f"{computed:.{decimals}f}"
        return rounded.lstrip("-") if float(rounded) == 0.0 else rounded
