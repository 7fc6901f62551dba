"""Choice of a fit's settings inside the training logs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.description.drive import DriveParameter
from adaptctl.errors import AdaptctlError, InputError
from adaptctl.identification.fit import Fit, FitSettings, LogEvidence
from adaptctl.identification.friction_model import ALWAYS, CANDIDATES, FrictionModel
from adaptctl.identification.least_squares import weighted_least_squares
from adaptctl.identification.noise_choice import lasting_times
from adaptctl.identification.one_way import one_way_offsets
from adaptctl.identification.position_noise import clean_cutoffs
from adaptctl.identification.springs import spring_kinds, told_kinds, untold_springs, validate_told
from adaptctl.stages import stage

NUM_FOLDS = 5
NUM_BLOCKS = 20
# Hz: the least cut-off, and that of the rows that predictions are compared on, whatever the motion's band.
MIN_CUTOFF, COMPARISON_CUTOFF, MAX_CUTOFF = 2.0, 25.0, 50.0
# Cut-offs that are tried, over the band of the motion; and shares of its peak speed below which a joint is masked.
CUTOFF_RATIOS, SLOW_CANDIDATES = (1.0, 2.0, 4.0), (0.02, 0.0, 0.05)
WEIGHT_CANDIDATES = (1e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0)
FIRST_WEIGHT = 10.0
# Share by which a richer model must predict better to be taken.
MIN_IMPROVEMENT = 0.01
# Likewise a stronger prior, which makes the estimate less the logs' own, and rows whose noise lasts made white.
MIN_WEIGHT_IMPROVEMENT = 0.003
# Residual of the consistent estimate over that of least squares on the same columns that a prior may cost for a little
# better prediction; what costs more has to be better by MIN_IMPROVEMENT.
MAX_MISFIT_RATIO = 1.03
# Error of links that bodies can be over that of least squares, from which on the log may be another robot's: those of
# its own are up to 1.14 on real logs.
OTHER_ROBOT_RATIO = 1.4

Score = TypeVar("Score", float, Array)


class FrictionTrial(NamedTuple):
    """Trial of one setting: its kind, candidate, relative prediction error, and whether it was chosen."""

    what: str
    candidate: str
    relative_error: float
    taken: bool


@dataclass(frozen=True, eq=False)
class Choice:
    """Chosen settings of a fit, and the trials in their order."""

    settings: FitSettings
    trials: tuple[FrictionTrial, ...]


@stage("cross-validating friction, filter and prior")
def choose(
    evidence: LogEvidence,
    friction: FrictionModel | None = None,
    weight: float | None = None,
    cutoff: float | None = None,
    untold: tuple[str, ...] = (),
) -> Choice:
    """Choice of the settings that are None, one after the other, by cross-validation; some parameters are untold."""
    first = FIRST_WEIGHT if weight is None else positive_number(weight, "prior_weight: expected a positive number")
    if cutoff is not None and cutoff not in evidence.rows:
        raise InputError(f"cutoff: expected one of {', '.join(f'{c:g}' for c in evidence.rows)} Hz, got {cutoff!r}")
    terms = friction or FrictionModel()
    settings = FitSettings(terms, first, cutoff or evidence.band, SLOW_CANDIDATES[0], untold=untold)
    search = _Selection(evidence, [])
    offsets = one_way_offsets(evidence)
    widest = friction or FrictionModel((*ALWAYS, DriveParameter.OFFSET))
    strict = replace(settings, friction=widest, untold=(*untold, *offsets))
    settings = replace(settings, left_out=contradictory(evidence, strict))
    sprung = friction or widest.also(spring_kinds(evidence.mechanism))
    springs = untold_springs(evidence, replace(settings, friction=sprung))  # beside offsets, which they may be
    settings = replace(settings, untold=(*springs, *offsets))
    if friction is None:
        settings = search.best([replace(settings, friction=c) for c in CANDIDATES], "friction", _friction)
        settings = search.best(_sprung(evidence, settings), "springs", _friction)
    else:
        validate_told(friction, evidence.mechanism, settings.untold)
    if cutoff is None:
        tried = clean_cutoffs(evidence.motions, evidence.rows)
        settings = search.best([replace(settings, cutoff=c) for c in tried], "cut-off, Hz", _cutoff)
    settings = search.best([replace(settings, slow=s) for s in SLOW_CANDIDATES], "slow joints masked below", _slow)
    settings = search.best(_lasting(evidence, settings), "noise that lasts", _noise, MIN_WEIGHT_IMPROVEMENT, 0.0)
    if weight is None:
        settings = search.weighted([replace(settings, weight=w) for w in WEIGHT_CANDIDATES])
    return Choice(settings, tuple(search.trials))


def _sprung(evidence: LogEvidence, settings: FitSettings) -> list[FitSettings]:
    """Settings as they are, and with the springs that the log tells, if any."""
    springs = told_kinds(evidence.mechanism, settings.untold)
    more = settings.friction.also((DriveParameter.OFFSET, *springs))
    return [settings, replace(settings, friction=more)] if springs else [settings]


def _lasting(evidence: LogEvidence, settings: FitSettings) -> list[FitSettings]:
    """Settings as they are, and with noise that lasts, if any joint's does."""
    times = lasting_times(evidence, replace(settings, cutoff=evidence.band))
    return [settings, replace(settings, lasting=times)] if times else [settings]


def judged_at(evidence: LogEvidence) -> float:
    """Cut-off (Hz) at which predictions are compared: the highest up to 25 Hz, else the lowest."""
    return max((c for c in evidence.rows if c <= COMPARISON_CUTOFF), default=min(evidence.rows))


def cutoffs_for(rate: float, band: float) -> tuple[float, ...]:
    """Cut-offs (Hz) for a sampling rate and a motion's band: at most a tenth of the rate, and 50 Hz."""
    most = min(MAX_CUTOFF, 0.1 * rate)
    tried = [*(band * ratio for ratio in CUTOFF_RATIOS), COMPARISON_CUTOFF, MAX_CUTOFF if band > 10.0 else band]
    return tuple(sorted({min(cutoff, most) for cutoff in tried}))


def contradictory(evidence: LogEvidence, settings: FitSettings) -> tuple[int, ...]:
    """Joints that are left out, since no links that bodies can be take their torques and the other joints' too."""
    left: tuple[int, ...] = ()
    light = replace(settings, weight=WEIGHT_CANDIDATES[0])
    while len(left) < evidence.mechanism.dof - 1:
        now = replace(light, left_out=left)
        worst = _worst(evidence, now)
        if worst is None:
            break
        left = (*left, worst)
    return left


def _worst(evidence: LogEvidence, settings: FitSettings) -> int | None:
    """Joint that weighs otherwise than in the file, without which consistent links fit the rest far better."""
    every, left = range(evidence.blocks), settings.left_out

    def excess(tried: FitSettings) -> float:
        return misfit_ratio(evidence, evidence.fit(tried, every)) - 1.0

    suspects = [j for j in evidence.weighing_otherwise(settings.cutoff) if j not in left]
    if not suspects or (now := _tried(excess, settings)) <= MAX_MISFIT_RATIO - 1.0:
        return None
    rests = [_tried(excess, replace(settings, left_out=(*left, j))) for j in suspects]
    return suspects[int(np.argmin(rests))] if min(rests) < 0.5 * now else None


def predicted_squares(evidence: LogEvidence, settings: FitSettings) -> Array:
    """Squared relative error of torques predicted on blocks left out, by five groups of them; N and N m apart."""
    judged = settings.judging(evidence.band)
    squares, sizes = np.zeros((2, NUM_FOLDS, evidence.mechanism.dof))
    folds = _folds(evidence)
    for i, fit in enumerate(evidence.fits(settings, _rests(folds))):
        held_out = evidence.equations(judged, folds[i])
        squares[i] = held_out.misfit(fit.x)
        sizes[i] = held_out.square.sum(axis=0)
    revolute = np.array([joint.kind.is_revolute for joint in evidence.mechanism.primary_joints])
    kinds = [kind for kind in (revolute, ~revolute) if sizes[:, kind].sum() > 0.0]
    return np.asarray(np.mean([squares[:, kind].sum(axis=1) / sizes[:, kind].sum() for kind in kinds], axis=0))


def _folds(evidence: LogEvidence) -> list[list[int]]:
    return [fold.tolist() for fold in np.array_split(np.arange(evidence.blocks), NUM_FOLDS)]


def _rests(folds: Sequence[Sequence[int]]) -> list[list[int]]:
    """Blocks that each fold leaves to the others."""
    return [[b for other in folds if other is not fold for b in other] for fold in folds]


def _near(tried: Sequence[FitSettings], ratios: Sequence[float]) -> list[FitSettings]:
    """Settings whose fit has at most 3 % more misfit than least squares, or than the lightest prior."""
    most = MAX_MISFIT_RATIO * max(1.0, min(ratios) if min(ratios) > MAX_MISFIT_RATIO else 1.0)
    return [s for s, ratio in zip(tried, ratios, strict=True) if ratio <= most] or [tried[0]]


def misfit_ratio(evidence: LogEvidence, fit: Fit) -> float:
    """Ratio of a fit's weighted residual to that of least squares on the same equations."""
    settings, every = fit.settings, range(evidence.blocks)
    equations = evidence.equations(settings, every)
    least, _ = weighted_least_squares(equations, evidence.independent(settings))
    weight = 1.0 / fit.deviations**2
    return float(np.sqrt((equations.misfit(fit.x) @ weight) / (equations.misfit(least) @ weight)))


def _each(score: Callable[[FitSettings], Score], tried: Sequence[FitSettings]) -> list[Score | float]:
    """Scores of candidates, the last first: fits with light priors begin where those with heavier ones ended."""
    return [_tried(score, s) for s in reversed(tried)][::-1]


def _tried(score: Callable[[FitSettings], Score], settings: FitSettings) -> Score | float:
    """Score of a candidate, infinite if it fails: others may do."""
    with suppress(AdaptctlError, np.linalg.LinAlgError, FloatingPointError):
        found = score(settings)
        return found if np.all(np.isfinite(found)) else np.inf
    return np.inf


@dataclass(frozen=True, eq=False)
class _Selection:
    """Search for settings by cross-validation, with its trials."""

    evidence: LogEvidence
    trials: list[FrictionTrial]

    def best(
        self,
        tried: Sequence[FitSettings],
        what: str,
        word: Callable[[FitSettings], str],
        better: float = MIN_IMPROVEMENT,
        clear: float = 1.0,
    ) -> FitSettings:
        """Settings that predict best, an earlier one unless a later one is better by a share and standard errors."""
        squares = self._squares(tried)
        best = 0
        for i, own in enumerate(squares):
            less = own.sum() < (1.0 - better) ** 2 * squares[best].sum()
            if less and not _worse_by(squares[best], own) <= clear:
                best = i
        return self._told(tried, best, what, word, squares)

    def weighted(self, tried: Sequence[FitSettings]) -> FitSettings:
        """Settings by whose weight of the prior blocks left out are predicted best, by rising weights."""
        evidence, what = self.evidence, "weight of the prior"
        parts = [list(range(evidence.blocks)), *_rests(_folds(evidence))]  # at once with those that are asked for next
        ratios = _each(lambda s: misfit_ratio(evidence, evidence.fits(s, parts)[0]), tried)
        if MAX_MISFIT_RATIO < min(ratios) <= OTHER_ROBOT_RATIO:  # no body can be what this robot's log asks for
            return self.last(tried, what, _weight)
        near = _near(tried, ratios)
        found = self.best(near, what, _weight, MIN_WEIGHT_IMPROVEMENT, 0.0)
        heavier = [s for s in tried if s.weight > near[-1].weight]
        return self.best([found, *heavier], f"{what}, any misfit", _weight)

    def last(self, tried: Sequence[FitSettings], what: str, word: Callable[[FitSettings], str]) -> FitSettings:
        """Last settings that predict as well as the best ones but for a standard error (Breiman et al. 1984)."""
        squares = self._squares(tried)
        least = min(squares, key=np.sum)
        last = max((i for i, own in enumerate(squares) if _worse_by(own, least) <= 1.0), default=0)
        return self._told(tried, last, what, word, squares)

    def _squares(self, tried: Sequence[FitSettings]) -> list[Array]:
        each = _each(partial(predicted_squares, self.evidence), tried)
        return [np.broadcast_to(squares, NUM_FOLDS) for squares in each]

    def _told(
        self,
        tried: Sequence[FitSettings],
        taken: int,
        what: str,
        word: Callable[[FitSettings], str],
        squares: Sequence[Array],
    ) -> FitSettings:
        errors = enumerate(np.sqrt(np.sum(squares, axis=1)).tolist())
        self.trials.extend(FrictionTrial(what, word(tried[i]), error, i == taken) for i, error in errors)
        return tried[taken]


def _worse_by(squares: Array, others: Array) -> float:
    """Standard errors, over groups of blocks, by which some squared errors are above others; infinite if these fail."""
    if np.isinf(squares).any():
        return np.inf
    more = squares - others
    error = np.sqrt(len(more) * np.var(more, ddof=1))
    return float(more.sum() / max(error, np.finfo(float).tiny))


def _friction(settings: FitSettings) -> str:
    return settings.friction.words


def _cutoff(settings: FitSettings) -> str:
    return f"{settings.cutoff:.3g}"


def _slow(settings: FitSettings) -> str:
    return f"{settings.slow:.0%} of the peak speed" if settings.slow else "none"


def _noise(settings: FitSettings) -> str:
    return f"{', '.join(f'{time:g}' for time in settings.lasting)} s" if settings.lasting else "none"


def _weight(settings: FitSettings) -> str:
    return f"{settings.weight:g}"
