"""Choice of a fit's settings inside the training logs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import positive_number
from adaptctl.errors import InputError
from adaptctl.identification.fit import Fit, FitSettings, LogEvidence
from adaptctl.identification.friction_model import CANDIDATES, FrictionModel
from adaptctl.identification.least_squares import weighted_least_squares

NUM_FOLDS = 5
NUM_BLOCKS = 20
# Hz
CUTOFF_CANDIDATES = (12.5, 25.0, 50.0)
# Hz, the cut-off of the rows that predictions are compared on, whatever the fit's own.
COMPARISON_CUTOFF = 25.0
WEIGHT_CANDIDATES = (0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0)
FIRST_WEIGHT = 10.0
# Share by which a richer model must predict better to be taken.
MIN_IMPROVEMENT = 0.01
# Likewise a stronger prior, which makes the estimate less the logs' own.
MIN_WEIGHT_IMPROVEMENT = 0.003
# Largest residual of the consistent estimate over that of least squares on the same columns.
MAX_MISFIT_RATIO = 1.03


class FrictionTrial(NamedTuple):
    """Trial of one setting: its kind, candidate, prediction error `rms` in N m (N), and whether it was chosen."""

    what: str
    candidate: str
    rms: float
    taken: bool


@dataclass(frozen=True, eq=False)
class Choice:
    """Chosen settings of a fit, and the trials in their order."""

    settings: FitSettings
    trials: tuple[FrictionTrial, ...]


def choose(
    evidence: LogEvidence,
    friction: FrictionModel | None = None,
    weight: float | None = None,
    cutoff: float | None = None,
) -> Choice:
    """Choice of the settings that are None, one after the other, by cross-validation on blocks of time."""
    judged = judged_at(evidence)
    first = FIRST_WEIGHT if weight is None else positive_number(weight, "prior_weight: expected a positive number")
    if cutoff is not None and cutoff not in evidence.rows:
        raise InputError(f"cutoff: expected one of {', '.join(f'{c:g}' for c in evidence.rows)} Hz, got {cutoff!r}")
    settings = FitSettings(friction or FrictionModel(), first, judged if cutoff is None else cutoff)
    trials: list[FrictionTrial] = []
    if friction is None:
        settings = _best(evidence, [replace(settings, friction=c) for c in CANDIDATES], "friction", _friction, trials)
        if evidence.mechanism.description.loops is None:
            loaded = replace(settings, friction=replace(settings.friction, load=True))
            settings = _best(evidence, [settings, loaded], "load-dependent friction", _friction, trials)
    if cutoff is None:
        tried = sorted(evidence.rows, key=lambda c: c != judged)
        settings = _best(evidence, [replace(settings, cutoff=c) for c in tried], "cut-off, Hz", _cutoff, trials)
    if weight is None:
        allowed = [s for s in (replace(settings, weight=w) for w in WEIGHT_CANDIDATES) if is_allowed(evidence, s)]
        tried_weights = allowed or [replace(settings, weight=WEIGHT_CANDIDATES[0])]
        settings = _best(evidence, tried_weights, "weight of the prior", _weight, trials, MIN_WEIGHT_IMPROVEMENT)
    return Choice(settings, tuple(trials))


def judged_at(evidence: LogEvidence) -> float:
    """Cut-off (Hz) at which predictions are compared: the highest up to 25 Hz, else the lowest."""
    return max((c for c in evidence.rows if c <= COMPARISON_CUTOFF), default=min(evidence.rows))


def cutoffs_for(rate: float) -> tuple[float, ...]:
    """Candidate cut-offs (Hz) for a sampling rate: at most a tenth of it."""
    return tuple(c for c in CUTOFF_CANDIDATES if c <= 0.1 * rate) or (0.1 * rate,)


def predicted_rms(evidence: LogEvidence, settings: FitSettings) -> float:
    """Root mean square error in N m (N) of torques predicted on blocks left out, in five groups of neighbors."""
    squares = rows = 0.0
    for fold in np.array_split(np.arange(evidence.blocks), NUM_FOLDS):
        rest = [b for b in range(evidence.blocks) if b not in fold]
        fit = evidence.fit(settings, rest)
        judged = judged_at(evidence)
        held_out = evidence.equations(judged, fold.tolist(), evidence.load_from(settings, rest, judged))
        squares += float(held_out.misfit(fit.x).sum())
        rows += float(held_out.count.sum())
    return float(np.sqrt(squares / (rows * evidence.mechanism.dof)))


def is_allowed(evidence: LogEvidence, settings: FitSettings) -> bool:
    """True if the consistent fit's residual is at most 1.03 times that of weighted least squares."""
    return misfit_ratio(evidence, evidence.fit(settings, range(evidence.blocks))) <= MAX_MISFIT_RATIO


def misfit_ratio(evidence: LogEvidence, fit: Fit) -> float:
    """Ratio of a fit's weighted residual to that of least squares on the same equations."""
    settings, every = fit.settings, range(evidence.blocks)
    equations = evidence.equations(settings.cutoff, every, evidence.load_from(settings, every))
    least, _ = weighted_least_squares(equations, evidence.independent(settings.friction))
    weight = 1.0 / fit.deviations**2
    return float(np.sqrt((equations.misfit(fit.x) @ weight) / (equations.misfit(least) @ weight)))


def _best(
    evidence: LogEvidence,
    tried: Sequence[FitSettings],
    what: str,
    word: Callable[[FitSettings], str],
    trials: list[FrictionTrial],
    better: float = MIN_IMPROVEMENT,
) -> FitSettings:
    scores = [predicted_rms(evidence, settings) for settings in tried]
    best = 0
    for i, score in enumerate(scores):
        if score < (1.0 - better) * scores[best]:
            best = i
    trials += [
        FrictionTrial(what, word(s), rms, i == best) for i, (s, rms) in enumerate(zip(tried, scores, strict=True))
    ]
    return tried[best]


def _friction(settings: FitSettings) -> str:
    return settings.friction.words


def _cutoff(settings: FitSettings) -> str:
    return f"{settings.cutoff:g}"


def _weight(settings: FitSettings) -> str:
    return f"{settings.weight:g}"
