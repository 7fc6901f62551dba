"""The paper as data (paper.toml), and judgement of its entries."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from importlib.resources import as_file, files
from string import Formatter
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.files import read_toml
from adaptctl.recording.wording import number

if TYPE_CHECKING:
    from adaptctl.recording.drawing import Drawing

BLANK, MARK = ".", "x"
ROUNDING_UNITS = 0.5 + 1e-9
"""units of the last digit; halves are rounded themselves"""


class Outturn(Enum):
    """Verdicts on what the paper prints."""

    GIVEN = "given"
    REPRODUCED = "reproduced"
    IN_SHAPE = "reproduced in shape"
    ERRATUM = "erratum"
    NOT_REPRODUCED = "not reproduced"


class Printed(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Table, figure or section of the paper with its printed entries."""

    title: str
    summary: str = ""
    columns: list[str] = []
    rows: dict[str, str] = {}
    tolerance: float = 0.0
    inputs: bool = False
    errata: dict[str, list[str]] = {}
    claims: list[str] = []
    chosen: list[str] = []
    evidence: dict[str, str] = {}
    holds: Outturn | None = None

    def __post_init__(self) -> None:
        for label, row in self.rows.items():
            if len(row.split()) != len(self.columns):
                raise ValueError(f"row {label!r} has {len(row.split())} entries, expected {len(self.columns)}")

    def entries(self) -> Iterator[tuple[str, str, str]]:
        """Entries by row: labels of row and column, and text, "." for a blank."""
        for label, row in self.rows.items():
            yield from ((label, column, text) for column, text in zip(self.columns, row.split(), strict=True))

    def values(self, *labels: str) -> Array:
        """Numbers (rows, columns) of the rows with these `labels`."""
        return np.array([[float(text) for text in self.rows[label].split()] for label in labels or self.rows])


class Saying(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Sentence of the paper that is judged."""

    where: str
    quote: str
    numbers: str
    measured: str
    found: str
    holds: Outturn = Outturn.REPRODUCED
    fails: Outturn = Outturn.NOT_REPRODUCED
    at_least: float = 0.5


class Paper(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Contents of the paper."""

    schema: Literal["adaptctl/paper/1"]
    meanings: dict[Outturn, str]
    items: dict[str, Printed]
    claims: dict[str, Saying]


@cache
def printed() -> Paper:
    """Contents of paper.toml, read once."""
    with as_file(files("adaptctl.experiments.replication") / "paper.toml") as path:
        return read_toml(path, Paper)


@dataclass(frozen=True)
class Number:
    """Number as printed, with the unit of its last digit."""

    text: str
    value: float
    unit: float
    digits: int

    @classmethod
    def of(cls, text: str) -> Number:
        """Number from a text such as "4.4E+04". Raises `InputError` for others."""
        mantissa, _, exponent = text.upper().partition("E")
        decimals = len(mantissa.partition(".")[2])
        significant = len(mantissa.lstrip("+-").replace(".", "").lstrip("0")) or 1
        digits = decimals if decimals and not exponent else significant
        try:
            return cls(text, float(text), 10.0 ** (int(exponent or 0) - decimals), digits)
        except ValueError as error:
            raise InputError(f"{text!r} is not a printed number") from error

    def digits_met(self, computed: float) -> int:
        """Number of printed digits that agree."""
        off = abs(computed - self.value) / self.unit
        lost = 0 if off <= ROUNDING_UNITS else math.ceil(math.log10(2.0 * off) - 1e-12)
        return max(self.digits - lost, 0)

    def styled(self, computed: float) -> str:
        """Text of a `computed` number with this one's decimals; no minus sign on zero."""
        mantissa, exponent, _ = self.text.upper().partition("E")
        rounded = f"{computed:.{len(mantissa.partition('.')[2])}{'E' if exponent else 'f'}}"
        return rounded.lstrip("-") if float(rounded) == 0.0 else rounded


@dataclass(frozen=True)
class Check:
    """Comparison of a printed entry."""

    row: str
    column: str
    printed: str
    computed: str
    verdict: Outturn
    digits: int | None = None
    of_digits: int | None = None
    low: float | None = None
    high: float | None = None

    @property
    def is_mark(self) -> bool:
        """True for a cross or a blank."""
        return self.printed in (MARK, "")

    @property
    def exact(self) -> bool:
        """True if every printed digit agrees."""
        return self.verdict is Outturn.REPRODUCED and self.digits == self.of_digits


class RoundOff(NamedTuple):
    """Value of what is zero in exact arithmetic, and its bound."""

    value: float
    bound: float


Computed: TypeAlias = float | bool | Array | RoundOff
"""What an entry is compared with."""
Entry: TypeAlias = Callable[[str, str], Computed]
"""What is compared with the printed entry in a row and a column."""
Holds: TypeAlias = bool | float | tuple[bool, float]
"""Whether a claim holds, or on which share of the draws, or both."""


def check(table: Printed, row: str, column: str, text: str, computed: Computed) -> Check:
    """Comparison with a bool, values of random draws, or a value of the paper's data."""
    unlike = Outturn.ERRATUM if column in table.errata.get(row, ()) else Outturn.NOT_REPRODUCED
    if isinstance(computed, bool):
        marks = (MARK if text == MARK else "", MARK if computed else "")
        return Check(row, column, *marks, Outturn.REPRODUCED if marks[0] == marks[1] else unlike)
    printed = Number.of(text)
    if isinstance(computed, RoundOff):
        small = max(abs(printed.value), abs(computed.value)) < computed.bound
        return Check(row, column, text, f"{computed.value:.1E}", Outturn.IN_SHAPE if small else unlike)
    if isinstance(computed, np.ndarray):
        low, high = float(computed.min()), float(computed.max())
        inside = low - 0.5 * printed.unit <= printed.value <= high + 0.5 * printed.unit
        middle = printed.styled(float(np.median(computed)))
        return Check(row, column, text, middle, Outturn.IN_SHAPE if inside else unlike, low=low, high=high)
    shown, digits = printed.styled(computed), (printed.digits_met(computed), printed.digits)
    if abs(computed - printed.value) > max(table.tolerance, ROUNDING_UNITS * printed.unit):
        return Check(row, column, text, shown, unlike)
    return Check(row, column, text, shown, *((Outturn.GIVEN,) if table.inputs else (Outturn.REPRODUCED, *digits)))


def checked(table: Printed, entry: Entry) -> tuple[Check, ...]:
    """Comparisons of all entries with `entry(row, column)`."""
    marked = any(text == MARK for _, _, text in table.entries())
    entries = (one for one in table.entries() if marked or one[2] != BLANK)
    return tuple(check(table, *one, entry(*one[:2])) for one in entries)


class Claim(NamedTuple):
    """Judged statement of the paper."""

    section: str
    quote: str
    measured: str
    found: str
    verdict: Outturn
    share_of_seeds: float | None = None


class Evidence(NamedTuple):
    """A `sentence`, and the `values` of its numbers."""

    sentence: str
    values: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Computation:
    """Computed values of an item."""

    numbers: Mapping[str, Any] = field(default_factory=dict)
    entry: Entry | None = None
    claims: Mapping[str, Holds] = field(default_factory=dict)
    agrees: bool = True
    relations: Mapping[str, Sequence[str]] = field(default_factory=dict)
    drawings: Sequence[Drawing] = ()


@dataclass(frozen=True, eq=False)
class Item:
    """Table, figure or section that was computed again."""

    name: str
    title: str
    verdict: Outturn
    summary: str
    chosen: tuple[str, ...]
    claims: tuple[Claim, ...]
    evidence: tuple[Evidence, ...]
    checks: tuple[Check, ...]
    found: Computation


def judged_item(name: str, paper: Paper, found: Computation, numbers: Mapping[str, Any]) -> Item:
    """Item with its judged entries and claims."""
    said = paper.items[name]
    checks, known = checked(said, found.entry) if found.entry else (), {**numbers, **found.numbers}
    claims = tuple(_claim(paper.claims[key], found.claims[key], known) for key in said.claims)
    count = sum(claim.verdict is not Outturn.NOT_REPRODUCED for claim in claims)
    held = f"{count or 'None'} of the {len(claims)} claims of the text {'holds' if count == 1 else 'hold'}."
    known = {"all": len(checks), "exact": sum(c.exact for c in checks), "inside": inside(checks), "held": held, **known}
    verdict = judged(checks, claims)
    if said.holds and verdict in (Outturn.GIVEN, said.holds):
        verdict = said.holds if found.agrees else Outturn.NOT_REPRODUCED
    several = {key: known[key] if isinstance(known.get(key), list) else [known] for key in said.evidence}
    evidence = tuple(_evidence(text, one) for key, text in said.evidence.items() for one in several[key])
    chosen = tuple(text.format(**known) for text in said.chosen)
    return Item(name, said.title, verdict, said.summary.format(**known), chosen, claims, evidence, checks, found)


def _claim(saying: Saying, found: Holds, numbers: Mapping[str, Any]) -> Claim:
    holds, share = found if isinstance(found, tuple) else (found, None if isinstance(found, bool) else float(found))
    filled = {**numbers, "numbers": saying.numbers, "share": percent(share or 0.0)}
    measured, told = (text.format(**filled) for text in (saying.measured, saying.found))
    verdict = saying.holds if holds >= saying.at_least else saying.fails
    return Claim(saying.where, saying.quote, measured, told, verdict, share)


class _Digits(float):
    """Number whose format is a count of digits: 3 by default."""

    def __format__(self, digits: str) -> str:
        return number(float(self), int(digits or 3))


def _evidence(text: str, numbers: Mapping[str, Any]) -> Evidence:
    names = [name for _, name, _, _ in Formatter().parse(text) if name]
    values = {name: _Digits(numbers[name]) for name in names if not isinstance(numbers[name], str)}
    return Evidence(text.format(**{**numbers, **values}), tuple(map(float, values.values())))


def inside(checks: Sequence[Check]) -> int:
    """Number of checks within the values of the draws."""
    return sum(one.verdict is Outturn.IN_SHAPE for one in checks)


def judged(checks: Sequence[Check], claims: Sequence[Claim] = ()) -> Outturn:
    """Verdict on an item."""
    verdicts = [check.verdict for check in checks if check.verdict is not Outturn.GIVEN]
    if Outturn.NOT_REPRODUCED in verdicts or (claims and all(c.verdict is Outturn.NOT_REPRODUCED for c in claims)):
        return Outturn.NOT_REPRODUCED
    if Outturn.ERRATUM in (*verdicts, *(claim.verdict for claim in claims)):
        return Outturn.ERRATUM
    return max(verdicts, key=verdicts.count) if verdicts else Outturn.GIVEN


def percent(share: float) -> str:
    """Percentage with three significant digits, "0.5 %" for 0.005."""
    return f"{100.0 * share:.3g}\N{NO-BREAK SPACE}%"
