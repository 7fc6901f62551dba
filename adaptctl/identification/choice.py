"""Choice of a fit's settings inside the training logs: by predicting blocks of time left out."""

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

FOLDS = 5
BLOCKS = 20
CUTOFFS = (12.5, 25.0, 50.0)
"""Hz"""
JUDGED_AT = 25.0
"""Hz, the cut-off of the rows that predictions are compared on, whatever the fit's own."""
WEIGHTS = (0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0)
FIRST_WEIGHT = 10.0
BETTER = 0.01
"""By what share the richer model must predict better to be taken."""
STRONGER = 0.003
"""Likewise a stronger prior, which makes the estimate less the logs' own."""
ALLOWED_MISFIT = 1.03
"""Of the consistent estimate's whitened root mean square over that of least squares on the same columns."""


class FrictionTrial(NamedTuple):
    """Trial of one setting of a fit: `what` names the kind of setting ("friction", "load-dependent friction", "cut-off,
    Hz" or "weight of the prior") and `candidate` the value tried, both as text.

    `rms` is the root mean square error (N m, or N for prismatic joints), over all joints and instants, of the joint
    torques that fits with it predict on blocks of time left out of them, and `taken` is true for the candidate chosen
    of its kind. Made by `choose`; nothing is checked at construction.
    """

    what: str
    candidate: str
    rms: float
    taken: bool


@dataclass(frozen=True, eq=False)
class Choice:
    """Choice of a fit's settings. `settings` are the `FitSettings` that were chosen: friction model, weight, against
    the logs, of the prior, which is a first guess of the links, and cut-off of the low-pass filter in Hz. `trials` has
    one `FrictionTrial` for each candidate in the order of trying; it is empty where all settings were given. Made by
    `choose`; nothing is checked at construction."""

    settings: FitSettings
    trials: tuple[FrictionTrial, ...]


def choose(
    evidence: LogEvidence,
    friction: FrictionModel | None = None,
    weight: float | None = None,
    cutoff: float | None = None,
) -> Choice:
    """The choice, a `Choice`, of a fit's settings by how well fits predict the joint torques of blocks of time left out
    of them. Chosen one after the other are the friction model, its load dependence, the cut-off of the low-pass filter,
    and the weight of the prior.

    `evidence` holds the filtered equations of motion of the logs, in blocks of time. Arguments that are given are not
    chosen: `friction`, a `FrictionModel`; `weight` (unitless), that of the prior (a first guess of the links) against
    the logs; `cutoff` (Hz), one of those that the evidence has. Where they are None, the candidates are: viscous and
    Coulomb friction with or without a square root or Stribeck term and an offset, and, unless loops are closed, with or
    without load-dependent friction, which grows with the joint's torque; the evidence's cut-offs, first the highest up
    to 25 Hz, at which all predictions are compared; weights from 0.5 to 100 whose fit has a root mean square residual
    of at most 1.03 times that of least squares (`misfit_ratio`), or 0.5 if there are none. A candidate replaces the
    best one before it only if its error is more than 1 % smaller (0.3 % for weights). Raises `InputError` for a weight
    that is not positive and finite and a cut-off that the evidence does not have, `AdaptctlError` where a fit is not
    found.
    """
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
        allowed = [s for s in (replace(settings, weight=w) for w in WEIGHTS) if is_allowed(evidence, s)]
        tried_weights = allowed or [replace(settings, weight=WEIGHTS[0])]
        settings = _best(evidence, tried_weights, "weight of the prior", _weight, trials, STRONGER)
    return Choice(settings, tuple(trials))


def judged_at(evidence: LogEvidence) -> float:
    """The cut-off (Hz) of the low-pass filter at which predictions of joint torques are compared: of the cut-offs that
    the `evidence` (low-pass filtered equations of motion along logs) has, the highest up to 25 Hz, or the lowest where
    all are higher. Raises `ValueError` for evidence without cut-offs."""
    return max((c for c in evidence.rows if c <= JUDGED_AT), default=min(evidence.rows))


def cutoffs_for(rate: float) -> tuple[float, ...]:
    """Candidate cut-offs (Hz) of a low-pass filter for logs at a sampling `rate` (Hz): those of 12.5, 25 and 50 Hz that
    are at most a tenth of the rate, or a tenth of it where none is. The rate is not checked."""
    return tuple(c for c in CUTOFFS if c <= 0.1 * rate) or (0.1 * rate,)


def predicted_rms(evidence: LogEvidence, settings: FitSettings) -> float:
    """Root mean square error (N m, or N for prismatic joints), over all joints and instants, of the torques that fits
    with some `settings` predict on blocks of time left out of them. The blocks of the `evidence` (low-pass filtered
    equations of motion along logs) are left out in five groups of neighbours, one at a time. All settings are compared
    at one cut-off: the evidence's highest up to 25 Hz, or its lowest where all are higher. Raises `KeyError` for
    settings with a cut-off that the evidence does not have, `AdaptctlError` where a fit is not found."""
    squares = rows = 0.0
    for fold in np.array_split(np.arange(evidence.blocks), FOLDS):
        rest = [b for b in range(evidence.blocks) if b not in fold]
        fit = evidence.fit(settings, rest)
        judged = judged_at(evidence)
        held_out = evidence.equations(judged, fold.tolist(), evidence.load_from(settings, rest, judged))
        squares += float(held_out.misfit(fit.x).sum())
        rows += float(held_out.count.sum())
    return float(np.sqrt(squares / (rows * evidence.mechanism.dof)))


def is_allowed(evidence: LogEvidence, settings: FitSettings) -> bool:
    """True if the physically consistent fit with some `settings` to all of the `evidence` (low-pass filtered equations
    of motion along logs) has a root mean square residual of at most 1.03 times that of weighted least squares on the
    same equations and parameters. Each joint's residual is divided by its standard deviation in the fit. Raises
    `KeyError` for settings with a cut-off that the evidence does not have, `AdaptctlError` where the fit is not
    found."""
    return misfit_ratio(evidence, evidence.fit(settings, range(evidence.blocks))) <= ALLOWED_MISFIT


def misfit_ratio(evidence: LogEvidence, fit: Fit) -> float:
    """Ratio, without a unit, of the root mean square torque residual of a fit to that of weighted least squares on the
    same equations and parameters, over all blocks of time of the evidence (low-pass filtered equations of motion along
    logs). Each joint's residual is divided by its standard deviation in the fit. Raises `KeyError` for a fit at a
    cut-off that the evidence does not have."""
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
    better: float = BETTER,
) -> FitSettings:
    """The first of the tried that none of the later ones beats by the share asked for."""
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
