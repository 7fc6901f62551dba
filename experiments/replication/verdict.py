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
    """Verdicts on something printed."""

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
    """A check of one printed entry against the computed one."""

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
        """True for a cross or a blank of a table of crosses."""
        return self.printed in (MARK, "")

    @property
    def reads_alike(self) -> bool:
        """True if it reads as printed, but for the sign of a plus or a zero."""
        texts = (self.computed.lstrip("+"), self.printed.lstrip("+"))
        return texts[0] == texts[1] or (not self.is_mark and {float(text) for text in texts} == {0.0})

    @property
    def exact(self) -> bool:
        """True if every printed digit is met."""
        return self.verdict is Outturn.REPRODUCED and self.digits == self.of_digits


@dataclass(frozen=True)
class Claim:
    """A claim: a saying of the text, what was measured to judge it, what came out, and the share of seeds on which it
    holds."""

    saying: Saying
    measured: str
    found: str
    verdict: Outturn
    share: float | None = None


@dataclass(frozen=True)
class Evidence:
    """Evidence for a verdict: numbers, and the sentence they stand in, with {} in their places."""

    sentence: str
    values: tuple[float, ...]
    digits: int

    def __str__(self) -> str:
        from adaptctl.recording.wording import number

        return self.sentence.format(*(number(float(value), self.digits) for value in self.values))


def evidence(sentence: str, *values: float, digits: int = 3) -> Evidence:
    """The evidence of a sentence and its numbers."""
    return Evidence(sentence, tuple(float(value) for value in values), digits)


def percent(share: float) -> str:
    """Text of a share in percent: ``0.5 %``."""
    return f"{100.0 * share:.3g}\N{NO-BREAK SPACE}%"


@dataclass(frozen=True)
class Relations:
    """Relations: equations written out, under a heading."""

    heading: str
    lines: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene for the recording: an arm along the stated sinusoid, and torques of all its joints under several sets of
    parameters."""

    label: str
    mechanism: Mechanism
    time: Array
    p: Array
    torques: Mapping[str, Array]
    """(T, r) by label, the actual ones first"""


@dataclass(frozen=True, eq=False)
class Item:
    """An item of the paper, a table, figure or passage, with its checks, claims and evidence."""

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
        """Name as the text has it: ``Table 7``."""
        for kind in ("table", "figure", "section"):
            if self.name.startswith(kind):
                return f"{kind.capitalize()} {self.name.removeprefix(kind)}"
        return self.name.capitalize()

    def count(self, *verdicts: Outturn) -> int:
        """Number of printed entries that have one of these verdicts."""
        return sum(check.verdict in verdicts for check in self.checks)


def given(row: str, column: str, text: str, used: float) -> Check:
    """Check of an input: used to the printed digit, or else not reproduced."""
    number = Number.of(text)
    same = number.digits_met(used) == number.digits
    return Check(row, column, text, number.styled(used), Outturn.GIVEN if same else Outturn.NOT_REPRODUCED)


def compared(row: str, column: str, text: str, computed: float) -> Check:
    """Check of a number that can be computed as it stands: reproduced when at least its first digit is met."""
    number = Number.of(text)
    digits = number.digits_met(computed)
    verdict = Outturn.REPRODUCED if digits else Outturn.NOT_REPRODUCED
    return Check(row, column, text, number.styled(computed), verdict, digits, number.digits)


def drawn(row: str, column: str, text: str, computed: Array) -> Check:
    """Check of a number that depends on a random draw (seeds,): in shape when it lies among the seeds' values."""
    number, low, high = Number.of(text), float(computed.min()), float(computed.max())
    inside = low - 0.5 * number.unit <= number.value <= high + 0.5 * number.unit
    verdict = Outturn.IN_SHAPE if inside else Outturn.NOT_REPRODUCED
    middle = number.styled(float(np.median(computed)))
    return Check(row, column, text, middle, verdict, low=low, high=high)


def vanishing(row: str, column: str, text: str, computed: float, bound: float) -> Check:
    """Check of a number that is zero but for round-off: in shape when both are below a bound."""
    number = Number.of(text)
    verdict = Outturn.IN_SHAPE if max(abs(number.value), abs(computed)) < bound else Outturn.NOT_REPRODUCED
    return Check(row, column, text, f"{computed:.1E}", verdict)


def marked(row: str, column: str, text: str, kept: bool, unlike: Outturn = Outturn.ERRATUM) -> Check:
    """Check of a cross or a blank of a table of crosses."""
    printed, computed = (MARK if text == MARK else ""), (MARK if kept else "")
    return Check(row, column, printed, computed, Outturn.REPRODUCED if printed == computed else unlike)


def judged(checks: Sequence[Check], claims: Sequence[Claim] = ()) -> Outturn:
    """The verdict on several checks and on what the text says of them.

    An erratum if one is; not reproduced where one entry is not, or nothing that is said holds; else the most frequent
    of the checks that are no inputs.
    """
    verdicts = [check.verdict for check in checks if check.verdict is not Outturn.GIVEN]
    if Outturn.ERRATUM in verdicts:
        return Outturn.ERRATUM
    if Outturn.NOT_REPRODUCED in verdicts or (claims and all(c.verdict is Outturn.NOT_REPRODUCED for c in claims)):
        return Outturn.NOT_REPRODUCED
    return max(verdicts, key=verdicts.count) if verdicts else Outturn.GIVEN


def held(claims: Sequence[Claim]) -> str:
    """Sentence on how many claims of the text hold."""
    count = sum(claim.verdict is not Outturn.NOT_REPRODUCED for claim in claims)
    return f"{count or 'None'} of the text's {len(claims)} claims {'holds' if count == 1 else 'hold'}."
