"""Contents of the paper as data, printed.toml, digits and all; and the words of the replication, words.toml."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from functools import cache
from importlib.resources import as_file, files
from typing import Literal, TypeVar

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.files import read_toml

BLANK, MARK = ".", "x"
HALF = 0.5 + 1e-9
"""units of the last digit that a rounded number may be off, halves being rounded themselves"""
Read = TypeVar("Read")


class Outturn(Enum):
    """Enumeration of verdicts on what the paper prints: GIVEN, an input used as printed; REPRODUCED, computed again;
    IN_SHAPE, which depends on what is not printed and lies among the values computed for what was chosen here; ERRATUM,
    shown to be wrong; NOT_REPRODUCED, outside of all that was computed, and not shown to be wrong."""

    GIVEN = "given"
    REPRODUCED = "reproduced"
    IN_SHAPE = "reproduced in shape"
    ERRATUM = "erratum"
    NOT_REPRODUCED = "not reproduced"


class PrintedTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Table as the paper prints it: `title`; `columns`, their labels; `rows`, texts by label with an entry for each
    column, a dot for a blank. `tolerance`, in the numbers' unit, is how far a computed value may be off, half a unit of
    the last printed digit where it is less; `inputs` is True where the numbers are used as printed; `errata` names, by
    row, columns whose entries are shown to be wrong. Raises `ValueError` at construction for a row of another
    length."""

    title: str
    columns: list[str]
    rows: dict[str, str]
    tolerance: float = 0.0
    inputs: bool = False
    errata: dict[str, list[str]] = {}

    def __post_init__(self) -> None:
        for label, row in self.rows.items():
            if len(row.split()) != len(self.columns):
                raise ValueError(f"row {label!r} has {len(row.split())} entries, expected {len(self.columns)}")

    def entries(self) -> Iterator[tuple[str, str, str]]:
        """Iterator over entries, row by row: the row's label, the column's label and the text, "." for a blank."""
        for label, row in self.rows.items():
            for column, text in zip(self.columns, row.split(), strict=True):
                yield label, column, text

    def values(self, *labels: str) -> Array:
        """Numbers (rows, columns) of the rows with these `labels`, without any of all rows. Raises `KeyError` for an
        unknown label, `ValueError` for an entry that is no number."""
        return np.array([[float(text) for text in self.rows[label].split()] for label in labels or self.rows])


class Saying(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Quotation that is judged: `where`, its section; `quote`, the sentence; `numbers` in question, as text."""

    where: str
    quote: str
    numbers: str


class Printed(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Contents of the paper that can be computed again: `tables`; numbers in its text that stand in `sentences`, laid
    out as tables; and `claims`, quotations; all by short names."""

    schema: Literal["adaptctl/printed/1"]
    tables: dict[str, PrintedTable]
    sentences: dict[str, PrintedTable]
    claims: dict[str, Saying]

    def of(self, item: str) -> PrintedTable | None:
        """Table of the printed entries of an `item`, None where it has none."""
        return self.tables.get(item) or self.sentences.get(item)


class Said(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Words of an item, with computed values in braces: `title`, `summary`, what was `chosen`, and `evidence`. `claims`
    are those judged with it; `holds` is its verdict where nothing printed is compared, and the computation agrees."""

    summary: str
    title: str = ""
    chosen: list[str] = []
    evidence: dict[str, str] = {}
    claims: list[str] = []
    holds: Outturn | None = None


class ClaimWords(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Words on a claim: what was `measured` and `found`, with computed values in braces; its verdict where it `holds`,
    which is where the computation agrees, on a share of the draws of `at_least` so much, and where it `fails`. `saying`
    is the quotation's name where that is not the claim's."""

    measured: str
    found: str
    saying: str = ""
    holds: Outturn = Outturn.REPRODUCED
    fails: Outturn = Outturn.NOT_REPRODUCED
    at_least: float = 0.5


class Words(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Words of the whole replication: of its `items`, of its `claims`, and of each verdict, its `meanings`."""

    schema: Literal["adaptctl/words/1"]
    items: dict[str, Said]
    claims: dict[str, ClaimWords]
    meanings: dict[Outturn, str]


def _read(name: str, kind: type[Read]) -> Read:
    with as_file(files("adaptctl.experiments.replication") / name) as path:
        return read_toml(path, kind)


@cache
def printed() -> Printed:
    """Contents of the paper, from printed.toml, read once."""
    return _read("printed.toml", Printed)


@cache
def words() -> Words:
    """Words of the replication, from words.toml, read once."""
    return _read("words.toml", Words)


@dataclass(frozen=True)
class Number:
    """Number as printed: `text`; `value`; `unit`, that of its last digit; and `digits`, by which agreement is measured:
    its decimals where it has some and no exponent, since a column shares them, else its significant digits."""

    text: str
    value: float
    unit: float
    digits: int

    @classmethod
    def of(cls, text: str) -> Number:
        """Number for a printed `text`, such as "4.4E+04". Raises `InputError` for a text that is no number."""
        mantissa, _, exponent = text.upper().partition("E")
        decimals = len(mantissa.partition(".")[2])
        significant = len(mantissa.lstrip("+-").replace(".", "").lstrip("0")) or 1
        digits = decimals if decimals and not exponent else significant
        try:
            return cls(text, float(text), 10.0 ** (int(exponent or 0) - decimals), digits)
        except ValueError as error:
            raise InputError(f"{text!r} is not a printed number") from error

    def digits_met(self, computed: float) -> int:
        """Count of printed digits with which a `computed` value agrees: all within half a unit of the last, one less
        for each tenfold of that. Raises `ValueError` for NaN, `OverflowError` for infinity."""
        off = abs(computed - self.value) / self.unit
        lost = 0 if off <= HALF else math.ceil(math.log10(2.0 * off) - 1e-12)
        return max(self.digits - lost, 0)

    def styled(self, computed: float) -> str:
        """Text of a `computed` number with this one's decimals and exponent; no minus sign where it rounds to zero."""
        decimals = len(self.text.upper().partition("E")[0].partition(".")[2])
        if "E" in self.text.upper():
            return f"{computed:.{decimals}E}"
        rounded = f"{computed:.{decimals}f}"
        return rounded.lstrip("-") if float(rounded) == 0.0 else rounded
