"""Consistent fit of links, payloads and torque constants together, with the errors in the torque columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.consistent_estimate import consistent_estimate
from adaptctl.identification.entropic import EntropicPrior
from adaptctl.identification.least_squares import least_squares
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.uncertainty import Student, scaled_inverse

# With i the torque column of a motor and k its constant, i = c Y x + e, c = 1/k: the errors are those of the column, so
# that small constants are not favoured, as they are by residuals of Y x - k i (Gautier and Briot 2014). Links and
# payloads in x are consistent and friction is positive, which decides signs, and a payload's mass the common scale, as
# in a semidefinite programme (Sousa and Cortesao 2014). Steps are Gauss and Newton's, each a consistent estimate.

# Weight of the prior, rounds in which motors are weighted by their residuals, and most steps of one round.
PRIOR_WEIGHT, WEIGHTING_ROUNDS, MAX_STEPS = 0.1, 4, 60
# Relative change of all constants and fall of the objective at which a round ends, and most halvings of a step.
LEAST_CHANGE, LEAST_FALL, MAX_HALVINGS = 1e-5, 1e-7, 30
# Deviation of known values, relative to their size.
KNOWN_DEVIATION = 1e-5


class KnownValue(NamedTuple):
    """Known value of a parameter, by its place, and the size that it is known relative to."""

    place: int
    value: float
    size: float


@dataclass(frozen=True, eq=False)
class LoadedEquations:
    """
    Equations i = c Y x of r motors, summed over blocks of time.

    They have the prior of x (P,), known entries of it, indices of motors whose c is unknown, of the columns that least
    squares is solved for, and of each motor's viscous and Coulomb friction (r, 2).
    """

    equations: NormalEquations
    prior: EntropicPrior
    known: Sequence[KnownValue]
    unknown: NDArray[np.int64]
    columns: NDArray[np.int64]
    friction: NDArray[np.int64]

    def linearised(self, equations: NormalEquations, x: Array, c: Array, deviations: Array) -> tuple[Array, Array]:
        """Normal matrix and moment of x and of changes of the unknown c, at values of both."""
        N, m = equations.normal.sum(axis=0), equations.moment.sum(axis=0)
        weight, u, P = 1.0 / deviations**2, self.unknown, len(x)
        A, b = np.zeros((P + len(u), P + len(u))), np.zeros(P + len(u))
        A[:P, :P], b[:P] = np.einsum("rij,r->ij", N, weight * c**2), (weight * c) @ m
        slopes = N[u] @ x
        A[P:, :P] = (weight * c)[u, None] * slopes
        A[:P, P:] = A[P:, :P].T
        A[P:, P:], b[P:] = np.diag(weight[u] * (slopes @ x)), weight[u] * (m[u] @ x)
        return A, b

    def pinned(self, A: Array, b: Array) -> tuple[Array, Array]:
        """Normal matrix and moment with what is known."""
        for place, value, size in self.known:
            weight = (KNOWN_DEVIATION * size) ** -2
            A[place, place] += weight
            b[place] += weight * value
        return A, b

    def squares(self, x: Array, c: Array) -> Array:
        """Sums (r,) of squared residuals of the torque columns."""
        N, m = self.equations.normal.sum(axis=0), self.equations.moment.sum(axis=0)
        return np.maximum(self.equations.square.sum(axis=0) - 2.0 * c * (m @ x) + c**2 * ((N @ x) @ x), 0.0)

    def deviations(self, x: Array, c: Array) -> Array:
        """Residual deviations (r,) of the torque columns."""
        count = np.maximum(self.equations.count.sum(axis=0), 1.0)
        least = 1e-6 * np.sqrt(self.equations.square.sum(axis=0) / count)
        return np.maximum(np.sqrt(self.squares(x, c) / count), np.maximum(least, 1e-12))

    def value(self, x: Array, c: Array, deviations: Array) -> float:
        """Objective of x and c."""
        pins = sum(((x[k.place] - k.value) / (KNOWN_DEVIATION * k.size)) ** 2 for k in self.known)
        return 0.5 * float(self.squares(x, c) @ deviations**-2 + pins) + self.prior.divergence(x, PRIOR_WEIGHT)

    def started(self) -> tuple[Array, Array]:
        """First x and c: the prior's links, and slopes of the columns on their torques with the sign of friction."""
        N, m = self.equations.normal.sum(axis=0), self.equations.moment.sum(axis=0)
        links = self.prior.start(N.shape[-1])
        links[self.prior.tens.size :] = 0.0
        c = np.ones(len(m))
        for k in self.unknown.tolist():
            own, both = least_squares(N[k], m[k], self.columns), self.friction[k]
            rubbing = float(N[k][both[0], both] @ own[both])  # viscous column times the friction found: its power
            basis = np.zeros((len(links), 1 + len(both)))
            basis[:, 0], basis[both, [1, 2]] = links, 1.0
            slope = least_squares(basis.T @ N[k] @ basis, basis.T @ m[k], np.arange(3))[0]
            size = np.sqrt(self.equations.square.sum(axis=0)[k] / max(float(links @ N[k] @ links), 1e-300))
            c[k] = np.copysign(max(abs(slope), 0.1 * size), rubbing or 1.0)
        return self.prior.start(N.shape[-1]), c


class LoadedFit(NamedTuple):
    """Parameters x (P,), c (r,) of the motors, and the covariance of x and the unknown c, with its blocks."""

    x: Array
    c: Array
    covariance: Array
    student: Student

    def deviations(self, combinations: Array) -> Array:
        """Deviations (k,) of combinations (k, P + u), 1.96 of which make an interval of 95 %."""
        variance = np.einsum("ki,ij,kj->k", combinations, self.covariance, combinations)
        return self.student.quantile_ratio * np.sqrt(np.maximum(variance, 0.0))


def loaded_fit(problem: LoadedEquations) -> LoadedFit:
    """Consistent fit of x and the unknown c, by rounds of weights."""
    x, c = problem.started()
    deviations = problem.deviations(x, c)
    for _ in range(WEIGHTING_ROUNDS):
        x, c = _minimum(problem, x, c, deviations)
        deviations = problem.deviations(x, c)
    blocks = len(problem.equations.count)
    return LoadedFit(x, c, _covariance(problem, x, c, deviations), Student(blocks))


def _minimum(problem: LoadedEquations, x: Array, c: Array, deviations: Array) -> tuple[Array, Array]:
    u, P = problem.unknown, len(x)
    value = problem.value(x, c, deviations)
    for _ in range(MAX_STEPS if len(u) else 1):
        A, b = problem.pinned(*problem.linearised(problem.equations, x, c, deviations))
        z = consistent_estimate(A, b, problem.prior, PRIOR_WEIGHT, np.concatenate([x, np.zeros(len(u))]))
        for x_new, c_new in _halved(problem, x, c, z[:P] - x, z[P:]):
            if (new := problem.value(x_new, c_new, deviations)) <= value:
                break
        else:
            break
        change, fall = float(np.abs(c_new / c - 1.0).max()), value - new
        x, c, value = x_new, c_new, new
        if change < LEAST_CHANGE or fall < LEAST_FALL * abs(value):
            break
    return x, c


def _halved(problem: LoadedEquations, x: Array, c: Array, dx: Array, dc: Array) -> Iterator[tuple[Array, Array]]:
    """The point after a step, and after ever shorter ones, as far as no constant changes its sign."""
    for k in range(MAX_HALVINGS):
        moved = c.copy()
        moved[problem.unknown] += 0.5**k * dc
        if np.all(moved * c > 0.0):
            yield x + 0.5**k * dx, moved


def _covariance(problem: LoadedEquations, x: Array, c: Array, deviations: Array) -> Array:
    """Covariance of x and the unknown c by the block jackknife (Kuensch 1989), and by what the prior holds back."""
    links, kept = problem.prior.tens.size, np.arange(len(x) + len(problem.unknown))
    A, _ = problem.pinned(*problem.linearised(problem.equations, x, c, deviations))
    pull = np.zeros_like(A)
    pull[:links, :links] = problem.prior.hold(x, PRIOR_WEIGHT)[:links, :links]
    H, z = A + pull, np.concatenate([x, np.zeros(len(problem.unknown))])
    steps = []
    for k in range(len(problem.equations.count)):
        own, b = problem.linearised(problem.equations.over([k]), x, c, deviations)
        steps.append(scaled_inverse(H - own, kept) @ (own @ z - b))
    spread = np.array(steps) - np.mean(steps, axis=0)
    inverse = scaled_inverse(H, kept)
    determined = float(np.trace((inverse @ A)[:links, :links]))
    moved = 2.0 * problem.prior.distance(x) / max(determined, 1.0)
    return (len(steps) - 1) / len(steps) * spread.T @ spread + PRIOR_WEIGHT * moved * inverse @ pull @ inverse
