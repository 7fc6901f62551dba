"""External torque, and the level that noise passes only at a stated rate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.control.adaptation import two_stage_filter
from adaptctl.control.adaptation.composite import residual, validate_cutoff
from adaptctl.control.adaptation.doubt import MAX_NOISE_RISE, SLACK
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.symmetric import joined
from adaptctl.control.adaptation.two_stage_filter import FilteredPrediction, FilteredTwice
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, Tunable, absolute, clip, exp, maximum, minimum, sqrt, where

HOUR = 3600.0
NOISE_MEMORY = 60.0
"""s over which squares of external torques are averaged"""
MEMORY_SHARE, MIN_WINDOW = 0.25, 0.1
"""share of a joint's time over which they are averaged at first; s of it below which no square is cut"""
SETTLING = 4.0
"""time constants of the filters after which a joint that stood or turned is one that moves"""
CREEP = 4.0
"""times `min_speed`, below which a joint creeps: friction there is in no model"""
KINDS = 3
"""kinds of motion with a noise of their own: fast, creeping, and standing or turning"""
OFTEN, SELDOM = 1.0 / 3.0, 1.0 / 60.0
"""1/s, rates at which noise passes the two probing levels"""
PROBE_GAIN, MIN_PROBE_GAIN, MAX_PROBE_GAIN = 2.0, 2e-3, 0.2
"""relative rise of a probing level that is passed, over what is best near its end; its least and greatest value"""
PASSED, BACK = 1e9, 0.5
"""size that stands for a probing level that was passed, and share of the level below which it may be passed again"""
MIN_RISE = 0.5
"""least difference of the squares of both probing levels, in noise: a Gaussian variable has 6"""
MIN_RISE_TIME = 2.0
"""s in which a rise of the covariance becomes usual at least"""
MIN_NOISE = 1e-3
"""least mean square of an external torque, relative to that of the stated torque error"""
MAX_SQUARE = 9.0
"""square of a torque over the noise above which it counts as this much: a push must not pass for noise"""
MAX_TAIL = 20.0
"""greatest exponent of a level that few torques were seen for"""


class Touch(NamedTuple):
    """
    State of `ExternalTorque`.

    Parameters
    ----------
    torque : ndarray
        External torque (r,) on the arm in N m (N), positive where it drives the joint forwards.
    level : ndarray
        Alarm level (r,) in N m (N): a torque above it is a touch.
    noise : ndarray
        Mean squares (3 r,) in N^2 m^2: of joints that move fast, creep, and stand or turn.
    seen : ndarray
        Times (3 r,) in s over which they were averaged.
    usual : ndarray
        Squares (r,) in N^2 m^2 that the estimate's covariance lets expect, and seldom more.
    probes : ndarray
        Levels (2 r,) over the noise that it passes once in 3 s, and once in 60 s.
    size : ndarray
        External torques over the noise for both probing levels (2 r,); 1e9 once one was passed, until it is below half.
    moving : ndarray
        Time (r,) in s for which each joint has moved.
    filtered : FilteredTwice
        State of the filters.

    Examples
    --------
    >>> learning = adaptctl.control.GuardedLearning(np.full(6, 0.1))
    >>> feeling = adaptctl.control.with_external_torque(adaptctl.SlotineLi(model, 5.0, 4.0, learning))
    >>> feeling.init(p, v).law_state.touch.torque
    array([0., 0.])
    """

    torque: Any
    level: Any
    noise: Any
    seen: Any
    usual: Any
    probes: Any
    size: Any
    moving: Any
    filtered: FilteredTwice


class Missed(NamedTuple):
    """One period's external torques (r,), what the covariance explains of their squares (r,), weights, and doubt."""

    torque: Column
    form: Column
    weights: Column
    alarmed: Any


@dataclass(frozen=True, eq=False)
class ExternalTorque(Tunable):
    r"""
    Observer of external torques beside the learning law, with alarm levels for a stated rate of false alarms.

    Parameters
    ----------
    cutoff : float, default 60.0
        Corner frequency in rad/s of two equal low-pass filters. At 60 half of a sudden torque is seen after 28 ms;
        noise grows with it.
    alarms_per_hour : float, default 1.0
        False alarms of the whole arm in an hour.

    Raises
    ------
    InputError
        If a number is not positive.

    Notes
    -----
    .. math::

        \hat\tau_e=W\hat\beta-F[\tau],\qquad l_i^2=z_i^2\,(\sigma_i^2+\Delta_i),

    with filtered torques F, their regressor W and the estimate that the law trusts: the generalised momentum observer
    [1]_ on learned parameters. :math:`\sigma_i^2` is the mean square, and :math:`\Delta_i` what :math:`w_i^\top Pw_i`
    of the covariance P is above what is usual. The rate at which Gaussian noise passes a level falls as
    :math:`e^{-z^2/2}` [2]_: the level z of the stated rate is on a line, in :math:`z^2` over the rate's logarithm,
    through two that the arm's own noise passes once in 3 s and in 60 s. All are measured as it moves,
    :math:`\sigma_i` apart for joints that are fast, that creep, and that stand or turn.

    References
    ----------
    .. [1] De Luca, Albu-Schaeffer, Haddadin and Hirzinger, IEEE/RSJ Int. Conf. Intelligent Robots and Systems, 2006.
    .. [2] Rice, Bell System Technical Journal, 1945.

    Examples
    --------
    >>> learning = adaptctl.control.GuardedLearning(
    ...     np.full(6, 0.1), external_torque=adaptctl.control.ExternalTorque(alarms_per_hour=0.1)
    ... )
    >>> learning.external_torque.cutoff
    60.0
    """

    tunable = ("cutoff",)

    cutoff: float = 60.0
    alarms_per_hour: float = 1.0

    def __post_init__(self) -> None:
        positive_number(self.cutoff, "external torque: cutoff: expected a positive number in rad/s")
        positive_number(self.alarms_per_hour, "external torque: alarms_per_hour: expected a positive number in 1/h")

    def validate(self, control_period: float) -> None:
        """
        Raise an error if the filters are too fast for the control period.

        Parameters
        ----------
        control_period : float
            Control period in s.

        Raises
        ------
        InputError
            If the cutoff exceeds 1 divided by the control period.
        """
        validate_cutoff(self.cutoff, control_period, "external torque")

    def start(self, model: ReducedModel, q: Array, v: Array, control_period: float) -> Touch:
        """
        Return the state before the first control period.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters and r primary joints.
        q, v : ndarray
            Positions (..., n) in rad (m) of the n joints of the spanning tree, and velocities (..., r) of the primary
            joints in rad/s (m/s).
        control_period : float
            Control period in s.

        Returns
        -------
        Touch
            State without torques.
        """
        r = model.mechanism.dof
        none, each = np.zeros(r), np.zeros(KINDS * r)
        probes = np.sqrt(2.0 * np.log(self.cutoff / (math.pi * np.array([OFTEN, SELDOM]))).clip(1.0))
        filtered = two_stage_filter.start(model, q, v, self.cutoff, control_period)
        return Touch(none, none, each, each, none, np.repeat(probes, r), np.zeros(2 * r), none, filtered)

    def _joint(self, i: int, kind: Any, missed: Missed, T: float, touch: Touch) -> tuple[Any, ...]:
        """Level, noise and its time by kind, probing levels, and torque over noise of a joint."""
        r, torque, form = len(missed.torque), missed.torque[i], missed.form[i]
        noises, times = ([kept[c * r + i] for c in range(KINDS)] for kept in (touch.noise, touch.seen))
        before, age = _chosen(kind, noises), _chosen(kind, times) + T
        window = minimum(maximum(MEMORY_SHARE * age, T), NOISE_MEMORY)
        time = reduce(add, times)
        usual = _usual(touch.usual[i], form, time, T)
        square, more = torque * torque, maximum(form - usual, 0.0)
        least = MIN_NOISE / missed.weights[i]
        most = where(missed.alarmed > 0.0, MAX_NOISE_RISE, MAX_SQUARE) * (before + least)
        square = where(window > MIN_WINDOW, minimum(square, most), square)
        noise = before + (T / window) * (square - before)
        size = absolute(torque) / sqrt(noise + more + least)
        learns = where(missed.alarmed > 0.0, 0.0, where(window > MIN_WINDOW, 1.0, 0.0))
        passed = (size, learns, time, T)
        rates = ((c * r + i, rate) for c, rate in enumerate((OFTEN, SELDOM)))
        probes, sizes = zip(*(_probed(touch.probes[k], touch.size[k], rate, passed) for k, rate in rates), strict=True)
        squared = self._squared(probes[0], probes[1], r)
        hidden = where(kind > 1.5, SLACK * SLACK, 0.0) / missed.weights[i]
        reached = sqrt(self._spread(squared, window) * (noise + least) + squared * more + hidden)
        return reached, _replaced(kind, noises, noise), _replaced(kind, times, age), usual, probes, sizes

    def _squared(self, often: Scalar, seldom: Scalar, r: int) -> Scalar:
        """Square of the level over the noise that it passes at the stated rate."""
        rise = maximum(seldom * seldom - often * often, MIN_RISE)
        rarer = math.log(SELDOM * HOUR * r / self.alarms_per_hour) / math.log(OFTEN / SELDOM)
        return maximum(seldom * seldom + rarer * rise, 1.0)

    def _spread(self, squared: Scalar, window: Scalar) -> Scalar:
        """Factor for a mean square of few torques: a Student variable's tail for a Gaussian one's."""
        count = maximum((0.5 * self.cutoff) * window, squared * (1.0 / MAX_TAIL))
        return count * (exp(squared / count) - 1.0)


def beyond(touch: Touch) -> list[Any]:
    """Conditions, one per joint, that are true where the external torque is above its level."""
    return [absolute(torque) > level for torque, level in zip(touch.torque, touch.level, strict=True)]


def predicted(observer: ExternalTorque, model: ReducedModel, period: Period, touch: Touch) -> FilteredPrediction:
    """Torques and regressor through the observer's filters."""
    return two_stage_filter.predicted(model, period, touch.filtered, observer.cutoff)


def felt(
    observer: ExternalTorque | None,
    prediction: FilteredPrediction | None,
    known: tuple[Column, Column, Column, Any],
    period: Period,
    min_speed: Sequence[Any],
    touch: Any,
) -> Any:
    """State of an observer, if there is one, by what is known: estimate, forms and weights (r,), and alarm in s."""
    if observer is None or prediction is None:
        return touch
    trusted, form, weights, alarm = known
    missed = Missed(residual(prediction.rows, trusted, prediction.torque), form, weights, alarm)
    return judged(observer, prediction, missed, period, min_speed, touch)


def judged(
    observer: ExternalTorque,
    prediction: FilteredPrediction,
    missed: Missed,
    period: Period,
    min_speed: Sequence[Any],
    touch: Touch,
) -> Touch:
    """State after a period whose torques are missed, with the noise that they show."""
    speeds = list(zip(map(absolute, prediction.speed), min_speed, strict=True))
    slow = [speed < least for speed, least in speeds]
    moving = Column(where(still, 0.0, m + period.period) for still, m in zip(slow, touch.moving, strict=True))
    creeps = [where(speed < CREEP * least, 1.0, 0.0) for speed, least in speeds]
    kinds = [where(m > SETTLING / observer.cutoff, x, 2.0) for m, x in zip(moving, creeps, strict=True)]
    joints = [observer._joint(i, kind, missed, period.period, touch) for i, kind in enumerate(kinds)]
    level, noise, seen, usual, probes, sizes = zip(*joints, strict=True)
    by_kind = (Column(part[c] for part in parts) for parts in (noise, seen) for c in range(KINDS))
    noises, times = _joined_in_groups(by_kind, KINDS)
    both = (joined([Column(pair[c] for pair in pairs) for c in range(2)]) for pairs in (probes, sizes))
    rest: Any = Column(usual), *both, moving, prediction.after
    return Touch(missed.torque, Column(level), noises, times, *rest)


def _usual(before: Any, form: Any, time: Any, T: float) -> Any:
    """Value that a form seldom exceeds, which rises faster than it falls."""
    window = minimum(maximum(MEMORY_SHARE * time, T), NOISE_MEMORY)
    pace = where(form > before, T / maximum(0.1 * window, MIN_RISE_TIME), T / window)
    return before + pace * (form - before)


def _chosen(kind: Any, values: Sequence[Any]) -> Any:
    """Value of a kind of motion."""
    fast, creeping, still = values
    return where(kind > 1.5, still, where(kind > 0.5, creeping, fast))


def _replaced(kind: Any, values: Sequence[Any], new: Any) -> list[Any]:
    """Values with a new one for a kind of motion."""
    return [where(absolute(kind - float(c)) < 0.5, new, value) for c, value in enumerate(values)]


def _probed(probe: Any, before: Any, rate: float, passed: tuple[Any, Any, Any, float]) -> tuple[Any, Any]:
    """Probing level that noise passes at a rate, by stochastic approximation, and the size before the next period."""
    now, learns, time, T = passed
    gain = clip(PROBE_GAIN / (maximum(probe * probe, 1.0) * (1.0 + rate * time)), MIN_PROBE_GAIN, MAX_PROBE_GAIN)
    rises = where(before < probe, where(now < probe, 0.0, 1.0), 0.0)
    probe = probe * (1.0 + learns * gain * (rises - rate * T))
    # A torque that goes on rising must not pass again the level that it has just raised.
    within = where(now < BACK * probe, now, PASSED)
    return probe, where(maximum(before, PASSED * rises) < PASSED, now, within)


def _joined_in_groups(columns: Iterable[Column], size: int) -> list[Column]:
    """Columns joined in groups of some."""
    given = list(columns)
    return [joined(given[first : first + size]) for first in range(0, len(given), size)]
