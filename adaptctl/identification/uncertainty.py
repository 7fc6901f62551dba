"""How far the estimates may be off: deviations that residuals which are not white do not flatter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identification.fit import Evidence, Fit


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Standard deviations of all columns' parameters, and what they are made of."""

    covariance: Array
    """(P + r, P + r)"""
    nominal: Array
    """(P + r, P + r) as if residuals were white and the model right, for comparison"""

    def of(self, combinations: Array) -> Array:
        """Standard deviations (k,) of combinations (k, P + r) of the parameters."""
        return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", combinations, self.covariance, combinations), 0.0))

    def nominal_of(self, combinations: Array) -> Array:
        """The same of white residuals."""
        return np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", combinations, self.nominal, combinations), 0.0))


def uncertainty(evidence: Evidence, fit: Fit) -> Uncertainty:
    """By the block jackknife (Kuensch 1989): the fit repeated without each block of time in turn.

    The jackknife sees what the log's noise does, not how far the prior holds the estimate back. With the prior's
    curvature H_p in the fit's H, that is H^-1 H_p H^-1, which is added: where the log says nothing, it is all that
    the prior leaves open.
    """
    settings, blocks = fit.settings, range(evidence.blocks)
    load = evidence.load(settings.cutoff, fit.x) if settings.friction.load else None
    each = []
    for left_out in blocks:
        rest = evidence.equations(settings.cutoff, [b for b in blocks if b != left_out], load)
        each.append(evidence.fitted(rest, settings, fit.x).x)
    spread = np.array(each) - np.mean(each, axis=0)
    sampling = (len(each) - 1) / len(each) * spread.T @ spread
    inverse, held_back = _shrinkage(evidence, fit)
    return Uncertainty(sampling + held_back, inverse)


def _shrinkage(evidence: Evidence, fit: Fit) -> tuple[Array, Array]:
    """H^-1, and H^-1 H_p H^-1, on the columns that the fit has."""
    prior = evidence.prior_of(fit.settings.friction).curvature(fit.x, fit.settings.weight)
    kept = np.flatnonzero(evidence.mask(fit.settings.friction))
    H = (fit.curvature + prior)[np.ix_(kept, kept)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    inverse = np.linalg.pinv(H * np.outer(scale, scale), rcond=1e-14, hermitian=True) * np.outer(scale, scale)
    size = len(fit.x)
    whole, held_back = np.zeros((size, size)), np.zeros((size, size))
    whole[np.ix_(kept, kept)] = inverse
    held_back[np.ix_(kept, kept)] = inverse @ prior[np.ix_(kept, kept)] @ inverse
    return whole, held_back
