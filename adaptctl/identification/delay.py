"""Delay of the torques against the positions: its estimate, and logs freed of it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.drive import DriveParameter
from adaptctl.identification.autoregression import lasting_covariance
from adaptctl.identification.filtered_dynamics import Rows
from adaptctl.identification.fit import Fit, FitSettings, LogEvidence
from adaptctl.identification.friction_model import SIMPLE_FRICTION
from adaptctl.identification.preparation import PreparationStep
from adaptctl.identification.uncertainty import INTERVAL, Student, inverse_curvature
from adaptctl.stages import stage

# Delays that are told apart, in s and in sampling periods; deviations that must be less to tell them apart, and those
# from 0 from which on one is beyond doubt: friction that grows with the load is worth some.
LEAST_DELAY, LEAST_PERIODS, DETERMINED, SURE = 1e-3, 0.1, 3.0, 8.0
# Friction beside which a delay is fitted: with less, that of the robot is taken for delay.
FRICTION = SIMPLE_FRICTION.also((DriveParameter.SQUARE_ROOT, DriveParameter.STRIBECK))
# Errors over the deviations that a fit tells, as simulated logs have them.
ERROR_RATIO = 1.3
# Weight of the prior, share of peak speed below which a joint is masked, rounds of the search, its last step in s, and
# the largest delay in periods of the band.
PRIOR_WEIGHT, SLOW, ROUNDS, LAST_STEP, MOST_PERIODS = 1e-2, 0.05, 12, 1e-5, 2.0


class Delay(NamedTuple):
    """Delay of the torques in s, its deviation, what a second of it does to the parameters (P,), and a bound in s."""

    value: float
    deviation: float
    effect: Array
    least: float = LEAST_DELAY

    @property
    def counts(self) -> bool:
        """True if the delay is there beyond doubt."""
        return abs(self.value) > max(SURE * self.deviation, self.least)

    @property
    def words(self) -> str:
        """Delay in words."""
        way = "later" if self.value > 0.0 else "earlier"
        size = float(f"{1e3 * abs(self.value):.2g}")
        return f"the torques are {size:g} ms {way} than the positions ({self.interval})"

    @property
    def interval(self) -> str:
        """Interval of 95 % in words."""
        low, high = (1e3 * (self.value + sign * INTERVAL * self.deviation) for sign in (-1.0, 1.0))
        return f"95 % within {low:.3g} to {high:.3g} ms"

    @property
    def determinable(self) -> bool:
        """True if the log tells it from others that differ by the bound."""
        return DETERMINED * self.deviation <= self.least

    @property
    def outcome(self) -> str:
        """Delay in words, and if it is in doubt or not determinable."""
        if not self.determinable:
            told = f"{self.words}, but" if self.counts else f"{self.interval}:"
            return f"{told} not determinable to {1e3 * self.least:.2g} ms"
        doubtful = abs(self.value) > max(INTERVAL * self.deviation, self.least)
        if self.counts or doubtful:
            return self.words if self.counts else f"{self.words}, not beyond doubt and left so"
        return f"none: {self.interval}"


class Undelayed(NamedTuple):
    """Evidence and rows to judge on, freed of a delay or as they were, with a line on it, and a remark if they were."""

    evidence: LogEvidence
    judged: LogEvidence
    step: PreparationStep
    remark: str | None = None


def without_delay(
    delay: Delay, evidence: LogEvidence, judged: LogEvidence, springs: tuple[DriveParameter, ...] = ()
) -> Undelayed:
    """Evidence without a delay that is beyond doubt, if rows held out are predicted better so; otherwise as it was."""
    now = Undelayed(evidence, judged, PreparationStep("delay of the torques", delay.outcome))
    if not delay.counts:
        return now
    moved = now._replace(evidence=evidence.advanced(delay.value), judged=judged.advanced(delay.value))
    before, after = (one.evidence.fit(_settings(evidence, springs), range(evidence.blocks)) for one in (now, moved))
    if _error(moved.judged, after.x, before.deviations) >= _error(judged, before.x, before.deviations):
        return now
    other = "earlier" if delay.value > 0.0 else "later"
    told = (
        f"{delay.words}, and are taken as much {other} in fit and validation; check the filters and clocks of the log"
    )
    return moved._replace(remark=told)


def _error(judged: LogEvidence, x: Array, deviations: Array) -> float:
    rows = judged.rows[min(judged.rows)]
    return float(np.linalg.norm((rows.regressor @ x - rows.torque) / deviations))


def _settings(evidence: LogEvidence, springs: tuple[DriveParameter, ...]) -> FitSettings:
    return FitSettings(FRICTION.also(springs), PRIOR_WEIGHT, evidence.band, SLOW)


@stage("measuring the delay of torques")
def delay_of(evidence: LogEvidence, springs: tuple[DriveParameter, ...] = ()) -> Delay:
    """Delay of the torques, fitted along with links, friction, rotors and offsets, by Gauss-Newton steps."""
    own = replace(evidence.sampled, rows={evidence.band: evidence.rows[evidence.band]})
    least = max(LEAST_DELAY, LEAST_PERIODS / min(motion.log.rate for motion in evidence.motions))
    most, whole = MOST_PERIODS / evidence.band, 0.0
    for _ in range(ROUNDS):
        now = own.advanced(whole)
        fit = now.fit(_settings(own, springs), range(now.blocks))
        found = estimated_delay(now, fit, inverse_curvature(now, fit)[0], Student(now.blocks), lags=True)
        before, whole = whole, float(np.clip(whole + found.value, -most, most))
        if abs(whole - before) < LAST_STEP:
            break
    deviation = most if abs(whole) == most else min(ERROR_RATIO * found.deviation, most)
    return Delay(whole, deviation, found.effect, least)


def estimated_delay(evidence: LogEvidence, fit: Fit, inverse: Array, student: Student, lags: bool = False) -> Delay:
    """Delay of all torques, along with the parameters and lags of friction; deviation by blocks or noise that lasts."""
    # Measured rates have noise, which least squares on them takes for knowledge of the delay: too short, too sure. The
    # rates of the fit's own torques are their instrument.
    rows, used = evidence.fitted_rows(fit.settings), evidence.counted(fit.settings)
    weight, predicted = used / fit.deviations**2, rows.regressor @ fit.x
    columns, inverse = _with_lags(evidence, rows, weight, inverse) if lags else (rows.regressor, inverse)
    (effect, changed), (_, instrument) = (
        _beside_parameters(rate, columns, weight, inverse) for rate in (rows.change, _rate(rows, predicted))
    )
    error = predicted - rows.torque
    whole = float((weight * instrument * changed).sum())
    if whole <= 0.0:
        return Delay(0.0, np.inf, effect)
    value = -float((weight * instrument * error).sum()) / whole
    left, Y = np.where(used, error + value * changed, 0.0), weight * instrument
    sums = np.array([part.sum() for part in np.array_split(Y * left, evidence.blocks)])
    blocks = student.quantile_ratio**2 * len(sums) * float(np.var(sums, ddof=1))
    share = np.count_nonzero(effect) / left.shape[1]
    each = zip(Y.T, left.T, strict=True)
    lasting = sum(lasting_covariance(own[:, None], e, share).item() for own, e in each)
    return Delay(value, float(np.sqrt(max(blocks, lasting))) / whole, effect)


def _with_lags(evidence: LogEvidence, rows: Rows, weight: Array, inverse: Array) -> tuple[Array, Array]:
    """Regressor (n, r, P + r) with the rates of each joint's Coulomb friction, and inverse curvature with them."""
    # Friction that gives way before it slides is late at each joint by a time of its own, and no log is for that.
    names = evidence.mechanism.parameter_names
    own = [names.index(f"{joint.name}.{DriveParameter.COULOMB.value}") for joint in evidence.mechanism.primary_joints]
    lags = np.stack([_rate(rows, rows.regressor[..., c]) for c in own], axis=-1)
    weighted = (weight[..., None] * lags).reshape(-1, len(own))
    across = rows.regressor.reshape(len(weighted), -1).T @ weighted
    taken = inverse @ across
    free = np.linalg.pinv(lags.reshape(weighted.shape).T @ weighted - across.T @ taken, hermitian=True)
    whole = np.block([[inverse + taken @ free @ taken.T, -taken @ free], [-free @ taken.T, free]])
    return np.concatenate([rows.regressor, lags], axis=-1), whole


def _beside_parameters(rate: Array, Y: Array, weight: Array, inverse: Array) -> tuple[Array, Array]:
    """Parameters (P,) that take up rates (n, r) of torques, and what they leave of them, with the sign turned."""
    effect = inverse @ np.einsum("njp,nj->p", Y, weight * rate)
    return effect, Y @ effect - rate


def _rate(rows: Rows, torque: Array) -> Array:
    """Rates (n, r) of torques at rows, 0 where a log has no row beside."""
    step = np.diff(rows.time, prepend=np.nan, append=np.nan)
    period = float(np.nanmedian(step))
    inner = (np.abs(step[:-1] - period) < 0.1 * period) & (np.abs(step[1:] - period) < 0.1 * period)
    return np.where(inner[:, None], np.gradient(torque, period, axis=0), 0.0)
