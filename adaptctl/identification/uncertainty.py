"""Uncertainty of the estimates: deviations that stay true where residuals are not white."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, positive_per_joint
from adaptctl.control.adaptation import PriorRanges
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import EssentialSpace, ReducedModel, States, essential_space, fundamental_basis, reduce
from adaptctl.identification.fit import Fit, LogEvidence
from adaptctl.identification.robot_motion import RobotMotion


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of a fit of P parameters of a mechanism, in the order of its `parameter_names`, and r coefficients of
    load-dependent friction (its torque over that of the joint without friction). `covariance` (P + r, P + r), SI units,
    is their covariance; for comparison `nominal` (P + r, P + r) is the covariance if residuals were white
    (uncorrelated) and the model right. Rows of parameters that the fit does not have are zero. Made by `uncertainty`;
    nothing is checked at construction."""

    covariance: Array
    nominal: Array

    def of(self, combinations: Array) -> Array:
        """Standard deviations (k,) of k combinations of the fit's parameters, in the combinations' units;
        `combinations` (k, P + r) are their coefficients on the mechanism's P parameters and r coefficients of
        load-dependent friction (its torque over that of the joint without friction). Raises `ValueError` for another
        shape."""
        return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", combinations, self.covariance, combinations), 0.0))

    def nominal_of(self, combinations: Array) -> Array:
        """Standard deviations (k,) that k combinations of the fit's parameters would have if torque residuals were
        white (uncorrelated), in the combinations' units; `combinations` (k, P + r) are their coefficients on the
        mechanism's P parameters and r coefficients of load-dependent friction (its torque over that of the joint
        without friction). Raises `ValueError` for another shape."""
        return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", combinations, self.nominal, combinations), 0.0))


def uncertainty(evidence: LogEvidence, fit: Fit) -> Uncertainty:
    """The uncertainty, an `Uncertainty`, of a fit to evidence (low-pass filtered equations of motion along logs), by
    the block jackknife (Kuensch 1989) and by what the prior, the first guess of the links, leaves open.

    The jackknife makes the fit without each block of time in turn, by one Newton step in which nothing has to be
    positive, so that an estimate at the edge of what is possible is not taken for certain. It sees the log's noise, not
    how far the prior holds the estimate back; for that c w H^-1 H_p H^-1 is added, as if the true parameters had the
    covariance c (H_p/w)^-1 about the prior. H is the curvature of the fit's squares plus H_p, that of the prior's links
    at the fit's weight w, and c is twice the links' divergence from the prior, divided by the number of links'
    parameters that the logs determine (at least 1). `evidence` is that from which the fit was made. Raises `KeyError`
    where it does not have the fit's cut-off.
    """
    kept = np.flatnonzero(evidence.mask(fit.settings.friction))
    prior, weight = evidence.prior_of(fit.settings.friction), fit.settings.weight
    pull = prior.curvature(fit.x, weight)
    links = prior.tens.size
    pull[links:, links:] = 0.0
    H = fit.curvature + pull
    inverse = _inverse(H, kept)
    steps = [_inverse(H - A, kept) @ score for A, score in _blocks(evidence, fit)]
    spread = np.array(steps) - np.mean(steps, axis=0)
    sampling = (len(steps) - 1) / len(steps) * spread.T @ spread
    determined = float(np.trace((inverse @ fit.curvature)[:links, :links]))
    moved = 2.0 * prior.distance(fit.x) / max(determined, 1.0)
    return Uncertainty(sampling + weight * moved * inverse @ pull @ inverse, inverse)


def _blocks(evidence: LogEvidence, fit: Fit) -> Iterator[tuple[Array, Array]]:
    """Curvature and slope of the whitened squares in each block."""
    settings, mask = fit.settings, evidence.mask(fit.settings.friction)
    load = evidence.load_from(settings, range(evidence.blocks))
    for b in range(evidence.blocks):
        A, moment = evidence.equations(settings.cutoff, [b], load).whitened(fit.deviations)
        A = A * np.outer(mask, mask)
        yield A, A @ fit.x - moment * mask


def _inverse(matrix: Array, kept: NDArray[np.int64]) -> Array:
    """Inverse of the kept rows and columns of a matrix, zero elsewhere."""
    own = matrix[np.ix_(kept, kept)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(own), 1e-300))
    out = np.zeros_like(matrix)
    scaled = np.linalg.pinv(own * np.outer(scale, scale), rcond=1e-12, hermitian=True)
    out[np.ix_(kept, kept)] = scaled * np.outer(scale, scale)
    return out


SHOWN = 4
"""Parameters of a combination that are named."""
WEAK = 3.0
"""Deviations that a combination's prior range must be worth to count as excited."""
ENERGY_ERROR = 1.0
"""Percent, of the essential components that are counted."""


class Combination(NamedTuple):
    """Combination of fundamental (base) parameters, and how strongly a log excites it. `words` is a text such as "0.89
    link2.mc_x -0.45 link3.m": the largest coefficients (unitless), up to four, of parameters each divided by its prior
    range, the greatest plausible distance from a first guess. `strength` (unitless) is the ratio of the prior range
    along the combination to the standard deviation that the log leaves. Made by `combinations`; nothing is checked at
    construction."""

    words: str
    strength: float


def combinations(curvature: Array, names: Sequence[str], ranges: PriorRanges | None = None) -> list[Combination]:
    """Combinations of k parameters, a list of k `Combination`, the least excited first: the eigenvectors of a normal
    matrix, once parameters are scaled by their prior ranges. The matrix `curvature` (k, k), per SI units of two
    parameters, is of equations each divided by its standard deviation.

    `names` are the parameters' full names, such as `link1.m`, and `ranges` their greatest plausible distances from a
    first guess, by kind, `PriorRanges()` by default (None). Raises `NotFoundError` for a name of unknown kind,
    `ValueError` for a matrix of another size.
    """
    scale = (ranges or PriorRanges()).of(tuple(names))
    values, vectors = np.linalg.eigh(curvature * np.outer(scale, scale))
    return [
        Combination(_words(vector, names), float(np.sqrt(max(value, 0.0))))
        for value, vector in zip(values, vectors.T, strict=True)
    ]


def unexcited(found: Sequence[Combination], inflation: float) -> list[Combination]:
    """Combinations, a list of those `Combination` of `found` that a log hardly excites: with a `strength` below 3 times
    `inflation`, the log leaves them about as uncertain as they were before it. `inflation` (unitless) is the ratio of
    the true standard deviations to those for white (uncorrelated) residuals. Nothing is raised."""
    return [c for c in found if c.strength < WEAK * inflation]


def essential_components(mechanism: Mechanism, p: Array, v: Array) -> tuple[EssentialSpace, int]:
    """The essential space of a `mechanism`, an `EssentialSpace` (directions of the inertial parameters that change
    energies and torques), with a log's motion as its states, and a number of essential components, a pair. The number
    is that of the components, combinations of the mechanism's parameters, that give the motion's energy differences to
    a root mean square error of 1 % (Sheu and Walker 1991, section 3.2). The motion has positions `p`, rad (m for a
    prismatic joint), and velocities `v`, rad/s (m/s), both (n, r), of r joints at n instants. Raises `InputError` for a
    motion of other shapes or without energy differences, `RankError` where the number of identifiable parameters cannot
    be certified."""
    space = essential_space(mechanism, states=States(p, v, "the log's motion"))
    return space, reduce(space, mechanism, energy_error=ENERGY_ERROR).num_components


def _words(vector: Array, names: Sequence[str]) -> str:
    largest = np.argsort(-np.abs(vector))[:SHOWN]
    kept = [i for i in largest.tolist() if abs(vector[i]) > 0.2 * abs(vector[largest[0]])]
    sign = np.sign(vector[kept[0]])
    terms = [f"{sign * vector[i]:+.2f} {names[i]}" for i in kept]
    return " ".join(terms).removeprefix("+") + (" ..." if len(kept) < np.sum(np.abs(vector) > 0.1) else "")


RATE = 50.0
"""Hz: rows a second that count as independent."""
NOISE = 0.02
"""Of the largest torque of the motion: what residuals are expected to be, unless given."""

LEAST = 0.01
"""Of the largest joint's torque: what any joint's is taken to be at least."""
SHORTEST = 1e-3
"""Of the longest column of the regressor, each times its parameter's prior range: what columns are scaled as at least,
so that one of round-off alone stays short."""
UNEXCITED = 1e-9
"""Of the largest singular value of the scaled regressor: directions up to here count as not excited. Round-off leaves
some 1e-16 and a poor motion 1e-3, so that nothing is near the bound; that of the certificates of rank is the same."""
COMPONENT = 1e-6
"""Component of a parameter in the unexcited directions that counts: they are known to round-off over UNEXCITED."""


@dataclass(frozen=True, eq=False)
class Forecast:
    """Forecast of an identification before it is run: the standard deviations to be expected of a robot's k fundamental
    (base) parameters from one motion.

    `model` is the reduced model on these parameters, and `deviations` (k,), SI units, are in its order: infinite for a
    parameter that has a component in a direction that the motion does not excite. `condition`, without a unit, is the
    condition number (ratio of the largest to the smallest singular value) of the torque regressor along the motion,
    each joint's rows divided by its expected residual and each column scaled to length 1 (less for a column next to
    nothing); it is infinite where a direction is not excited. `combinations` are k directions of the parameters in
    words, each with its `strength`, without a unit (the plausible range along it over the deviation), the least excited
    first. Made by `forecast`; nothing is checked at construction.
    """

    model: ReducedModel
    condition: float
    deviations: Array
    combinations: tuple[Combination, ...]

    @property
    def relative(self) -> Array:
        """Relative standard deviations (k,), without a unit, of the k fundamental (base) parameters:
        deviation/|parameter|, with the parameters' values in the robot's file; infinite where a parameter is 0, unless
        its deviation is 0 too: then 0, since the parameter is known."""
        value = np.abs(self.model.fundamental_parameters)
        unknown = np.where(self.deviations > 0.0, np.inf, 0.0)
        return np.divide(self.deviations, value, out=unknown, where=value > 0.0)


def forecast(mechanism: Mechanism, motion: RobotMotion, noise: ArrayLike | None = None) -> Forecast:
    """The forecast, a `Forecast`, of the standard deviations that least squares on a `motion`, sampled at 50 Hz, will
    leave of a mechanism's fundamental (base) parameters.

    `noise` is the standard deviation of the torque residuals, N m (N for a prismatic joint), above zero: one number for
    all of r joints, or (r,). By default (None) it is 2 % of the largest torque on the motion, of each joint by itself;
    a joint whose largest torque is below 1 % of the largest of all joints counts with that 1 %. A direction of the
    parameters counts as not excited where its singular value, of the scaled regressor, is at most 1e-9 of the largest.
    Raises `InputError` for noise of another shape or not positive and finite, and for a motion without torque where
    none is given, `RankError` where the number of identifiable parameters cannot be certified, `SingularityError` near
    a singularity of kinematic loops.
    """
    given = None if noise is None else positive_per_joint(noise, mechanism.dof, "noise")
    model = ReducedModel(mechanism, fundamental_basis(essential_space(mechanism)))
    _, p, v, a, _ = motion.sampled(RATE)
    expected = _expected(mechanism.inverse_dynamics(p, v, a)) if given is None else given
    Y = (model.torque_regressor(p, v, a) / expected[:, None]).reshape(-1, len(model.columns))
    condition, deviations = _least_squares(Y, PriorRanges().of(model.names))
    return Forecast(model, condition, deviations, tuple(combinations(Y.T @ Y, model.names)))


def _expected(torque: Array) -> Array:
    """The residuals to expect (r,) of torques (n, r)."""
    largest = np.abs(torque).max(axis=0)
    if not np.any(largest):
        raise InputError("noise: the motion takes no torque to be a share of: give the residuals to expect")
    return NOISE * np.maximum(largest, LEAST * largest.max())


def _least_squares(Y: Array, ranges: Array) -> tuple[float, Array]:
    """The condition number of a regressor (m, k) whose residuals have deviation 1, scaled, and the deviations (k,) that
    least squares leave, from the singular value decomposition: the normal matrix has only half of its digits."""
    size = np.linalg.norm(Y, axis=0)
    size = np.maximum(size, SHORTEST * (size * ranges).max() / ranges)
    size[size == 0.0] = 1.0
    _, values, directions = np.linalg.svd(Y / size, full_matrices=len(Y) < len(size))
    rank = int(np.sum(values > UNEXCITED * values[0]))
    excited, not_excited = directions[:rank], directions[rank:]
    found = np.linalg.norm(excited / values[:rank, None], axis=0) / size
    found[np.linalg.norm(not_excited, axis=0) > COMPONENT] = np.inf
    return float(values[0] / values[-1]) if rank == len(size) else np.inf, found
