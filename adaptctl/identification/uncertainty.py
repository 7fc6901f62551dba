"""Uncertainty of the estimates: deviations that stay true where residuals are not white."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.fit import Fit, LogEvidence


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of a fit: the covariance of all columns' parameters."""

    covariance: Array
    """(P + r, P + r)"""
    nominal: Array
    """(P + r, P + r) as if residuals were white and the model right, for comparison"""

    def of(self, combinations: Array) -> Array:
        """Standard deviations (k,) of combinations (k, P + r) of the parameters."""
        return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", combinations, self.covariance, combinations), 0.0))

    def nominal_of(self, combinations: Array) -> Array:
        """Standard deviations (k,) of combinations (k, P + r) as if residuals were white."""
        return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", combinations, self.nominal, combinations), 0.0))


def uncertainty(evidence: LogEvidence, fit: Fit) -> Uncertainty:
    """Uncertainty of a fit by the block jackknife (Kuensch 1989): the fit without each block of time in turn, a Newton
    step away.

    The step is as if nothing had to be positive, so that an estimate at the edge of that is not taken for certain. The
    jackknife sees what the log's noise does, not how far the prior holds the estimate back. With the prior's curvature
    H_p within the fit's H, and C the spread of the truth about the prior, that is H^-1 H_p C H_p H^-1, which is added.
    C is taken as the prior's shape (1/H_p at a weight of one) times how far the logs moved what they tell: where they
    tell nothing, it is all that is left.
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
