"""Hypotheses about what a log's columns mean, compared by the error of the consistent estimate."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.drive import DriveParameter
from adaptctl.errors import AdaptctlError, InputError
from adaptctl.identifiability.factorisation import one_thread
from adaptctl.identification.delay import Delay
from adaptctl.identification.filtered_dynamics import SmoothMotion
from adaptctl.identification.fit import LogEvidence
from adaptctl.identification.hypothesis_rows import HypothesisRows, relative_error
from adaptctl.identification.listed_hypotheses import Hypothesis, listed_hypotheses, of_one
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.preparation import PreparationStep
from adaptctl.stages import stage

# Error of another meaning over that of the log as it is, up to which the log does not tell the two apart.
ALIKE = 1.05
# Hypotheses, the best by least squares, of which the consistent estimate is made.
MAX_CONTENDERS = 20
FLAG = "--trust-log"


class TriedHypothesis(NamedTuple):
    """
    Hypothesis about a log, and the error of the consistent estimate if it holds.

    Parameters
    ----------
    kind : str
        Kind, such as "sign of a torque"; "as is" for the log as it is.
    words : str
        What would be so, in words.
    error : float
        Geometric mean over the joints of errors relative to the torques.
    is_bound : bool
        True if the error is that of least squares, below which the consistent estimate's cannot be.
    named : bool
        True if this is the best of all, and the error of the log as it is exceeds this one's by half or more; for the
        scale of the times, which has a deviation of its own, by a tenth.
    """

    kind: str
    words: str
    error: float
    is_bound: bool = False
    named: bool = False


class LogMeaning(NamedTuple):
    """Meaning of a log's columns, as far as the log tells it."""

    tried: tuple[TriedHypothesis, ...]
    """Hypotheses, that of the log as it is first."""
    sentence: str | None
    """On the hypothesis that fits far better, if one does."""
    refuses: bool
    """True if the log is refused for it."""
    slopes: PreparationStep
    """Slopes of measured torques over those of the file's links."""
    other_side: bool
    """True if the slopes suggest torques of the other side of gears."""
    alike: PreparationStep
    """Hypotheses that fit as well as the log as it is."""


AS_IS = "as is"


@one_thread()
@stage("comparing hypotheses about the columns")
def compared_hypotheses(
    evidence: LogEvidence,
    delay: Delay,
    others: Sequence[SmoothMotion] = (),
    springs: tuple[DriveParameter, ...] = (),
) -> LogMeaning:
    """Hypotheses about the logs of evidence, and of other motions of the same robot, with kinds of springs."""
    rows = HypothesisRows.of(evidence, others, springs)
    as_is = rows.mixed(np.eye(evidence.mechanism.dof))
    deviations = rows.least(as_is)[1]
    (x,) = rows.consistent([(as_is, deviations)])
    error = relative_error(as_is, x)
    found, best = _tried(rows, delay, error, x)
    tried = [TriedHypothesis(AS_IS, "the log is as its columns, units and the robot file say", error)]
    tried.extend(own.trial._replace(named=i == best) for i, own in enumerate(found))
    alike = _alike([own for own in found if own.hypothesis.refuses], error)
    if best is None:
        unit = rows.other_unit()
        return LogMeaning(tuple(tried), unit, unit is not None, *rows.file_slopes(), alike)
    hypothesis, trial, names = found[best].hypothesis, found[best].trial, ", ".join(rows.sources)
    sentence = (
        f"{names}: {trial.words}: if so, the error of the consistent estimate falls from {error:.2%} to "
        f"{trial.error:.2%} of the torques; {hypothesis.remedy}{_or_else(found, found[best])}"
    )
    refuses = hypothesis.refuses and hypothesis.refusal * trial.error <= error
    return LogMeaning(tuple(tried), sentence, refuses, *rows.file_slopes(), alike)


def validate_meaning(verdict: LogMeaning, trusted: bool, first: Sequence[str] = ()) -> tuple[str, ...]:
    """
    Raise `InputError` for a log whose columns mean something else, unless it is trusted; else a warning, if any.

    No meaning explains what was not measured, for which something has to be done first.
    """
    if verdict.sentence is None or (first and trusted):
        return ()
    if first and verdict.refuses:
        raise InputError(f"{', and '.join(first)}, or take the log as it is by {FLAG}")
    if verdict.refuses and not trusted:
        raise InputError(f"{verdict.sentence}, or take the log as it is by {FLAG}")
    return (verdict.sentence,)


@dataclass(frozen=True, eq=False)
class _Trial:
    """Hypothesis with its outcome, its equations, and the parameters (P,) and deviations (r,) of its fit."""

    hypothesis: Hypothesis
    trial: TriedHypothesis
    equations: NormalEquations
    x: Array
    deviations: Array

    def fits(self, most: float) -> bool:
        """True if the consistent estimate has at most an error, and is what the hypothesis says."""
        return not self.trial.is_bound and self.trial.error <= most and self.hypothesis.holds(self.x)

    def consistent(self, x: Array) -> _Trial:
        """Trial by the consistent estimate."""
        error, words = relative_error(self.equations, x), self.trial.words + self.hypothesis.told(x)
        return replace(self, x=x, trial=TriedHypothesis(self.trial.kind, words, error))


def _alike(others: Sequence[_Trial], error: float) -> PreparationStep:
    """Line on meanings whose consistent estimates are as good as that of the log as it is."""
    fits = [own.trial for own in others if not own.trial.is_bound and own.trial.error <= ALIKE * error]
    kinds: dict[str, list[str]] = {}
    for trial in sorted(fits, key=lambda trial: trial.error):
        kinds.setdefault(trial.kind, []).append(trial.words)
    each = [f"{own[0]}{f' ({len(own) - 1} more of its kind)' if own[1:] else ''}" for own in kinds.values()]
    return PreparationStep("fits as well as the log as it is", "; ".join(each) or "nothing")


def _or_else(found: Sequence[_Trial], best: _Trial) -> str:
    """Words on the best hypothesis of each other kind that the log does not tell from the best of all."""
    kinds = {best.trial.kind: ""}
    for own in sorted(found, key=lambda own: own.trial.error):
        if own.fits(ALIKE * best.trial.error):
            words = f"; or, as the log tells as well, {own.trial.words}: {own.hypothesis.remedy}"
            kinds.setdefault(own.trial.kind, words)
    return "".join(kinds.values())


def _tried(rows: HypothesisRows, delay: Delay, error: float, x_as_is: Array) -> tuple[list[_Trial], int | None]:
    """Hypotheses as tried, and the index of the best one that takes a third of the error off."""
    found, most = [], error
    for own in listed_hypotheses(rows, delay):
        with suppress(AdaptctlError, np.linalg.LinAlgError):
            equations = own.equations()
            x, deviations = rows.least(equations)
            trial = TriedHypothesis(own.kind, own.words, relative_error(equations, x), True)
            found.append(_Trial(own, trial, equations, x, deviations))
    best = None
    alike = np.round(20.0 * np.log([one.trial.error for one in found]))  # where least squares tells none, as listed
    order = np.argsort(alike, kind="stable")[:MAX_CONTENDERS].tolist()
    contenders = list(takewhile(lambda i: found[i].trial.error <= ALIKE * error, order))
    fits = [(found[i].equations, found[i].deviations) for i in contenders]
    for i, x in zip(contenders, rows.consistent(fits, x_as_is) if fits else [], strict=True):
        if found[i].trial.error > ALIKE * most:
            break
        found[i] = found[i].consistent(x)
        if found[i].fits(min(most, error / _margin(found[i].hypothesis, rows.evidence.mechanism.dof))):
            best, most = i, found[i].trial.error
    return found, best


def _margin(hypothesis: Hypothesis, dof: int) -> float:
    """Error as the log is over that of a hypothesis from which on this is named."""
    return hypothesis.margin if hypothesis.refuses else of_one(hypothesis.margin, dof)
