"""Uncertainty of the estimates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, positive_per_joint
from adaptctl.control.adaptation import PriorRanges
from adaptctl.control.excitation.deviations import least_squares_deviations
from adaptctl.control.excitation.excitation_trajectory import INDEPENDENT_ROW_RATE, Motion
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import EssentialSpace, ReducedModel, States, essential_space, reduce
from adaptctl.identification.fit import Fit, LogEvidence
from adaptctl.identification.robot_motion import RobotMotion
from adaptctl.identification.student import student_quantile

INTERVAL = 1.96
"""deviations of half an interval of 95 %"""

# Share of the squared deviations by the prior from which on it decides, and deviations that rows without a prior leave,
# over those with it, up to which it does not; the share of a scaled normal matrix that all directions have, so that
# none is certain that rows do not tell; and squares of deviations over a column's own from where on rows tell nothing.
MAX_PRIOR_SHARE, NEARLY_TOLD, LEAST_TOLD, UNTOLD = 0.5, 3.0, 1e-10, 1e8


class Student(NamedTuple):
    """Student's distribution of a mean over some blocks."""

    blocks: int

    @property
    def quantile_ratio(self) -> float:
        """Ratio of its 97.5 % quantile to that of the normal distribution."""
        return student_quantile(0.975, self.blocks - 1) / NormalDist().inv_cdf(0.975)


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """
    Covariances (P, P) of a fit's parameters: over blocks, for white and lasting noise, by bias, without a prior.

    Without a prior, some columns are not told.
    """

    sampling: Array
    bias: Array
    nominal: Array
    student: Student
    alone: Array
    untold: NDArray[np.int64]
    serial: Array | None = None

    @property
    def covariance(self) -> Array:
        """Covariance (P, P) by sums over blocks and bias."""
        return self.sampling + self.bias

    def of(self, combinations: Array) -> Array:
        """Deviations (k,) of combinations (k, P) of the parameters, 1.96 of which make an interval of 95 %."""
        sampled = self.student.quantile_ratio**2 * _variances(combinations, self.sampling)
        lasting = 0.0 if self.serial is None else _variances(combinations, self.serial)
        return np.sqrt(np.maximum(sampled, lasting) + _variances(combinations, self.bias))

    def for_intervals(self, combinations: Array) -> Array:
        """Deviations (k,) for intervals: of the rows alone where the prior decides, infinite if these tell nothing."""
        # Of rows alone they are a column's own, and no less relative to those for white residuals.
        found, alone = self.of(combinations), np.sqrt(_variances(combinations, self.alone))
        bias, nominal = _variances(combinations, self.bias), self.nominal_of(combinations)
        rest = np.sqrt(np.maximum(found**2 - bias, 0.0))
        decided = (bias > MAX_PRIOR_SHARE * found**2) & (alone > NEARLY_TOLD * found)
        told = ~np.any(combinations[:, self.untold], axis=1)
        more = np.maximum(np.divide(rest, nominal, out=np.ones_like(rest), where=nominal > 0.0), 1.0)
        return np.where(decided, np.where(told, more * alone, np.inf), found)

    def nominal_of(self, combinations: Array) -> Array:
        """Standard deviations (k,) of combinations (k, P) for white residuals."""
        return np.sqrt(_variances(combinations, self.nominal))


def _variances(combinations: Array, covariance: Array) -> Array:
    return np.maximum(np.einsum("ki,ij,kj->k", combinations, covariance, combinations), 0.0)


def uncertainty(evidence: LogEvidence, fit: Fit) -> Uncertainty:
    """Uncertainty of a fit: by the block jackknife (Kuensch 1989), plus that of directions which the prior decides."""
    # The jackknife omits each block by one Newton step, without positivity, so that an estimate at the edge of what is
    # possible is not taken for certain. For what the prior holds back, c w H^-1 H_p H^-1 is added: H_p is the curvature
    # of the prior's links at the weight w, H that of the squares plus H_p, and c twice the links' divergence from the
    # prior over the number of links' parameters that the logs determine.
    prior, weight = evidence.prior_of(fit.settings), fit.settings.weight
    links = prior.tens.size
    inverse, kept = inverse_curvature(evidence, fit)
    pull = _pull(evidence, fit)
    H = fit.curvature + pull
    steps = [scaled_inverse(H - A, kept) @ score for A, score in _blocks(evidence, fit)]
    spread = np.array(steps) - np.mean(steps, axis=0)
    sampling = (len(steps) - 1) / len(steps) * spread.T @ spread
    determined = float(np.trace((inverse @ fit.curvature)[:links, :links]))
    moved = 2.0 * prior.distance(fit.x) / max(determined, 1.0)
    bias, columns = weight * moved * inverse @ pull @ inverse, evidence.independent(fit.settings)
    alone, own = _alone(fit.curvature, columns), np.diag(fit.curvature)
    untold = columns[np.diag(alone)[columns] * own[columns] > UNTOLD]
    return Uncertainty(sampling, bias, inverse, Student(len(steps)), alone, untold)


def _alone(curvature: Array, columns: NDArray[np.int64]) -> Array:
    """Covariance (P, P) that rows leave of independent columns without a prior."""
    diagonal = np.zeros(len(curvature))
    diagonal[columns] = LEAST_TOLD * np.diag(curvature)[columns]
    return scaled_inverse(curvature + np.diag(diagonal), columns)


def inverse_curvature(evidence: LogEvidence, fit: Fit) -> tuple[Array, NDArray[np.int64]]:
    """Inverse (P, P) of the squares' and the prior's curvature, and the indices of the parameters that are fitted."""
    kept = np.flatnonzero(fit.settings.columns(evidence.mechanism))
    return scaled_inverse(fit.curvature + _pull(evidence, fit), kept), kept


def _pull(evidence: LogEvidence, fit: Fit) -> Array:
    """Curvature (P, P) of the links' prior."""
    return evidence.prior_of(fit.settings).hold(fit.x, fit.settings.weight)


def _blocks(evidence: LogEvidence, fit: Fit) -> Iterator[tuple[Array, Array]]:
    mask = fit.settings.columns(evidence.mechanism)
    for b in range(evidence.blocks):
        A, moment = evidence.equations(fit.settings, [b]).whitened(fit.deviations)
        A = A * np.outer(mask, mask)
        yield A, A @ fit.x - moment * mask


def scaled_inverse(matrix: Array, kept: NDArray[np.int64]) -> Array:
    """Inverse (P, P) of a matrix in some of its rows and columns, scaled to a diagonal of ones before."""
    own = matrix[np.ix_(kept, kept)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(own), 1e-300))
    out = np.zeros_like(matrix)
    scaled = np.linalg.pinv(own * np.outer(scale, scale), rcond=1e-12, hermitian=True)
    out[np.ix_(kept, kept)] = scaled * np.outer(scale, scale)
    return out


# Parameters of a combination that are named.
MAX_NAMED_PARAMETERS = 4
# Deviations that a combination's prior range must be worth to count as excited.
MIN_STRENGTH = 3.0
# Energy error in percent at which essential components are counted.
ENERGY_ERROR = 1.0
# States of a motion that components are fitted to, about; as many between them judge the error.
FITTED_STATES = 1000


class Combination(NamedTuple):
    """Combination of base parameters in words, and its prior range divided by its standard deviation from the log."""

    words: str
    strength: float


def combinations(curvature: Array, names: Sequence[str], ranges: PriorRanges | None = None) -> list[Combination]:
    """Eigenvectors of a normal matrix, parameters scaled by their prior ranges, the least excited first."""
    scale = (ranges or PriorRanges()).for_parameters(tuple(names))
    values, vectors = np.linalg.eigh(curvature * np.outer(scale, scale))
    return [
        Combination(_words(vector, names), float(np.sqrt(max(value, 0.0))))
        for value, vector in zip(values, vectors.T, strict=True)
    ]


def unexcited(found: Sequence[Combination], inflation: float) -> list[Combination]:
    """Combinations that a log hardly excites: those of strength below 3 times `deviation_ratio`."""
    return [c for c in found if c.strength < MIN_STRENGTH * inflation]


def essential_components(mechanism: Mechanism, p: Array, v: Array) -> tuple[EssentialSpace, int]:
    """Essential space with half of a motion's states, and the number of components for 1 % of the others' energy."""
    step = max(2, len(p) // FITTED_STATES)
    first, others = (States(p[own], v[own], "the logged motion") for own in (np.s_[::step], np.s_[step // 2 :: step]))
    space = essential_space(mechanism, states=first)
    return space, reduce(space, mechanism, energy_error=ENERGY_ERROR, states=others).num_components


def _words(vector: Array, names: Sequence[str]) -> str:
    largest = np.argsort(-np.abs(vector))[:MAX_NAMED_PARAMETERS]
    kept = [i for i in largest.tolist() if abs(vector[i]) > 0.2 * abs(vector[largest[0]])]
    sign = np.sign(vector[kept[0]])
    terms = [f"{sign * vector[i]:+.2f} {names[i]}" for i in kept]
    return " ".join(terms).removeprefix("+") + (" ..." if len(kept) < np.sum(np.abs(vector) > 0.1) else "")


# Share of the largest torque of the motion that residuals are expected to have, unless given.
NOISE_SHARE = 0.02

# Share of the largest joint's torque that every joint is taken to have at least.
MIN_TORQUE_SHARE = 0.01


@dataclass(frozen=True, eq=False)
class Forecast:
    """Standard deviations (k,) to be expected from one motion, condition number, and combinations by excitation."""

    model: ReducedModel
    condition: float
    deviations: Array
    combinations: tuple[Combination, ...]

    @property
    def relative(self) -> Array:
        """Standard deviations (k,) divided by the parameters' sizes."""
        value = np.abs(self.model.fundamental_parameters)
        unknown = np.where(self.deviations > 0.0, np.inf, 0.0)
        return np.divide(self.deviations, value, out=unknown, where=value > 0.0)


def forecast(
    mechanism: Mechanism, motion: RobotMotion, noise: ArrayLike | None = None, earlier: Motion | None = None
) -> Forecast:
    """Standard deviations to be expected from least squares on a motion, with an earlier one if given."""
    given = None if noise is None else positive_per_joint(noise, mechanism.dof, "noise")
    model = ReducedModel(mechanism)
    _, p, v, a, _ = motion.sampled(INDEPENDENT_ROW_RATE)
    expected = _expected(mechanism.inverse_dynamics(p, v, a)) if given is None else given
    if earlier is not None:
        p, v, a = (np.concatenate(both) for both in zip((p, v, a), earlier, strict=True))
    Y = (model.torque_regressor(p, v, a) / expected[:, None]).reshape(-1, len(model.columns))
    condition, deviations = least_squares_deviations(Y, PriorRanges().for_parameters(model.names))
    return Forecast(model, condition, deviations, tuple(combinations(Y.T @ Y, model.names)))


def _expected(torque: Array) -> Array:
    largest = np.abs(torque).max(axis=0)
    if not np.any(largest):
        raise InputError("noise: the motion needs no torque; give the expected residuals")
    return NOISE_SHARE * np.maximum(largest, MIN_TORQUE_SHARE * largest.max())
