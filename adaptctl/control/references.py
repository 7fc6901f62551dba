"""Reference trajectories."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, numbers, real_number
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.compilation import compile_function
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.errors import InputError
from adaptctl.optional_packages import needed
from adaptctl.scalars import Column, Scalar, clip, cos, sin, where

SPLINE_DEGREE = 5
MAX_END_SPEEDUP = 2.0
"""speed of a spline at its ends over that of its first or last two positions"""
MIN_END_SHARE, REST_SHARE = 0.25, 1e-3
"""of the largest speed between two positions: slower ends may be those of a turn, unless the two positions are equal"""
OVERSHOOT_SAMPLES = 9
"""number of times between two positions"""


def quintic(u: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Minimum-jerk step and its two derivatives."""
    u = clip(u, 0.0, 1.0)
    rest = 1.0 - u
    slope = u * rest
    return u * u * u * (10.0 + u * (6.0 * u - 15.0)), 30.0 * slope * slope, 60.0 * slope * (rest - u)


class SinusoidNumbers(NamedTuple):
    """
    Settings of a sum of sinusoids for each of r joints, as flat arrays or Columns for compiled code.

    Parameters
    ----------
    center : array or Column
        Centers (r,) in rad (m).
    amplitude, frequency, phase : array or Column
        Amplitudes in rad (m), frequencies in Hz and phases in rad of the terms (m r,), one joint after the other in
        each of the m terms.
    start_time : array or Column
        Time (1,) in s over which the motion fades in.

    Examples
    --------
    >>> from adaptctl.control.references import SinusoidNumbers
    >>> numbers = SinusoidNumbers(np.zeros(2), np.ones(2), np.ones(2), np.zeros(2), np.ones(1))
    >>> numbers.center.shape
    (2,)
    """

    center: Any
    amplitude: Any
    frequency: Any
    phase: Any
    start_time: Any


def sinusoids_at(time: Scalar, numbers: SinusoidNumbers) -> ReferencePoint:
    """
    Compute the reference of sinusoids at one time, over scalars of any kind.

    Parameters
    ----------
    time : float or symbolic scalar
        Time t in s.
    numbers : SinusoidNumbers
        Settings for r joints.

    Returns
    -------
    ReferencePoint
        Positions in rad (m), velocities in rad/s (m/s) and accelerations in rad/s^2 (m/s^2), (r,) each.

    Examples
    --------
    >>> from adaptctl.control.references import SinusoidNumbers, sinusoids_at
    >>> numbers = SinusoidNumbers(np.array([0.5]), np.ones(1), np.ones(1), np.zeros(1), np.zeros(1))
    >>> round(float(sinusoids_at(0.25, numbers).p[0]), 3)
    1.5
    """
    fade, slope, bend = _faded_in(time, numbers.start_time[0])
    joints, terms = len(numbers.center), range(len(numbers.amplitude))
    points = []
    for j, center in enumerate(numbers.center):
        waves = [_wave(time, *(part[k] for part in numbers[1:4])) for k in terms if k % joints == j]
        y, dy, ddy = (sum(parts[1:], parts[0]) for parts in zip(*waves, strict=True))
        points.append((center + fade * y, slope * y + fade * dy, bend * y + 2.0 * slope * dy + fade * ddy))
    return ReferencePoint(*map(Column, zip(*points, strict=True)))


def _wave(time: Scalar, amplitude: Scalar, frequency: Scalar, phase: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    omega = 2.0 * math.pi * frequency
    angle = omega * time + phase
    sine, cosine = amplitude * sin(angle), amplitude * cos(angle)
    return sine, omega * cosine, -(omega * omega) * sine


def _faded_in(time: Scalar, length: Any) -> tuple[Scalar, Scalar, Scalar]:
    """Fade and its two derivatives."""
    smooth = length > 0.0
    whole = where(smooth, length, 1.0)
    fade, slope, bend = quintic(where(smooth, time / whole, 1.0))
    return fade, slope / whole, bend / (whole * whole)


@lru_cache(maxsize=32)
def sinusoid_kernel(*sizes: int) -> Callable[..., ReferencePoint]:
    """Native code of `sinusoids_at`."""

    def equation(time: Column, **numbers: Column) -> ReferencePoint:
        return sinusoids_at(time[0], SinusoidNumbers(**numbers))

    lengths = dict(zip(SinusoidNumbers._fields, sizes, strict=True))
    return compile_function(equation, {"time": 1} | lengths, name="sinusoids").call


@lru_cache(maxsize=32)
def power_kernel(size: int) -> Callable[..., ReferencePoint]:
    """Native code of polynomials of degree 5."""
    joints = size // (SPLINE_DEGREE + 1)

    def equation(given: Column, powers: Column) -> ReferencePoint:
        u, moves = given
        p = v = a = Column.zeros(joints)
        for k in range(SPLINE_DEGREE + 1):
            a = u * a + 2.0 * v
            v = u * v + p
            p = u * p + Column(powers.of[k * joints : (k + 1) * joints])
        return ReferencePoint(p, moves * v, moves * a)

    return compile_function(equation, {"given": 2, "powers": size}, name="spline").call


def point_at(reference: Reference, t: float) -> ReferencePoint:
    """Reference point at one time, by the quicker `at` where there is one."""
    point: ReferencePoint = getattr(reference, "at", reference)(t)
    return point


@lru_cache(maxsize=32)
def quintic_kernel(joints: int) -> Callable[..., ReferencePoint]:
    """Native code of a minimum-jerk motion."""

    def equation(given: Column, start: Column, end: Column) -> ReferencePoint:
        passed, length = given
        fade, slope, bend = quintic(passed / length)
        way = end - start
        return ReferencePoint(start + fade * way, (slope / length) * way, (bend / (length * length)) * way)

    return compile_function(equation, {"given": 2, "start": joints, "end": joints}, name="minimum_jerk").call


@dataclass(frozen=True, eq=False)
class Sinusoids:
    """
    Reference trajectory of one sinusoid or a sum of sinusoids in each joint.

    Parameters
    ----------
    center : array_like
        Centre (r,) in rad (m for a prismatic joint).
    amplitude : array_like
        Amplitudes in rad (m), (r,) for one sinusoid or (h, r) for the sum of h.
    frequency : array_like
        Frequencies in Hz, of the shape of the amplitudes.
    phase : array_like, optional
        Phases in rad, of the shape of the amplitudes, zero unless given.
    start_time : float, default 2.0
        Duration in s of a smooth fade-in from rest in the centre; 0 for none.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or the start time is negative.

    Examples
    --------
    >>> reference = adaptctl.Sinusoids(center=[0.3, 0.5], amplitude=[0.4, 0.3], frequency=[0.5, 0.8])
    >>> reference(0.0).p
    array([0.3, 0.5])
    >>> reference(np.linspace(0.0, 1.0, 5)).a.shape
    (5, 2)
    """

    center: Array
    amplitude: Array
    frequency: Array
    phase: Array | None = None
    start_time: float = 2.0

    def __post_init__(self) -> None:
        center = np.atleast_1d(numbers(self.center, "center"))
        object.__setattr__(self, "center", frozen_array(center, center.shape[:1], "center"))
        terms = np.atleast_2d(numbers(self.amplitude, "amplitude")).shape[0]
        for name in ("amplitude", "frequency", "phase"):
            given = getattr(self, name)
            blank = given is None and name == "phase"
            rows = np.zeros((terms, center.size)) if blank else np.atleast_2d(numbers(given, name))
            object.__setattr__(self, name, frozen_array(rows, (terms, center.size), name))
        if not 0.0 <= real_number(self.start_time, "start_time") < math.inf:
            raise InputError(f"start_time: expected a finite time of at least 0 s, got {self.start_time}")

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """
        Return the reference point at some times.

        Parameters
        ----------
        t : array_like
            Times (...) in s.

        Returns
        -------
        ReferencePoint
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m for a prismatic joint).
        """
        own = SinusoidNumbers(*(Column(values.tolist()) for values in self.numbers))
        point = sinusoids_at(numbers(t, "reference: time"), own)
        return ReferencePoint(*(np.stack(column.of, axis=-1) for column in point))

    def at(self, t: float) -> ReferencePoint:
        """
        Return the reference point at one time, without the checks of a call.

        Parameters
        ----------
        t : float
            Time in s. NaN is not refused.

        Returns
        -------
        ReferencePoint
            Positions, velocities and accelerations (r,).
        """
        return self._kernel(np.array((t,)), *self._flat)

    @cached_property
    def _kernel(self) -> Callable[..., ReferencePoint]:
        return sinusoid_kernel(*(part.size for part in self._flat))

    @cached_property
    def _flat(self) -> SinusoidNumbers:
        return SinusoidNumbers(*map(np.ascontiguousarray, self.numbers))

    @property
    def numbers(self) -> SinusoidNumbers:
        """Settings as flat arrays, harmonic by harmonic."""
        phase = np.zeros_like(self.amplitude) if self.phase is None else self.phase
        amplitude, frequency, phase = (np.ravel(values) for values in (self.amplitude, self.frequency, phase))
        return SinusoidNumbers(self.center, amplitude, frequency, phase, np.array([self.start_time]))


@dataclass(frozen=True, eq=False)
class Spline:
    """
    Reference trajectory of a spline of degree 5 through given positions.

    Parameters
    ----------
    positions : array_like
        Positions (w, r) in rad (m for a prismatic joint), at least 6.
    times : array_like
        Strictly increasing times (w,) in s. An end whose two samples ask for less than half of the interpolated speed
        is clamped, at zero velocity and acceleration; at others velocities jump, unless the samples rest there.

    Raises
    ------
    InputError
        If there are too few positions, a number is not finite, or the times do not increase.

    Examples
    --------
    >>> times = np.linspace(0.0, 1.0, 11)
    >>> spline = adaptctl.control.Spline(np.sin(times)[:, None] * [1.0, 0.5], times)
    >>> bool(np.allclose(spline(0.5).v, np.cos(0.5) * np.array([1.0, 0.5]), atol=1e-4))
    True
    """

    positions: Array
    times: Array

    def __post_init__(self) -> None:
        positions = np.atleast_2d(numbers(self.positions, "positions"))
        object.__setattr__(self, "positions", frozen_array(positions, positions.shape, "positions"))
        object.__setattr__(self, "times", frozen_array(self.times, (len(positions),), "times"))
        if len(positions) <= SPLINE_DEGREE or np.any(np.diff(self.times) <= 0.0):
            raise InputError(f"spline: expected at least {SPLINE_DEGREE + 1} positions at increasing times")

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """
        Return the reference point at some times.

        Parameters
        ----------
        t : array_like
            Times (...) in s.

        Returns
        -------
        ReferencePoint
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m for a prismatic joint).
        """
        time = numbers(t, "reference: time")
        inside = np.clip(time, self.times[0], self.times[-1])
        resting = ((time < self.times[0]) | (time > self.times[-1]))[..., None]
        p, v, a = (curve(inside) for curve in self._curves)
        return ReferencePoint(p, np.where(resting, 0.0, v), np.where(resting, 0.0, a))

    def at(self, t: float) -> ReferencePoint:
        """
        Return the reference point at one time, without the checks of a call.

        Parameters
        ----------
        t : float
            Time in s. NaN is not refused.

        Returns
        -------
        ReferencePoint
            Positions, velocities and accelerations (r,).
        """
        inside = min(max(t, self._starts[0]), float(self.times[-1]))
        k = max(bisect_right(self._starts, inside) - 1, 0)
        return self._kernel(np.array((inside - self._starts[k], float(inside == t))), self._coefficients[k])

    @cached_property
    def _kernel(self) -> Callable[..., ReferencePoint]:
        return power_kernel(self._coefficients.shape[1])

    @cached_property
    def _starts(self) -> list[float]:
        return self._pieces[0]

    @property
    def _coefficients(self) -> Array:
        return self._pieces[1]

    @cached_property
    def _pieces(self) -> tuple[list[float], Array]:
        """Start times (s) and coefficients (m, 6 r), highest power first."""
        spline = self._curves[0]
        starts = np.unique(spline.t)[:-1]
        rows = [spline.derivative(k)(starts) / math.factorial(k) for k in range(SPLINE_DEGREE, -1, -1)]
        return starts.tolist(), np.concatenate(rows, axis=1)

    @cached_property
    def _curves(self) -> tuple[Any, Any, Any]:
        with needed("Spline"):
            from scipy.interpolate import make_interp_spline

        spline = make_interp_spline(self.times, self.positions, k=SPLINE_DEGREE)
        ends = [self._end(spline, end) for end in (0, -1)]
        if any(clamped for _, clamped in ends):
            conditions: Any = tuple(condition for condition, _ in ends)
            spline = make_interp_spline(self.times, self.positions, k=SPLINE_DEGREE, bc_type=conditions)
        return spline, spline.derivative(), spline.derivative(2)

    def _end(self, spline: Any, end: int) -> tuple[list[tuple[int, Array]], bool]:
        """Velocity and acceleration at the first (0) or last (-1) time, and whether a joint is clamped there."""
        v, a = (np.asarray(spline.derivative(order)(self.times[end])) for order in (1, 2))
        asked = np.abs(np.diff(self.positions, axis=0)) / np.diff(self.times)[:, None]
        fastest, rests = asked.max(axis=0), asked[end] <= REST_SHARE * asked.max(axis=0)
        clamped = np.abs(v) > np.maximum(MAX_END_SPEEDUP * asked[end], np.where(rests, 0.0, MIN_END_SHARE * fastest))
        return [(1, np.where(clamped, 0.0, v)), (2, np.where(clamped, 0.0, a))], bool(clamped.any())

    @cached_property
    def overshoot(self) -> Array:
        """Distances (r,) in rad (m) by which the spline leaves the range of its positions."""
        times = self.times[:-1, None] + np.diff(self.times)[:, None] * np.linspace(0.0, 1.0, OVERSHOOT_SAMPLES)
        p = self._curves[0](times.ravel())
        low, high = self.positions.min(axis=0), self.positions.max(axis=0)
        beyond: Array = np.maximum(p.max(axis=0) - high, low - p.min(axis=0))
        return np.maximum(beyond, 0.0)


@dataclass(frozen=True, eq=False)
class MinimumJerk:
    """
    Reference trajectory of minimum-jerk motions between waypoints.

    Parameters
    ----------
    waypoints : array_like
        Positions (w, r) in rad (m for a prismatic joint), at least 2.
    times : array_like
        Strictly increasing times (w,) in s at which the waypoints are reached.

    Raises
    ------
    InputError
        If there are too few waypoints, a number is not finite, or the times do not increase.

    References
    ----------
    .. [1] Flash and Hogan, J. Neuroscience, 1985.

    Examples
    --------
    >>> reference = adaptctl.MinimumJerk([[0.0, 0.0], [1.0, 0.5]], times=[0.0, 2.0])
    >>> reference(1.0).p
    array([0.5 , 0.25])
    """

    waypoints: Array
    times: Array

    def __post_init__(self) -> None:
        waypoints = np.atleast_2d(numbers(self.waypoints, "waypoints"))
        object.__setattr__(self, "waypoints", frozen_array(waypoints, waypoints.shape, "waypoints"))
        object.__setattr__(self, "times", frozen_array(self.times, (len(waypoints),), "times"))
        if len(waypoints) < 2 or np.any(np.diff(self.times) <= 0.0):
            raise InputError("minimum jerk: expected at least two waypoints at increasing times")

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """
        Return the reference point at some times.

        Parameters
        ----------
        t : array_like
            Times (...) in s.

        Returns
        -------
        ReferencePoint
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m for a prismatic joint).
        """
        time = numbers(t, "reference: time")
        stretch = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2)
        start, length = self.times[stretch], np.diff(self.times)[stretch][..., None]
        fade, slope, bend = quintic((time - start)[..., None] / length)
        way = np.diff(self.waypoints, axis=0)[stretch]
        return ReferencePoint(self.waypoints[stretch] + fade * way, slope * way / length, bend * way / length**2)

    def at(self, t: float) -> ReferencePoint:
        """
        Return the reference point at one time, without the checks of a call.

        Parameters
        ----------
        t : float
            Time in s. NaN is not refused.

        Returns
        -------
        ReferencePoint
            Positions, velocities and accelerations (r,).
        """
        starts = self._starts
        k = min(max(bisect_right(starts, t) - 1, 0), len(starts) - 2)
        given = np.array((t - starts[k], starts[k + 1] - starts[k]))
        return self._kernel(given, self.waypoints[k], self.waypoints[k + 1])

    @cached_property
    def _kernel(self) -> Callable[..., ReferencePoint]:
        return quintic_kernel(self.waypoints.shape[1])

    @cached_property
    def _starts(self) -> list[float]:
        return self.times.tolist()


@dataclass(frozen=True, eq=False)
class StoppedReference:
    """
    Reference trajectory that follows another one and then comes to rest on its path.

    Parameters
    ----------
    reference : Reference
        Trajectory to follow.
    stop : float
        Time in s at which it begins to slow down.
    duration : float, default 1.0
        Time in s within which it comes to rest.

    Raises
    ------
    InputError
        If the reference is no function of time, or a time is negative, zero for the duration, or not finite.

    Notes
    -----
    A quintic slows time, so that accelerations are continuous.

    Examples
    --------
    >>> stopped = adaptctl.control.StoppedReference(reference, stop=1.0)
    >>> bool(np.all(stopped(2.0).v == 0.0))
    True
    """

    reference: Reference
    stop: float
    duration: float = 1.0

    def __post_init__(self) -> None:
        if not callable(self.reference):
            raise InputError(f"stopped reference: expected a reference, a function of time, got {self.reference!r}")
        stop, over = (real_number(getattr(self, name), f"stopped reference: {name}") for name in ("stop", "duration"))
        if not (0.0 <= stop < math.inf and 0.0 < over < math.inf):
            raise InputError(
                f"stopped reference: expected a stop at 0 s or later, and a positive deceleration time, got "
                f"{self.stop} and {self.duration} s"
            )

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """
        Return the reference point at some times.

        Parameters
        ----------
        t : array_like
            Times (...) in s.

        Returns
        -------
        ReferencePoint
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m for a prismatic joint).
        """
        time = numbers(t, "reference: time")
        slowed, rate, change = self._slowed((time - self.stop) / self.duration)
        inner = self.reference(np.where(time > self.stop, self.stop + slowed, time))
        rate, change = rate[..., None], change[..., None]
        return ReferencePoint(inner.p, inner.v * rate, inner.a * rate**2 + inner.v * change)

    def at(self, t: float) -> ReferencePoint:
        """
        Return the reference point at one time, without the checks of a call.

        Parameters
        ----------
        t : float
            Time in s. NaN is not refused.

        Returns
        -------
        ReferencePoint
            Positions, velocities and accelerations (r,).
        """
        slowed, rate, change = self._slowed((t - self.stop) / self.duration)
        inner = point_at(self.reference, self.stop + slowed if t > self.stop else t)
        return ReferencePoint(inner.p, inner.v * rate, inner.a * rate**2 + inner.v * change)

    def _slowed(self, u: Any) -> tuple[Any, Any, Any]:
        """Time that passes along the path after the stop begins, its rate, and the rate's derivative."""
        u = clip(u, 0.0, 1.0)
        fallen, slope = quintic(u)[:2]
        gone = u**4 * (2.5 + u * (u - 3.0))  # the integral of the step
        return self.duration * (u - gone), 1.0 - fallen, -slope / self.duration


@sent_as_made
@dataclass(frozen=True, eq=False)
class FadeIn:
    """
    Reference trajectory that starts at rest at the arm's position and changes smoothly into another one.

    Parameters
    ----------
    reference : Reference
        Trajectory to join.
    start : array_like
        Positions (r,) at time 0 in rad (m for a prismatic joint).
    duration : float, default 3.0
        Time in s after which the other trajectory is followed exactly.

    Raises
    ------
    InputError
        If the reference is no function of time, the start does not fit it, or the duration is not positive.

    Notes
    -----
    Positions lie between the start and the other trajectory. The fade-in adds at most 1.875/duration times their
    distance to the speed.

    Examples
    --------
    >>> smooth = adaptctl.control.FadeIn(reference, start=[0.0, 0.0])
    >>> smooth(0.0).p
    array([0., 0.])
    >>> bool(np.allclose(smooth(3.0).p, reference(3.0).p))
    True
    """

    reference: Reference
    start: Array
    duration: float = 3.0

    def __post_init__(self) -> None:
        if not callable(self.reference):
            raise InputError(f"fade in: expected a reference, a function of time, got {self.reference!r}")
        object.__setattr__(self, "start", frozen_array(self.start, np.shape(self.reference(0.0).p), "fade in: start"))
        if not 0.0 < real_number(self.duration, "fade in: duration") < math.inf:
            raise InputError(f"fade in: expected a positive time, got {self.duration} s")

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """
        Return the reference point at some times.

        Parameters
        ----------
        t : array_like
            Times (...) in s.

        Returns
        -------
        ReferencePoint
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m for a prismatic joint).
        """
        time = numbers(t, "reference: time")
        return self._between(self.reference(time), time[..., None])

    def at(self, t: float) -> ReferencePoint:
        """
        Return the reference point at one time, without the checks of a call.

        Parameters
        ----------
        t : float
            Time in s. NaN is not refused.

        Returns
        -------
        ReferencePoint
            Positions, velocities and accelerations (r,).
        """
        point = point_at(self.reference, t)
        return point if t >= self.duration else self._between(point, t)

    def _between(self, point: ReferencePoint, time: Scalar) -> ReferencePoint:
        fade, slope, bend = quintic(time / self.duration)
        slope, bend, way = slope / self.duration, bend / self.duration**2, point.p - self.start
        a = bend * way + 2.0 * slope * point.v + fade * point.a
        return ReferencePoint(self.start + fade * way, slope * way + fade * point.v, a)
