"""Contents of the paper: its tables and sayings, from ``printed.toml``, digits and all."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from typing import Literal

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.files import read_toml

BLANK, MARK = ".", "x"


class Table(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Table as Sheu and Walker (1991) print it: `title`, `columns` by their labels, and `rows`, texts by their labels,
    with an entry for each column, spaces between, and a dot for a blank. Raises `ValueError` for a row with another
    number of entries."""

    title: str
    columns: list[str]
    rows: dict[str, str]

    def __post_init__(self) -> None:
        for label, row in self.rows.items():
            if len(row.split()) != len(self.columns):
                raise ValueError(f"row {label!r} has {len(row.split())} entries, expected {len(self.columns)}")

    def entries(self) -> Iterator[tuple[str, str, str]]:
        """Entries of the table, row by row: each its row's label, its column's label, and its text, "." for a blank."""
        for label, row in self.rows.items():
            for column, text in zip(self.columns, row.split(), strict=True):
                yield label, column, text

    def values(self, *labels: str) -> Array:
        """Numbers (rows, columns) in the rows with these `labels`, in the order given, or without any in all rows, as
        printed. Raises `KeyError` for an unknown label, `ValueError` for a blank or other entry that is no number."""
        rows = [self.rows[label].split() for label in labels or self.rows]
        return np.array([[float(text) for text in row] for row in rows])


class Saying(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Quotation from Sheu and Walker (1991) that is to be judged: `where`, the number of its section; `quote`, the
    sentence; and `numbers`, those in question, as text with spaces between."""

    where: str
    quote: str
    numbers: str


class Printed(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Contents of Sheu and Walker (1991) that can be computed again: `tables` and quotations (`claims`), each by a
    short name, such as "table7" or "puma_rank"; `schema` names the file's format."""

    schema: Literal["adaptctl/printed/1"]
    tables: dict[str, Table]
    claims: dict[str, Saying]


@cache
def printed() -> Printed:
    """Contents of Sheu and Walker (1991), tables and quotations, from the file printed.toml of this package, read
    once."""
    with as_file(files("adaptctl.experiments.replication") / "printed.toml") as path:
        return read_toml(path, Printed)


@dataclass(frozen=True)
class Number:
    """Number as printed: its `text`; its `value`; `unit`, what one unit of its last digit is worth; and `digits`, how
    many it has.

    Digits are the decimals where there are any and no exponent, since columns of a table share them; else all digits
    but leading zeros. Nothing is checked at construction.
    """

    text: str
    value: float
    unit: float
    digits: int

    @classmethod
    def of(cls, text: str) -> Number:
        """Number that a `text` such as "-0.0805" or "4.4E+04" prints, with its digits. Raises `InputError` for another
        text."""
        mantissa, _, exponent = text.upper().partition("E")
        decimals = len(mantissa.partition(".")[2])
        significant = len(mantissa.lstrip("+-").replace(".", "").lstrip("0")) or 1
        digits = decimals if decimals and not exponent else significant
        try:
            return cls(text, float(text), 10.0 ** (int(exponent or 0) - decimals), digits)
        except ValueError as error:
            raise InputError(f"{text!r} is not a printed number") from error

    def digits_met(self, computed: float) -> int:
        """Number of the printed digits, 0 to all, that a `computed` value in the same unit agrees with when it is
        rounded likewise. Raises `ValueError` for NaN, `OverflowError` for infinity."""
        off = abs(computed - self.value) / self.unit
        lost = 0 if off <= 0.5 + 1e-9 else math.ceil(math.log10(2.0 * off) - 1e-12)
        return max(self.digits - lost, 0)

    def styled(self, computed: float) -> str:
        """Text of a `computed` value in the style of the printed number: as many decimals, and an exponent where that
        has one; without, what rounds to zero has no minus sign."""
        decimals = len(self.text.upper().partition("E")[0].partition(".")[2])
        if "E" in self.text.upper():
            return f"{computed:.{decimals}E}"
        rounded = f"{computed:.{decimals}f}"
        return rounded.lstrip("-") if float(rounded) == 0.0 else rounded
