"""Errors of a fit from noise that lasts and from torques that are late, which sums over blocks do not show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.autoregression import lasting_covariance
from adaptctl.identification.delay import estimated_delay
from adaptctl.identification.fit import Fit, LogEvidence
from adaptctl.identification.uncertainty import Uncertainty, inverse_curvature

# Deviations from 0 from which on a delay is likely.
DELAY_COUNTS = 2.0


def with_lasting_errors(found: Uncertainty, evidence: LogEvidence, fit: Fit) -> Uncertainty:
    """Uncertainty that also has noise that lasts, and what a delay does that is likely but not beyond doubt."""
    inverse, kept = inverse_curvature(evidence, fit)
    all_rows = float(evidence.equations(fit.settings, range(evidence.blocks)).count.sum())
    ratio = all_rows / max(int(np.count_nonzero(evidence.counted(fit.settings))), 1)  # of all rows to those kept
    serial = ratio * inverse @ _scores(evidence, fit, kept) @ inverse
    delay = estimated_delay(evidence, fit, ratio * inverse, found.student)
    off = delay.value if abs(delay.value) > DELAY_COUNTS * delay.deviation else 0.0
    return replace(found, serial=serial, bias=found.bias + off**2 * np.outer(delay.effect, delay.effect))


def _scores(evidence: LogEvidence, fit: Fit, kept: NDArray[np.int64]) -> Array:
    """Covariance (P, P) of the weighted sums Y'e under autoregressive noise of each joint."""
    rows, used = evidence.fitted_rows(fit.settings), evidence.counted(fit.settings)
    error = np.where(used, rows.regressor @ fit.x - rows.torque, 0.0)
    P, share = rows.regressor.shape[-1], len(kept) / used.shape[1]
    out = np.zeros((P, P))
    for j in np.flatnonzero(used.any(axis=0)).tolist():
        Y = rows.regressor[:, j][:, kept] * (used[:, j] / fit.deviations[j] ** 2)[:, None]
        out[np.ix_(kept, kept)] += lasting_covariance(Y, error[:, j], share)
    return out
