"""Error feedback and margins."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, finite_number, positive_number, positive_period, real_number, whole_number
from adaptctl.errors import GainError, InputError, printable
from adaptctl.optional_packages import needed

if TYPE_CHECKING:
    import control

REAL_POLE_TOLERANCE = 0.02  # distance that discretisation may move two equal real poles into the complex plane
MIN_NORMAL = float(np.finfo(np.float64).tiny)  # smaller numbers have fewer digits
FREQUENCIES = 1000
MAX_DELAY = 100  # periods; loops of so many states take seconds
MIN_FREQUENCY_RATIO = 1e-6  # of half the sampling rate


@dataclass(frozen=True)
class ErrorFeedback:
    """
    Linear feedback of one joint's error, with the torque held over the control period.

    Parameters
    ----------
    stiffness : float
        Acceleration per unit of error in 1/s^2.
    rate : float
        Acceleration per unit of error rate in 1/s.
    control_period : float
        Time in s for which a torque is held.

    Raises
    ------
    InputError
        If a number is not positive and finite.
    GainError
        If the sampled loop would be unstable.

    Notes
    -----
    The plant is a double integrator [1]_.

    References
    ----------
    .. [1] Astrom and Wittenmark, Computer-Controlled Systems, 1997, chapter 4.

    Examples
    --------
    >>> feedback = adaptctl.control.ErrorFeedback.from_bandwidth(10.0, 1.0, period)
    >>> round(feedback.bandwidth, 2), feedback.is_cascade
    (9.95, True)
    """

    stiffness: float
    rate: float
    control_period: float

    def __post_init__(self) -> None:
        _validate_period(self.control_period)
        stiffness, rate = (real_number(getattr(self, name), f"gains: {name}") for name in ("stiffness", "rate"))
        if not (0.0 < stiffness < math.inf and 0.0 < rate < math.inf):
            raise InputError(f"gains: expected positive numbers, got {stiffness:g} 1/s^2 and {rate:g} 1/s")
        if (
            self.rate * self.control_period >= 2.0 or self.stiffness * self.control_period >= 2.0 * self.rate
        ):  # Jury (1961)
            raise GainError(
                f"gains: {self.stiffness:.3g} 1/s^2 and {self.rate:.3g} 1/s are unstable at a control period of "
                f"{self.control_period:g} s. The rate must be at most {2.0 / self.control_period:.4g} 1/s, the "
                "stiffness at most twice the rate divided by the period"
            )

    @classmethod
    def from_bandwidth(cls, bandwidth: float, damping_ratio: float, control_period: float) -> ErrorFeedback:
        """
        Design the feedback by bandwidth and damping ratio.

        Parameters
        ----------
        bandwidth : float
            Undamped natural frequency in rad/s.
        damping_ratio : float
            Damping ratio; 1 is critical.
        control_period : float
            Time in s for which a torque is held.

        Returns
        -------
        ErrorFeedback
            Feedback with which the sampled error decays as that of the second-order loop.

        Raises
        ------
        InputError
            If a number is not positive and finite, or gains are beyond double precision.

        Examples
        --------
        >>> feedback = adaptctl.control.ErrorFeedback.from_bandwidth(10.0, 0.7, period)
        >>> round(feedback.damping_ratio, 1)
        0.7
        """
        given = real_number(bandwidth, "bandwidth"), real_number(damping_ratio, "damping ratio")
        if not all(0.0 < number < math.inf for number in given):
            raise InputError(f"expected a positive bandwidth and damping ratio, got {bandwidth} and {damping_ratio}")
        _validate_period(control_period)
        try:
            return cls.from_poles([bandwidth * root for root in _roots(damping_ratio)], control_period)
        except InputError as error:
            raise InputError(
                f"bandwidth of {bandwidth:g} rad/s and damping ratio of {damping_ratio:g}: the gains exceed double "
                f"precision; give a bandwidth closer to {1.0 / control_period:g} 1/s, and a ratio closer to 1"
            ) from error

    @classmethod
    def from_poles(cls, poles: Sequence[complex], control_period: float) -> ErrorFeedback:
        """
        Design the feedback by two poles.

        Parameters
        ----------
        poles : sequence of complex
            Two continuous-time poles in 1/s, real or conjugate, with negative real parts.
        control_period : float
            Time in s for which a torque is held.

        Returns
        -------
        ErrorFeedback
            Feedback with which the sampled error decays with these poles.

        Raises
        ------
        InputError
            If the poles are not such a pair, or the period not positive and finite.

        Examples
        --------
        >>> feedback = adaptctl.control.ErrorFeedback.from_poles([-6 + 2j, -6 - 2j], period)
        >>> bool(np.allclose(sorted(z.imag for z in feedback.poles), [-2.0, 2.0]))
        True
        """
        try:
            given = np.asarray(poles, dtype=np.complex128)
        except (TypeError, ValueError, OverflowError):
            given = np.empty(0, dtype=np.complex128)  # no numbers: refused as not two
        if (
            given.shape != (2,)
            or not np.all(np.isfinite(given) & (given.real <= -MIN_NORMAL))
            or not _is_conjugate(given)
        ):
            raise InputError(
                f"poles: expected two in the left half-plane, real or conjugate, got {printable(repr(poles))}"
            )
        _validate_period(control_period)
        with np.errstate(over="ignore", invalid="ignore"):  # what is too large is refused as a gain
            first, second = (
                -np.expm1(given * control_period) / control_period
            )  # 1 - z, not z: slow poles keep their digits
        both = float((first * second).real)
        return cls(both, float((first + second).real) - 0.5 * both * control_period, control_period)

    @classmethod
    def from_lqr(cls, position: float, velocity: float, effort: float, control_period: float) -> ErrorFeedback:
        """
        Design the feedback as a linear-quadratic regulator.

        Parameters
        ----------
        position : float
            Weight of the squared error in 1/rad^2 (1/m^2); by Bryson's rule 1 divided by the square of the largest
            acceptable error.
        velocity : float
            Weight of the squared error rate in s^2/rad^2 (s^2/m^2).
        effort : float
            Weight of the squared acceleration in s^4/rad^2 (s^4/m^2).
        control_period : float
            Time in s for which a torque is held.

        Returns
        -------
        ErrorFeedback
            Feedback of the discrete-time regulator with infinite horizon.

        Raises
        ------
        InputError
            If a weight is out of range, weights are too far apart, or the period is not positive.

        Examples
        --------
        >>> feedback = adaptctl.control.ErrorFeedback.from_lqr(4096.0, 0.0, 1.0, period)
        >>> 7.0 < feedback.bandwidth < 9.0
        True
        """
        for name, weight in (("position", position), ("effort", effort)):
            positive_number(weight, f"weights: {name}: expected a positive number")
        finite_number(velocity, "weights: velocity")
        import control

        _validate_period(control_period)
        natural = (position / effort) ** 0.25  # 1/s: in this unit of time all weights are near 1
        step = natural * control_period
        A, B = np.array([[1.0, step], [0.0, 1.0]]), np.array([[0.5 * step**2], [step]])
        Q, R = np.diag([1.0, velocity / position * natural**2]), np.eye(1)
        try:
            gains = np.asarray(control.dlqr(A, B, Q, R)[0], dtype=np.float64).ravel()
        except (ValueError, TypeError, np.linalg.LinAlgError) as error:  # python-control's errors are of either kind
            raise InputError(
                f"weights: too different in size for a control period of {control_period:g} s ({error})"
            ) from error
        return cls(float(gains[0]) * natural**2, float(gains[1]) * natural, control_period)

    @property
    def sampled_poles(self) -> tuple[complex, complex]:
        """Two poles in the z plane, the greater or upper first."""
        k, c = self.stiffness * self.control_period**2, self.rate * self.control_period
        half, product = 1.0 - 0.5 * c - 0.25 * k, 1.0 - c + 0.5 * k
        root = cmath.sqrt(half**2 - product)
        return half + root, half - root

    @property
    def poles(self) -> tuple[complex, complex]:
        """Two continuous-time poles, 1/s."""
        first, second = (cmath.log(pole or MIN_NORMAL) / self.control_period for pole in self.sampled_poles)
        return first, second

    def with_bandwidth_factor(self, factor: float) -> ErrorFeedback:
        """
        Return the feedback with all poles multiplied by a factor.

        Parameters
        ----------
        factor : float
            Factor above 0 without a unit, by which both poles are multiplied.

        Returns
        -------
        ErrorFeedback
            Feedback at the same control period.

        Raises
        ------
        InputError
            If the factor is not positive and finite, or gains are beyond double precision.

        Examples
        --------
        >>> feedback = adaptctl.control.ErrorFeedback.from_bandwidth(10.0, 1.0, period)
        >>> round(feedback.with_bandwidth_factor(2.0).bandwidth, 1)
        19.8
        """
        positive_number(factor, "factor: expected a positive finite number", 0.0, math.inf)
        first, second = (factor * pole for pole in self.poles)
        mean = 0.5 * (first + second).real  # log puts the poles of a negative pair on one side of its cut
        conjugate = abs(first.imag) > 0.0
        poles = [first, first.conjugate()] if conjugate else [first, 2.0 * mean - first]
        try:
            return self.from_poles(poles, self.control_period)
        except InputError as error:
            raise InputError(f"factor: {factor:g} gives gains that exceed double precision ({error})") from error

    @property
    def bandwidth(self) -> float:
        """Undamped natural frequency in rad/s."""
        return math.sqrt(self.stiffness)

    @property
    def damping_ratio(self) -> float:
        """Damping ratio of the two poles, without a unit."""
        return self.rate / (2.0 * self.bandwidth)

    @property
    def is_cascade(self) -> bool:
        """True if the two poles count as real, within a tolerance that grows with the control period."""
        return 1.0 - 1.0 / self.damping_ratio**2 >= -REAL_POLE_TOLERANCE - self.bandwidth * self.control_period

    @property
    def cascaded(self) -> tuple[float, float]:
        """Decay rates in 1/s of two real poles, slower first; `InputError` for complex ones."""
        squared = 1.0 - 1.0 / self.damping_ratio**2
        if not self.is_cascade:
            raise InputError(
                "damping ratio: the error of Slotine and Li's law decays with two real poles, which need a ratio of "
                f"at least 1, got {self.damping_ratio:.3g}; use computed torque, or more damping"
            )
        root = math.sqrt(max(squared, 0.0))
        return 0.5 * self.rate * (1.0 - root), 0.5 * self.rate * (1.0 + root)

    def loop(self, delay: int = 0) -> control.StateSpace:
        """
        Return the open loop, cut at the torque.

        Parameters
        ----------
        delay : int, default 0
            Delay in whole control periods, 0 to 100. Zero for a torque that acts at once.

        Returns
        -------
        control.StateSpace
            Discrete-time system from commanded to fed-back acceleration, for negative feedback.

        Raises
        ------
        InputError
            If the delay is out of range.

        Examples
        --------
        >>> feedback = adaptctl.control.ErrorFeedback.from_bandwidth(10.0, 1.0, period)
        >>> feedback.loop(delay=2).nstates
        4
        """
        import control

        whole_number(delay, "delay in periods", 0, MAX_DELAY)
        A, B = _held_double_integrator()
        C = np.array([[self.stiffness * self.control_period**2, self.rate * self.control_period]])
        opened = control.ss(A, B, C, 0.0, self.control_period)
        return opened if delay == 0 else opened * _delay(delay, self.control_period)


def _validate_period(control_period: float) -> None:
    """Raise `InputError` for no or too long a period; gains are exact however short it is."""
    positive_period(control_period, "control period", least=0.0)


def _roots(damping_ratio: float) -> tuple[complex, complex]:
    """Roots of s^2 + 2 zeta s + 1, without cancellation."""
    fast = -damping_ratio - cmath.sqrt(damping_ratio - 1.0) * cmath.sqrt(damping_ratio + 1.0)
    return 1.0 / fast, fast


def _is_conjugate(poles: NDArray[np.complex128]) -> bool:
    """True if real or conjugate, to round-off."""
    poles = poles / np.abs(poles.view(np.float64)).max()
    return bool(abs(poles.sum().imag) + abs(poles.prod().imag) < 1e-9)


def _held_double_integrator() -> tuple[Any, Any]:
    """A and B in units of periods."""
    return np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.5], [1.0]])


def _delay(delay: int, control_period: float) -> control.StateSpace:
    import control

    A = np.eye(delay, k=-1)
    return control.ss(A, np.eye(delay, 1), np.eye(delay)[-1:], 0.0, control_period)


@dataclass(frozen=True)
class Margins:
    """
    Stability margins of a sampled loop.

    Parameters
    ----------
    gain : float
        Factor by which the loop's gain may grow (the inertia fall), infinite without limit.
    gain_reduction : float
        Factor to which the loop's gain may fall (the inertia grow), 0 without limit.
    phase : float
        Least lag in rad that makes the loop unstable, infinite if its gain never crosses 1.
    delay : float
        Least delay in s that makes the loop unstable.
    crossover : float
        Frequency in rad/s at which a delay does so first, NaN without any.

    Examples
    --------
    >>> margins = adaptctl.control.GainDesign.from_bandwidth(arm, 6.0).margins[0]
    >>> margins.gain > 2.0, margins.gain_reduction < 0.5
    (True, True)
    """

    gain: float
    gain_reduction: float
    phase: float
    delay: float
    crossover: float


def margins(loop: control.LTI) -> Margins:
    """
    Compute gain, phase and delay margins of a sampled loop.

    Parameters
    ----------
    loop : control.LTI
        Open loop in discrete time with one input and output, stable with negative feedback, which is not checked.

    Returns
    -------
    Margins
        Smallest margins of gain (a factor, not dB), phase and delay. Crossings at half the sampling rate count, unlike
        in `control.stability_margins`.

    Raises
    ------
    InputError
        If the loop has no sampling time, or more than one input or output.

    Examples
    --------
    >>> feedback = adaptctl.control.ErrorFeedback.from_bandwidth(10.0, 1.0, period)
    >>> adaptctl.control.margins(feedback.loop(delay=1)).phase > 1.0
    True
    """
    _validate_sampled(loop)
    angles = np.concatenate((np.geomspace(MIN_FREQUENCY_RATIO * np.pi, np.pi, FREQUENCIES)[:-1], [np.pi]))
    values = np.asarray(loop(np.exp(1j * angles)), dtype=np.complex128)

    def response(angle: float) -> complex:
        return complex(loop(np.exp(1j * angle)))

    real = _crossings(lambda angle: response(angle).imag, angles[:-1], values.imag[:-1])
    turned = [value for value in (*map(response, real), values[-1]) if value.real < 0.0]
    factors = [float(1.0 / abs(value)) for value in turned]
    unit = _crossings(lambda angle: abs(response(angle)) - 1.0, angles, np.abs(values) - 1.0)
    lags = [(_lag(response(angle)), angle) for angle in unit]
    phase = min((lag for lag, _ in lags), default=math.inf)
    delay, crossover = min(((lag / angle, angle) for lag, angle in lags), default=(math.inf, math.nan))
    return Margins(
        gain=min((factor for factor in factors if factor > 1.0), default=math.inf),
        gain_reduction=max((factor for factor in factors if factor <= 1.0), default=0.0),
        phase=phase,
        delay=delay * loop.dt,
        crossover=crossover / loop.dt,
    )


def _validate_sampled(loop: control.LTI) -> None:
    if not loop.ninputs == loop.noutputs == 1:
        raise InputError(f"margins: expected one input and one output, got {loop.ninputs} and {loop.noutputs}")
    if loop.dt is None or loop.dt is True or not loop.dt > 0.0:  # python-control's True is a period that is not stated
        raise InputError(f"margins: expected a sampled loop with its sampling time in s, got dt = {loop.dt}")


def _lag(value: complex) -> float:
    """Lag (rad) to -1, in (0, 2 pi]."""
    lag = math.pi + math.atan2(value.imag, value.real)
    return lag if lag > 0.0 else lag + 2.0 * math.pi


def _crossings(function: Callable[[float], float], angles: Array, values: Array) -> list[float]:
    """Angles at which a function changes sign."""
    places = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    with needed("margins"):
        from scipy.optimize import brentq  # takes longer to load than many an experiment that never needs it

    return [float(brentq(function, angles[k], angles[k + 1], xtol=1e-15, rtol=1e-14)) for k in places]
