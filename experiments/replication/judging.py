"""Comparisons that judge what the paper prints: of an entry, of a claim, of a table, figure or section."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from string import Formatter
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.replication.printed import (
    BLANK,
    HALF,
    MARK,
    Number,
    Outturn,
    Printed,
    PrintedTable,
    Saying,
    words,
)
from adaptctl.recording.wording import number

if TYPE_CHECKING:
    from adaptctl.recording.drawing import Drawing


@dataclass(frozen=True)
class Check:
    """Comparison of one printed entry with what is computed: its `row` and `column`; the texts `printed` and
    `computed`; the `verdict`; how many `digits` of `of_digits` agree (None where not counted); and `low` and `high`,
    the least and the greatest value over the random draws (None without draws)."""

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
        """True for a cross or a blank in a table of parameters that are kept, which is no number."""
        return self.printed in (MARK, "")

    @property
    def reads_alike(self) -> bool:
        """True if both texts are equal, leading plus signs aside, or both are zero."""
        texts = (self.computed.lstrip("+"), self.printed.lstrip("+"))
        return texts[0] == texts[1] or (not self.is_mark and {float(text) for text in texts} == {0.0})

    @property
    def exact(self) -> bool:
        """True if the entry is reproduced with every printed digit."""
        return self.verdict is Outturn.REPRODUCED and self.digits == self.of_digits


@dataclass(frozen=True)
class RoundOff:
    """Computed value of what is zero in exact arithmetic: `value`, and the `bound` that it and the printed number stay
    below."""

    value: float
    bound: float


Computed: TypeAlias = float | bool | Array | RoundOff
"""What an entry is compared with."""
Holds: TypeAlias = bool | float | tuple[bool, float]
"""Whether a claim holds, or on which share of the draws, or both."""


def check(table: PrintedTable, row: str, column: str, text: str, computed: Computed) -> Check:
    """Comparison of the printed `text` in a `row` and `column` of a `table` with what is `computed`: a bool, whether a
    parameter is kept, with a cross or a blank; the values (seeds,) of random draws, among which the number is IN_SHAPE,
    half a unit of its last digit allowed; `RoundOff`; or a number, which is REPRODUCED within half a unit of the last
    digit or the table's tolerance, and GIVEN where it is an input. What disagrees is an ERRATUM where the table says
    so, else NOT_REPRODUCED. Raises `InputError` for a text that is no number."""
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
    if abs(computed - printed.value) > max(table.tolerance, HALF * printed.unit):
        return Check(row, column, text, shown, unlike)
    if table.inputs:
        return Check(row, column, text, shown, Outturn.GIVEN)
    return Check(row, column, text, shown, Outturn.REPRODUCED, *digits)


@dataclass(frozen=True)
class Claim:
    """Judged statement: `saying`, its quotation; what was `measured` and `found`, in words; `verdict`; and `share`, the
    fraction of the random draws on which it holds (None without draws)."""

    saying: Saying
    measured: str
    found: str
    verdict: Outturn
    share: float | None = None


@dataclass(frozen=True)
class Evidence:
    """Evidence for a verdict: a `sentence` with {} where its `values` belong, shown with so many `digits`."""

    sentence: str
    values: tuple[float, ...]
    digits: int

    def __str__(self) -> str:
        return self.sentence.format(*(number(float(value), self.digits) for value in self.values))


@dataclass(frozen=True, eq=False)
class Item:
    """Table, figure or section that was computed again: `name`, as on the command line; `title`; `verdict`; `summary`;
    sentences on what was `chosen`; `checks` of its entries; judged `claims`; `evidence`; `relations` among parameters,
    texts by their heading; and `drawings`."""

    name: str
    title: str
    verdict: Outturn
    summary: str
    chosen: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()
    claims: tuple[Claim, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    relations: Mapping[str, Sequence[str]] = field(default_factory=dict)
    drawings: tuple[Drawing, ...] = ()

    @property
    def label(self) -> str:
        """Name as a sentence has it, such as "Table 7" or "Section 5.3"."""
        for kind in ("table", "figure", "section"):
            if self.name.startswith(kind):
                return f"{kind.capitalize()} {self.name.removeprefix(kind)}"
        return self.name.capitalize()


@dataclass(frozen=True, eq=False)
class Computation:
    """Computed values of an item: `numbers` for the braces in its words, of which a list of several is for a
    sentence said of each; `entry`, a function of row and column that gives what an entry is compared with; `claims`,
    whether each of its claims holds, or on which share of the draws, or both; whether all of it `agrees`, where
    nothing printed is compared; and `relations` and `drawings` of the `Item`."""

    numbers: Mapping[str, Any] = field(default_factory=dict)
    entry: Callable[[str, str], Computed] | None = None
    claims: Mapping[str, Holds] = field(default_factory=dict)
    agrees: bool = True
    relations: Mapping[str, Sequence[str]] = field(default_factory=dict)
    drawings: Sequence[Drawing] = ()


def item(name: str, paper: Printed, found: Computation, numbers: Mapping[str, Any]) -> Item:
    """Judged item called `name`: entries and claims of the `paper` against what was `found`, in the words of
    words.toml, whose braces are filled with that and with further `numbers`. Raises `KeyError` for an unknown name."""
    said, table = words().items[name], paper.of(name)
    checks = checked(table, found.entry) if table and found.entry else ()
    claims = tuple(_claim(paper, key, found.claims[key], {**numbers, **found.numbers}) for key in said.claims)
    counts = {"all": len(checks), "exact": sum(c.exact for c in checks), "held": _held(claims)}
    filled = {**numbers, **counts, "inside": inside(checks), **found.numbers}
    verdict = judged(checks, claims)
    if said.holds and verdict in (Outturn.GIVEN, said.holds):
        verdict = said.holds if found.agrees else Outturn.NOT_REPRODUCED
    return Item(
        name,
        said.title or (table.title if table else ""),
        verdict,
        said.summary.format(**filled),
        tuple(text.format(**filled) for text in said.chosen),
        checks,
        claims,
        tuple(_evidence(text, one) for key, text in said.evidence.items() for one in _each(key, filled)),
        found.relations,
        tuple(found.drawings),
    )


def checked(table: PrintedTable, entry: Callable[[str, str], Computed]) -> tuple[Check, ...]:
    """Comparisons of all entries of a `table` with what `entry(row, column)` gives; blanks only where crosses stand."""
    marked = any(text == MARK for _, _, text in table.entries())
    entries = (one for one in table.entries() if marked or one[2] != BLANK)
    return tuple(check(table, *one, entry(*one[:2])) for one in entries)


def _claim(paper: Printed, key: str, found: Holds, numbers: Mapping[str, Any]) -> Claim:
    said = words().claims[key]
    saying = paper.claims[said.saying or key]
    holds, share = found if isinstance(found, tuple) else (found, None if isinstance(found, bool) else float(found))
    filled = {**numbers, "numbers": saying.numbers, "share": percent(share or 0.0)}
    verdict = said.holds if holds >= said.at_least else said.fails
    return Claim(saying, said.measured.format(**filled), said.found.format(**filled), verdict, share)


def _each(key: str, numbers: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """The numbers of a sentence: of each of several that it is said of, or the only ones."""
    yield from numbers[key] if isinstance(numbers.get(key), list) else [numbers]


def _evidence(text: str, numbers: Mapping[str, Any]) -> Evidence:
    """A sentence whose braces are numbers, with their count of digits behind a colon, or words."""
    sentence, values, digits = "", [], 3
    for before, name, count, _ in Formatter().parse(text):
        value = numbers[name] if name else ""
        sentence += before + (value if isinstance(value, str) else "{}")
        values += [] if isinstance(value, str) else [float(value)]
        digits = int(count or digits)
    return Evidence(sentence, tuple(values), digits)


def inside(checks: Sequence[Check]) -> int:
    """Count of checks whose printed number lies among the values of the draws."""
    return sum(one.verdict is Outturn.IN_SHAPE for one in checks)


def _held(claims: Sequence[Claim]) -> str:
    count = sum(claim.verdict is not Outturn.NOT_REPRODUCED for claim in claims)
    return f"{count or 'None'} of the text's {len(claims)} claims {'holds' if count == 1 else 'hold'}."


def judged(checks: Sequence[Check], claims: Sequence[Claim] = ()) -> Outturn:
    """Verdict on an item from the `checks` of its entries and its `claims`: NOT_REPRODUCED if a check is, or if there
    are claims and none holds; else ERRATUM if a check or a claim is one; else the most frequent verdict of the checks
    other than GIVEN, and GIVEN if there are none."""
    verdicts = [check.verdict for check in checks if check.verdict is not Outturn.GIVEN]
    if Outturn.NOT_REPRODUCED in verdicts or (claims and all(c.verdict is Outturn.NOT_REPRODUCED for c in claims)):
        return Outturn.NOT_REPRODUCED
    if Outturn.ERRATUM in (*verdicts, *(claim.verdict for claim in claims)):
        return Outturn.ERRATUM
    return max(verdicts, key=verdicts.count) if verdicts else Outturn.GIVEN


def percent(share: float) -> str:
    """Text of a fraction in percent with three significant digits, "0.5 %" for 0.005."""
    return f"{100.0 * share:.3g}\N{NO-BREAK SPACE}%"
