"""Feedback of a joint's error, designed for a torque that is held over the control period, and a loop's margins."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from adaptctl.arrays import Array, positive_number, real_number, whole_number
from adaptctl.control.gains.sampling_ratio import validate_period
from adaptctl.errors import GainError, InputError, printable

if TYPE_CHECKING:
    import control

ROUNDING = 0.02
"""Distance that discretisation may carry two equal real poles into the complex plane before they count as complex."""
TINY = float(np.finfo(np.float64).tiny)
"""Below this numbers have fewer digits."""
POINTS = 1000
LOWEST = 1e-6
"""The lowest frequency looked at, over half the sampling rate."""


@dataclass(frozen=True)
class ErrorFeedback:
    """Linear feedback of one joint's error e (rad, m for a prismatic joint): the acceleration e'' = -stiffness e - rate
    e' of the error, held over `period` (s). Primes are derivatives in time.

    `stiffness` is in 1/s^2, `rate` in 1/s; the joint's inertia, taken as known, turns the acceleration into a torque.
    The class methods find both gains from a bandwidth, from poles or as the linear-quadratic regulator, for the double
    integrator behind a zero-order hold (Astrom and Wittenmark 1997, chapter 4), with python-control. Raises
    `InputError` unless all three numbers are positive and finite, and `GainError` where the sampled loop would not be
    stable, that is, where one of its poles has a magnitude of 1 or more.
    """

    stiffness: float
    rate: float
    control_period: float

    def __post_init__(self) -> None:
        validate_period(self.control_period)
        stiffness, rate = (real_number(getattr(self, name), f"gains: {name}") for name in ("stiffness", "rate"))
        if not (0.0 < stiffness < math.inf and 0.0 < rate < math.inf):
            raise InputError(f"gains: expected positive numbers, got {stiffness:g} 1/s^2 and {rate:g} 1/s")
        if (
            self.rate * self.control_period >= 2.0 or self.stiffness * self.control_period >= 2.0 * self.rate
        ):  # Jury (1961)
            raise GainError(
                f"gains: {self.stiffness:.3g} 1/s^2 and {self.rate:.3g} 1/s cannot be carried by a hold of "
                f"{self.control_period:g} s: the rate can be at most {2.0 / self.control_period:.4g} 1/s, the "
                f"stiffness at most "
                f"twice the rate over the period"
            )

    @classmethod
    def from_bandwidth(cls, bandwidth: float, damping_ratio: float, control_period: float) -> ErrorFeedback:
        """Linear error feedback of one joint, an `ErrorFeedback`, designed by the poles of a second-order loop: omega
        is the `bandwidth` (rad/s), zeta the `damping_ratio` (no unit; 1 is critical). Found are the gains `stiffness`
        (1/s^2) and `rate` (1/s) of e'' = -stiffness e - rate e', primes being derivatives in time of the joint's error
        e.

        The plant is the double integrator from acceleration to e, and the acceleration is held over `period` T_c (s).
        The closed loop, sampled every T_c, has the poles exp(s T_c) for the two roots s of s^2 + 2 zeta omega s +
        omega^2 = 0, so that at its samples e decays as in continuous time with the poles s. As T_c goes to zero the
        gains go to omega^2 and 2 zeta omega. Raises `InputError` unless all three numbers are positive and finite, and
        where such poles or gains are beyond double precision, as for a bandwidth of 1e-200 rad/s.
        """
        given = real_number(bandwidth, "bandwidth"), real_number(damping_ratio, "damping ratio")
        if not all(0.0 < number < math.inf for number in given):
            raise InputError(f"expected a positive bandwidth and damping ratio, got {bandwidth} and {damping_ratio}")
        validate_period(control_period)
        try:
            return cls.from_poles([bandwidth * root for root in _roots(damping_ratio)], control_period)
        except InputError as error:
            raise InputError(
                f"bandwidth of {bandwidth:g} rad/s and damping ratio of {damping_ratio:g}: gains beyond double "
                f"precision: expected a bandwidth nearer to 1 over the period of {control_period:g} s, a ratio nearer "
                f"to 1"
            ) from error

    @classmethod
    def from_poles(cls, poles: Sequence[complex], control_period: float) -> ErrorFeedback:
        """Linear error feedback of one joint, an `ErrorFeedback`, designed by two continuous-time `poles` (1/s), real
        or a conjugate pair with negative real parts. Found are the gains `stiffness` (1/s^2) and `rate` (1/s) of e'' =
        -stiffness e - rate e', primes being derivatives in time of the joint's error e.

        The plant is the double integrator from acceleration to e, and the acceleration is held over `period` T_c (s).
        The closed loop, sampled every T_c, has the poles exp(pole T_c), so that at its samples e decays as in
        continuous time with the given poles. Raises `InputError` for other poles, and for a period that is not positive
        and finite.
        """
        try:
            given = np.asarray(poles, dtype=np.complex128)
        except (TypeError, ValueError, OverflowError):
            given = np.empty(0, dtype=np.complex128)  # no numbers: refused as not two
        if given.shape != (2,) or not np.all(np.isfinite(given) & (given.real <= -TINY)) or not _is_conjugate(given):
            raise InputError(
                f"poles: expected two in the left half-plane, real or conjugate, got {printable(repr(poles))}"
            )
        validate_period(control_period)
        with np.errstate(over="ignore", invalid="ignore"):  # what is too large is refused as a gain
            first, second = (
                -np.expm1(given * control_period) / control_period
            )  # 1 - z, not z: slow poles keep their digits
        both = float((first * second).real)
        return cls(both, float((first + second).real) - 0.5 * both * control_period, control_period)

    @classmethod
    def from_lqr(cls, position: float, velocity: float, effort: float, control_period: float) -> ErrorFeedback:
        """Linear error feedback of one joint, an `ErrorFeedback`, by the discrete-time linear-quadratic regulator with
        an infinite horizon. It minimises the sum of `position` e^2 + `velocity` e'^2 + `effort` e''^2 over all samples
        of the joint's error e (rad, m if prismatic), one each `period` (s), primes being derivatives in time.

        The plant is the double integrator from the acceleration e'', held over a period, to e. The weights are in
        1/rad^2, s^2/rad^2 and s^4/rad^2 (m for rad); only their ratios count. By Bryson's rule each is one over the
        square of the largest value that is acceptable. Raises `InputError` for a `position` or `effort` that is not
        positive, a negative `velocity`, weights too far apart for the Riccati equation to be solved at this period, and
        a period that is not positive.
        """
        for name, weight in (("position", position), ("velocity", velocity), ("effort", effort)):
            real_number(weight, f"weights: {name}")
        if not (position > 0.0 and velocity >= 0.0 and effort > 0.0 and math.isfinite(position + velocity + effort)):
            raise InputError(
                f"weights: expected positive ones of position and effort, and of velocity at least 0, got {position}, "
                f"{velocity}, {effort}"
            )
        import control

        validate_period(control_period)
        natural = (position / effort) ** 0.25  # 1/s: in this unit of time all weights are near 1
        step = natural * control_period
        A, B = np.array([[1.0, step], [0.0, 1.0]]), np.array([[0.5 * step**2], [step]])
        Q, R = np.diag([1.0, velocity / position * natural**2]), np.eye(1)
        try:
            gains = np.asarray(control.dlqr(A, B, Q, R)[0], dtype=np.float64).ravel()
        except (ValueError, TypeError, np.linalg.LinAlgError) as error:  # python-control's errors are of either kind
            raise InputError(
                f"weights: too far apart for a control period of {control_period:g} s ({error})"
            ) from error
        return cls(float(gains[0]) * natural**2, float(gains[1]) * natural, control_period)

    @property
    def sampled_poles(self) -> tuple[complex, complex]:
        """The two poles in the z plane, without a unit, of a joint's error loop, sampled once a control period with the
        acceleration held in between and no delay. The greater comes first or, of a conjugate pair, that of positive
        imaginary part."""
        k, c = self.stiffness * self.control_period**2, self.rate * self.control_period
        half, product = 1.0 - 0.5 * c - 0.25 * k, 1.0 - c + 0.5 * k
        root = cmath.sqrt(half**2 - product)
        return half + root, half - root

    @property
    def poles(self) -> tuple[complex, complex]:
        """The two continuous-time poles (1/s) that correspond to the sampled error loop: log(z)/T_c, T_c being the
        control period and z each of the loop's two poles in the z plane, 2.2e-308 for a z of 0, such as that of a loop
        at rest after two samples. A continuous-time loop with these poles has the same samples. They are in the order
        of z, the greater first or, of a conjugate pair, that of positive imaginary part."""
        first, second = (cmath.log(pole or TINY) / self.control_period for pole in self.sampled_poles)
        return first, second

    def with_bandwidth_factor(self, factor: float) -> ErrorFeedback:
        """Linear error feedback, an `ErrorFeedback`, at the same control period, whose continuous-time poles (1/s) are
        those of this one times a `factor` (no unit). Raises `InputError` unless the factor is positive and finite, and
        where it leaves gains beyond double precision."""
        positive_number(factor, "factor: expected a positive finite number")
        first, second = (factor * pole for pole in self.poles)
        mean = 0.5 * (first + second).real  # log puts the poles of a negative pair on one side of its cut
        conjugate = abs(first.imag) > 0.0
        poles = [first, first.conjugate()] if conjugate else [first, 2.0 * mean - first]
        try:
            return self.from_poles(poles, self.control_period)
        except InputError as error:
            raise InputError(f"factor: {factor:g} leaves gains beyond double precision ({error})") from error

    @property
    def bandwidth(self) -> float:
        """Undamped natural frequency (rad/s) of the continuous-time error loop e'' = -stiffness e - rate e': the square
        root of the stiffness (1/s^2). e is the joint's error, primes are derivatives in time, and the rate is in
        1/s."""
        return math.sqrt(self.stiffness)

    @property
    def damping_ratio(self) -> float:
        """Damping ratio, without a unit, of the continuous-time error loop e'' = -stiffness e - rate e': rate/(2
        sqrt(stiffness)), 1 for two equal real poles. e is the joint's error, primes are derivatives in time, the
        stiffness is in 1/s^2 and the rate in 1/s."""
        return self.rate / (2.0 * self.bandwidth)

    @property
    def is_cascade(self) -> bool:
        """True if the continuous-time error loop e'' = -stiffness e - rate e' counts as one of two real poles, which is
        a cascade of two first-order loops. The criterion is 1/zeta^2 - 1 <= 0.02 + omega T_c: zeta is the loop's
        damping ratio, omega (rad/s) its bandwidth and T_c (s) the control period, so that a zeta a little below 1, such
        as sampling makes of 1, counts too. e is the joint's error, primes are derivatives in time, stiffness is in
        1/s^2 and rate in 1/s."""
        return 1.0 - 1.0 / self.damping_ratio**2 >= -ROUNDING - self.bandwidth * self.control_period

    @property
    def cascaded(self) -> tuple[float, float]:
        """The decay rates (1/s) of two first-order loops in cascade, slower first, as in Slotine and Li's law: Lambda
        of e' = -Lambda e + s, and K/M of s' = -(K/M) s. There e is the joint's error, s the sliding variable, K the
        damping, M the inertia and a prime a derivative in time.

        Raises `InputError` where the feedback's poles are complex (its property `is_cascade` is False): no cascade of
        first-order loops has these.
        """
        squared = 1.0 - 1.0 / self.damping_ratio**2
        if not self.is_cascade:
            raise InputError(
                f"damping ratio: Slotine and Li's error decays through two first-order lags, which needs a ratio of at "
                f"least 1, got {self.damping_ratio:.3g}; use computed torque, or damp more"
            )
        root = math.sqrt(max(squared, 0.0))
        return 0.5 * self.rate * (1.0 - root), 0.5 * self.rate * (1.0 + root)

    def loop(self, delay: int = 0) -> control.StateSpace:
        """The open loop of one joint's error feedback, cut at the torque and to be closed by negative feedback, as a
        discrete-time python-control system sampled at the control period. Its input is the commanded and its output the
        fed-back acceleration (rad/s^2, m/s^2 if prismatic). `delay` is its delay in whole control periods, none by
        default. Raises `InputError` unless it is a whole number from 0 to 1000."""
        import control

        whole_number(delay, "delay in periods", 0, 1000)
        A, B = _held_double_integrator()
        C = np.array([[self.stiffness * self.control_period**2, self.rate * self.control_period]])
        opened = control.ss(A, B, C, 0.0, self.control_period)
        return opened if delay == 0 else opened * _late(delay, self.control_period)


def _roots(damping_ratio: float) -> tuple[complex, complex]:
    """The two roots s of s^2 + 2 zeta s + 1 = 0, the slower first, without a difference of numbers that are alike."""
    fast = -damping_ratio - cmath.sqrt(damping_ratio - 1.0) * cmath.sqrt(damping_ratio + 1.0)
    return 1.0 / fast, fast


def _is_conjugate(poles: NDArray[np.complex128]) -> bool:
    """True if two poles in the left half-plane are real or a conjugate pair, to round-off."""
    poles = poles / np.abs(poles.view(np.float64)).max()
    return bool(abs(poles.sum().imag) + abs(poles.prod().imag) < 1e-9)


def _held_double_integrator() -> tuple[Any, Any]:
    """Error and error rate over a hold, in periods: the numbers are then near 1, whatever the period."""
    return np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.5], [1.0]])


def _late(delay: int, control_period: float) -> control.StateSpace:
    """The delay z^-delay as a transfer function."""
    import control

    A = np.eye(delay, k=-1)
    return control.ss(A, np.eye(delay, 1), np.eye(delay)[-1:], 0.0, control_period)


@dataclass(frozen=True)
class Margins:
    """Gain, phase and delay margins of one sampled loop, stable when closed. Nothing is checked.

    `gain` is the factor, without a unit, by which the loop's gain may grow (its inertia fall), infinite if it may grow
    without limit; `gain_reduction` is the factor, without a unit, to which it may fall (its inertia grow), 0 if it may
    fall without limit. `phase` is the lag in rad and `delay` the delay in s that the loop bears, the least over all
    frequencies where its gain crosses 1, infinite where it does so nowhere; `crossover` is the frequency in rad/s at
    which a delay makes it unstable first, NaN where there is none.
    """

    gain: float
    gain_reduction: float
    phase: float
    delay: float
    crossover: float


def margins(loop: control.LTI) -> Margins:
    """The gain, phase and delay margins of a `loop`, a `Margins`: gains as factors without a unit (not dB), the phase
    in rad, the delay in s. `loop` is a discrete-time python-control system with one input, one output and its sampling
    time in s. It is open, to be closed by negative feedback, and must then be stable, which is not checked. Raises
    `InputError` for a loop in continuous time or without a stated sampling time, and for one with more inputs or
    outputs.

    Of several crossings the tightest counts: `gain` is the least factor above 1, and `gain_reduction` the largest of at
    most 1, that brings a crossing of the negative real axis to -1; `phase` is the least lag, and `delay` the least lag
    over frequency, which is at the frequency `crossover` (rad/s), of the crossings of gain 1. Without such a crossing
    `gain`, `phase` and `delay` are infinite, `gain_reduction` 0 and `crossover` NaN. Crossings are sought on
    python-control's frequency response from 1e-6 of half the sampling rate up to half the sampling rate, included,
    where a sampled loop often crosses; `control.stability_margins` of version 0.10 looks only below it.
    """
    _validate_sampled(loop)
    angles = np.concatenate((np.geomspace(LOWEST * np.pi, np.pi, POINTS)[:-1], [np.pi]))
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
    """Lag (rad) that turns a value on the unit circle to -1, in (0, 2 pi]."""
    lag = math.pi + math.atan2(value.imag, value.real)
    return lag if lag > 0.0 else lag + 2.0 * math.pi


def _crossings(function: Callable[[float], float], angles: Array, values: Array) -> list[float]:
    """Angles at which a function, known at some, changes its sign."""
    places = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    return [float(brentq(function, angles[k], angles[k + 1], xtol=1e-15, rtol=1e-14)) for k in places]
