"""Errors of a fit from noise that lasts and from torques that are late, which sums over blocks do not show."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from adaptctl.arrays import Array
from adaptctl.identification.fit import Fit, LogEvidence
from adaptctl.identification.uncertainty import Student, Uncertainty, inverse_curvature

# Residuals of a joint are modelled as an autoregression e_t = a_1 e_(t-1) + ... + w_t; the variance of Y'e is then that
# of w times the sum of squares of Y filtered backwards by 1/(1 - a_1 z - ...).

ORDER = 4
# Times (1 + 3 a)/n by which the sum a of a short series' coefficients is raised, as residuals of fits persist less than
# the noise (Kendall 1954), and the largest that it may be.
PERSISTENCE_ROUNDS, MAX_PERSISTENCE = 2.0, 0.98
# Deviations from 0 from which on a delay is likely, and beyond doubt, which it is from some s on; rounds of its search.
DELAY_COUNTS, DELAY_SURE, MIN_DELAY, DELAY_ROUNDS = 2.0, 5.0, 1e-3, 3


class Delay(NamedTuple):
    """Delay of the torques in s, its deviation, and what a second of it would do to the parameters (P,)."""

    value: float
    deviation: float
    effect: Array

    @property
    def counts(self) -> bool:
        """True if the delay is there beyond doubt."""
        return abs(self.value) > max(DELAY_SURE * self.deviation, MIN_DELAY)


class Undelayed(NamedTuple):
    """Evidence, fit and rows to judge on whose torques are as much earlier as they were late, and a remark on that."""

    evidence: LogEvidence
    fit: Fit
    judged: LogEvidence
    remark: str | None = None


def without_delay(evidence: LogEvidence, fit: Fit, judged: LogEvidence) -> Undelayed:
    """Evidence without a delay that is beyond doubt, if rows held out are predicted better so; otherwise as it was."""
    now = before = Undelayed(evidence, fit, judged)
    whole = 0.0
    for _ in range(DELAY_ROUNDS):
        inverse, _ = inverse_curvature(now.evidence, now.fit)
        delay = estimated_delay(now.evidence, now.fit, inverse, Student(evidence.blocks))
        if not (delay.counts or whole):
            return before
        whole += delay.value
        moved = evidence.advanced(whole)
        fitted = moved.fit(fit.settings, range(moved.blocks))
        now = Undelayed(moved, fitted, judged.advanced(whole), _remark(whole, delay.deviation))
    return now if _error(now) < _error(before) else before


def _error(tried: Undelayed) -> float:
    rows = tried.judged.rows[min(tried.judged.rows)]
    return float(np.linalg.norm(rows.regressor @ tried.fit.x - rows.torque))


def _remark(delay: float, deviation: float) -> str:
    way, other = ("later", "earlier") if delay > 0.0 else ("earlier", "later")
    return (
        f"the torques are {1e3 * abs(delay):.2g} ms {way} than the positions (deviation {1e3 * deviation:.1g} ms), and "
        f"are taken as much {other} in fit and validation; check the filters and clocks of the log"
    )


def with_lasting_errors(found: Uncertainty, evidence: LogEvidence, fit: Fit) -> Uncertainty:
    """Uncertainty that also has noise that lasts, and what a delay does that is likely but not beyond doubt."""
    inverse, kept = inverse_curvature(evidence, fit)
    serial = inverse @ _scores(evidence, fit, kept) @ inverse
    delay = estimated_delay(evidence, fit, inverse, found.student)
    off = delay.value if abs(delay.value) > DELAY_COUNTS * delay.deviation else 0.0
    return replace(found, serial=serial, bias=found.bias + off**2 * np.outer(delay.effect, delay.effect))


def _scores(evidence: LogEvidence, fit: Fit, kept: NDArray[np.int64]) -> Array:
    """Covariance (P, P) of the weighted sums Y'e under autoregressive noise of each joint."""
    rows, used = evidence.rows[fit.settings.cutoff], evidence.counted(fit.settings)
    error = np.where(used, rows.regressor @ fit.x - rows.torque, 0.0)
    P, share = rows.regressor.shape[-1], len(kept) / used.shape[1]
    out = np.zeros((P, P))
    for j in np.flatnonzero(used.any(axis=0)).tolist():
        coefficients, variance = autoregression(error[:, j], share)
        Y = rows.regressor[::-1, j][:, kept] * (used[::-1, j] / fit.deviations[j] ** 2)[:, None]
        lasting = lfilter([1.0], np.concatenate([[1.0], -coefficients]), Y, axis=0)
        out[np.ix_(kept, kept)] += variance * lasting.T @ lasting
    return out


def autoregression(error: Array, parameters: float) -> tuple[Array, float]:
    """Coefficients (4,) of an autoregression of residuals (n,), and the variance of its innovations."""
    n = len(error)
    products = np.array([error[: n - k] @ error[k:] for k in range(ORDER + 1)]) / n
    if products[0] == 0.0:
        return np.zeros(ORDER), 0.0
    first = products[:ORDER] * np.where(np.arange(ORDER) == 0, 1.0 + 1e-9, 1.0)
    found = solve_toeplitz(first, products[1:])
    variance = max(float(products[0] - found @ products[1:]), 0.0) * n / max(n - parameters, 0.5 * n)
    whole = float(found.sum())
    if whole > 0.2:
        more = PERSISTENCE_ROUNDS * (1.0 + 3.0 * whole) / n
        found = found * max(min(whole + more, MAX_PERSISTENCE), min(whole, MAX_PERSISTENCE)) / whole
    return np.asarray(found), variance


def estimated_delay(evidence: LogEvidence, fit: Fit, inverse: Array, student: Student) -> Delay:
    """Delay of all torques by least squares, along with the parameters; its deviation from sums over blocks."""
    rows, used = evidence.rows[fit.settings.cutoff], evidence.counted(fit.settings)
    weight = used / fit.deviations**2
    effect = inverse @ np.einsum("njp,nj->p", rows.regressor, weight * rows.change)
    changed = rows.regressor @ effect - rows.change
    error = rows.regressor @ fit.x - rows.torque
    whole = float((weight * changed**2).sum())
    if whole == 0.0:
        return Delay(0.0, 0.0, effect)
    value = -float((weight * changed * error).sum()) / whole
    score = (weight * changed * (error + value * changed)).sum(axis=1)
    sums = np.array([score[part].sum() for part in np.array_split(np.arange(len(score)), evidence.blocks)])
    deviation = student.quantile_ratio * float(np.sqrt(len(sums)) * np.std(sums, ddof=1)) / whole
    return Delay(value, deviation, effect)
