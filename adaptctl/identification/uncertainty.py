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
    """Uncertainty of a fit of P parameters of a mechanism, in the order of its `parameter_names`, and r coefficients of
    load-dependent friction (its torque over that of the joint without friction). `covariance` (P + r, P + r), SI units,
    is their covariance; for comparison `nominal` (P + r, P + r) is the covariance if residuals were white
    (uncorrelated) and the model right. Rows of parameters that the fit does not have are zero. Made by `uncertainty`;
    nothing is checked at construction."""

    covariance: Array
    """(P + r, P + r)"""
    nominal: Array
    """(P + r, P + r) as if residuals were white and the model right, for comparison"""

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
