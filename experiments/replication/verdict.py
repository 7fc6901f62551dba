"""Verdicts, as data: on a printed entry, on a saying, on a table or figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.replication.printed import MARK, Number, Saying

if TYPE_CHECKING:
    from adaptctl.dynamics import Mechanism
    from adaptctl.recording.drawing import Drawing


class Outturn(Enum):
    """Enumeration of verdicts on an entry, statement, table or figure of Sheu and Walker (1991): GIVEN, an input used
    as printed; REPRODUCED, computed again; IN_SHAPE, which depends on samples, a motion or an arm that the paper does
    not print, and lies among the values computed for those chosen here; ERRATUM, shown to be wrong; NOT_REPRODUCED,
    outside of all that was computed, and not shown to be wrong. The value is the verdict in words."""

    GIVEN = "given"
    """an input of the paper, used as printed"""
    REPRODUCED = "reproduced"
    """computed again, digits stated"""
    IN_SHAPE = "reproduced in shape"
    """it depends on samples, a motion or an arm that the paper does not print; what was chosen is said"""
    ERRATUM = "erratum"
    """wrong, with a proof by numbers"""
    NOT_REPRODUCED = "not reproduced"
    """outside of everything that was computed, and not shown to be wrong"""


@dataclass(frozen=True)
class Check:
    """Comparison of one entry that Sheu and Walker (1991) print with what is computed: its `row` and `column`, its
    labels in the table; the texts `printed` and `computed`; the `verdict`; `of_digits`, how many digits the printed
    number has, and `digits`, how many of them the computed value agrees with (both None where digits are not counted);
    and `low` and `high`, the least and the greatest computed value over the random draws (None without draws). Nothing
    is checked at construction."""

    row: str
    column: str
    printed: str
    computed: str
    verdict: Outturn
    digits: int | None = None
    """how many of the printed digits are met, where they can be"""
    of_digits: int | None = None
    low: float | None = None
    """the smallest over the seeds, where there are seeds"""
    high: float | None = None

    @property
    def is_mark(self) -> bool:
        """True if the printed entry that is checked is a cross or a blank, as in a table of parameters that are kept,
        and no number."""
        return self.printed in (MARK, "")

    @property
    def reads_alike(self) -> bool:
        """True if this check's computed text equals the printed one, leading plus signs aside, or both are zero, as
        "-0.00" and "0.00" are. Raises `ValueError` where the texts differ, the printed one is neither a cross nor
        blank, and either is no number."""
        texts = (self.computed.lstrip("+"), self.printed.lstrip("+"))
        return texts[0] == texts[1] or (not self.is_mark and {float(text) for text in texts} == {0.0})

    @property
    def exact(self) -> bool:
        """True if the checked entry is reproduced with every printed digit, or is a cross or a blank and reproduced."""
        return self.verdict is Outturn.REPRODUCED and self.digits == self.of_digits


@dataclass(frozen=True)
class Claim:
    """Judged statement of Sheu and Walker (1991): `saying`, its quotation, a `Saying`; `measured`, in words what was
    measured to judge it; `found`, what that gave, as text; `verdict`, an `Outturn`; and `share`, the fraction of the
    random draws on which it holds (0 to 1; None without draws). Nothing is checked at construction."""

    saying: Saying
    measured: str
    found: str
    verdict: Outturn
    share: float | None = None


@dataclass(frozen=True)
class Evidence:
    """Evidence for a verdict on what a paper prints: a `sentence` with {} where its numbers belong, their `values`, and
    the number of significant `digits` with which `str` shows them. Nothing is checked at construction."""

    sentence: str
    values: tuple[float, ...]
    digits: int

    def __str__(self) -> str:
        from adaptctl.recording.wording import number

        return self.sentence.format(*(number(float(value), self.digits) for value in self.values))


def evidence(sentence: str, *values: float, digits: int = 3) -> Evidence:
    """Evidence for a verdict, an `Evidence`, made of a `sentence` with {} where numbers belong, these numbers,
    `values`, and how many significant `digits` of them are shown, 3 by default. Nothing is checked."""
    return Evidence(sentence, tuple(float(value) for value in values), digits)


def percent(share: float) -> str:
    """Fraction `share`, such as 0.005, formatted as text in percent with three significant digits, "0.5 %". Nothing is
    checked."""
    return f"{100.0 * share:.3g}\N{NO-BREAK SPACE}%"


@dataclass(frozen=True)
class Relations:
    """Relations among parameters, written out for the report: a `heading`, and `lines` of text, each an equation or,
    where the relations are a table, a row of it. Nothing is checked at construction."""

    heading: str
    lines: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Scene:
    """Animation for the recording, an arm of r joints moving along a sinusoid at T times: its `label` and `mechanism`;
    `time` (T,), s; positions `p` (T, r), rad; and `torques`, a mapping from labels to torques (T, r), N m, those of all
    parameters first, then those of fewer essential components. Nothing is checked at construction."""

    label: str
    mechanism: Mechanism
    time: Array
    p: Array
    torques: Mapping[str, Array]
    """(T, r) by label, the actual ones first"""


@dataclass(frozen=True, eq=False)
class Item:
    """Table, figure or section of Sheu and Walker (1991) that was computed again, with what came out: `name`, as on the
    command line ("table7"); `title`; `verdict`, an `Outturn`, and `summary`, a text; `chosen`, sentences on what the
    paper leaves open and was chosen here; `checks` of its entries; judged `claims` of its text; `evidence` and
    `relations` among parameters for the report; `drawings`; and `scene`, an animation for the recording (None for
    none). Nothing is checked at construction."""

    name: str
    """as the command line has it: ``table7``"""
    title: str
    verdict: Outturn
    summary: str
    chosen: tuple[str, ...] = ()
    """what the paper leaves open, and what was taken"""
    checks: tuple[Check, ...] = ()
    claims: tuple[Claim, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    relations: tuple[Relations, ...] = ()
    drawings: tuple[Drawing, ...] = ()
    scene: Scene | None = None
    """an arm in motion, for the recording"""

    @property
    def label(self) -> str:
        """Name of the table, figure or section as a sentence has it, such as "Table 7" or "Section 5.3"."""
        for kind in ("table", "figure", "section"):
            if self.name.startswith(kind):
                return f"{kind.capitalize()} {self.name.removeprefix(kind)}"
        return self.name.capitalize()

    def count(self, *verdicts: Outturn) -> int:
        """Number of printed entries of the table, figure or section whose check has one of these `verdicts`. Nothing is
        checked."""
        return sum(check.verdict in verdicts for check in self.checks)


def given(row: str, column: str, text: str, used: float) -> Check:
    """Comparison of a printed input with the value that this package uses, a `Check`: its verdict is GIVEN where the
    value `used` rounds to the printed `text`, else NOT_REPRODUCED. `row` and `column` are the entry's labels in its
    table. Raises `InputError` for a text that is no number."""
    number = Number.of(text)
    same = number.digits_met(used) == number.digits
    return Check(row, column, text, number.styled(used), Outturn.GIVEN if same else Outturn.NOT_REPRODUCED)


def compared(row: str, column: str, text: str, computed: float) -> Check:
    """Comparison of a printed number with the value computed, a `Check`: its verdict is REPRODUCED where the value
    `computed`, in the same unit, agrees with at least its first digit, else NOT_REPRODUCED. `row` and `column` are the
    entry's labels in its table, `text` is as printed. Raises `InputError` for a text that is no number."""
    number = Number.of(text)
    digits = number.digits_met(computed)
    verdict = Outturn.REPRODUCED if digits else Outturn.NOT_REPRODUCED
    return Check(row, column, text, number.styled(computed), verdict, digits, number.digits)


def drawn(row: str, column: str, text: str, computed: Array) -> Check:
    """Comparison of a printed number that depends on a random draw with the values of many draws, a `Check`: its
    verdict is IN_SHAPE where the number lies between the least and the greatest of the values `computed` (seeds,), one
    a draw, in the same unit, each bound moved outwards by half a unit of the last printed digit and included, else
    NOT_REPRODUCED. `row` and `column` are the entry's labels in its table, `text` is as printed. Raises `InputError`
    for a text that is no number, `ValueError` for no values."""
    number, low, high = Number.of(text), float(computed.min()), float(computed.max())
    inside = low - 0.5 * number.unit <= number.value <= high + 0.5 * number.unit
    verdict = Outturn.IN_SHAPE if inside else Outturn.NOT_REPRODUCED
    middle = number.styled(float(np.median(computed)))
    return Check(row, column, text, middle, verdict, low=low, high=high)


def vanishing(row: str, column: str, text: str, computed: float, bound: float) -> Check:
    """Comparison of a printed number with the value computed, a `Check`, where both are zero in exact arithmetic, so
    that only round-off is left. Its verdict is IN_SHAPE where the printed number and the value `computed`, in the same
    unit, are both below `bound` in magnitude, else NOT_REPRODUCED. `row` and `column` are the entry's labels in its
    table, `text` is as printed. Raises `InputError` for a text that is no number."""
    number = Number.of(text)
    verdict = Outturn.IN_SHAPE if max(abs(number.value), abs(computed)) < bound else Outturn.NOT_REPRODUCED
    return Check(row, column, text, f"{computed:.1E}", verdict)


def marked(row: str, column: str, text: str, kept: bool, unlike: Outturn = Outturn.ERRATUM) -> Check:
    """Comparison of a printed cross ("x") or blank, in a table of parameters that are kept, with the set that this
    package keeps, a `Check`: its verdict is REPRODUCED where the entry agrees with `kept`, True if the parameter is in
    that set, else `unlike`, ERRATUM by default. `row` and `column` are the entry's labels in its table, `text` is as
    printed; any text but "x" counts as a blank. Nothing is checked."""
    printed, computed = (MARK if text == MARK else ""), (MARK if kept else "")
    return Check(row, column, printed, computed, Outturn.REPRODUCED if printed == computed else unlike)


def judged(checks: Sequence[Check], claims: Sequence[Claim] = ()) -> Outturn:
    """Verdict, an `Outturn`, on a table, figure or section of Sheu and Walker (1991) from the `checks` of its entries
    and its judged `claims`.

    ERRATUM if a check is one; else NOT_REPRODUCED if a check is, or if there are claims and none of them holds; else
    the most frequent verdict of the checks other than GIVEN (of equally frequent ones the first), and GIVEN if there
    are none.
    """
    verdicts = [check.verdict for check in checks if check.verdict is not Outturn.GIVEN]
    if Outturn.ERRATUM in verdicts:
        return Outturn.ERRATUM
    if Outturn.NOT_REPRODUCED in verdicts or (claims and all(c.verdict is Outturn.NOT_REPRODUCED for c in claims)):
        return Outturn.NOT_REPRODUCED
    return max(verdicts, key=verdicts.count) if verdicts else Outturn.GIVEN


def held(claims: Sequence[Claim]) -> str:
    """Sentence on how many of the `claims` hold, judged claims of Sheu and Walker's (1991) text, such as "2 of the
    text's 3 claims hold.". Nothing is checked."""
    count = sum(claim.verdict is not Outturn.NOT_REPRODUCED for claim in claims)
    return f"{count or 'None'} of the text's {len(claims)} claims {'holds' if count == 1 else 'hold'}."
