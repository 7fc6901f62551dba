"""Trajectories to follow: positions with their exact first and second derivatives."""

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

DEGREE = 5
"""Degree of splines."""


def quintic(u: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """The minimum-jerk step 10u^3 - 15u^4 + 6u^5 from 0 to 1, at the fraction `u` of its duration, and its first and
    second derivative with respect to u: three scalars without a unit. Outside [0, 1] the step rests at 0 or 1.

    Flash and Hogan (1985). Over scalars of any kind: floats, arrays (element by element), symbols. Nothing is checked.
    """
    u = clip(u, 0.0, 1.0)
    rest = 1.0 - u
    slope = u * rest
    return u * u * u * (10.0 + u * (6.0 * u - 15.0)), 30.0 * slope * slope, 60.0 * slope * (rest - u)


class SinusoidNumbers(NamedTuple):
    """Parameters of sums of sinusoids (`Sinusoids`) of r joints and h harmonics, as arrays or columns. `center` (r,)
    and `amplitude` (h r,) are in rad (m if prismatic), `frequency` (h r,) in Hz, `phase` (h r,) in rad, and
    `start_time` (1,) in s is the length of the fade-in. The r terms of one harmonic come after those of the one before.
    Nothing is checked."""

    center: Any
    amplitude: Any
    frequency: Any
    phase: Any
    start_time: Any


def sinusoids_at(time: Scalar, numbers: SinusoidNumbers) -> ReferencePoint:
    """The reference point at a `time` t (s) of sums of sinusoids, center + fade(t) sum_i amplitude_i sin(2 pi
    frequency_i t + phase_i). It has columns (r,) of positions in rad (m if prismatic), velocities in rad/s (m/s) and
    accelerations in rad/s^2 (m/s^2).

    `numbers`, for r joints and h sinusoids i of each, are center (r,) and amplitude in rad (m), frequency (Hz) and
    phase (rad), the last three (h r,), the r entries of one i before those of the next, and start_time (1,), s, in
    which the fade 10u^3 - 15u^4 + 6u^5, u = t/start_time, rises from 0 to 1, where it stays; at start_time 0 it is 1
    throughout. Time and numbers are scalars of any kind: floats, symbols, or arrays with an entry for each of many
    arms. Nothing is checked.
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
    """A sinusoid and its two derivatives."""
    omega = 2.0 * math.pi * frequency
    angle = omega * time + phase
    sine, cosine = amplitude * sin(angle), amplitude * cos(angle)
    return sine, omega * cosine, -(omega * omega) * sine


def _faded_in(time: Scalar, length: Any) -> tuple[Scalar, Scalar, Scalar]:
    """The fade of a smooth start and its two derivatives; 1 throughout where its length is zero."""
    smooth = length > 0.0
    whole = where(smooth, length, 1.0)
    fade, slope, bend = quintic(where(smooth, time / whole, 1.0))
    return fade, slope / whole, bend / (whole * whole)


@lru_cache(maxsize=32)
def sinusoid_kernel(*sizes: int) -> Callable[..., ReferencePoint]:
    """Native code of `sinusoids_at`: a function of a time (1,) in s and the five arrays of a `SinusoidNumbers`, whose
    lengths are the `sizes`, that returns the `ReferencePoint` (r,). It raises `InputError` on a wrong shape; `sizes`
    that are not five raise `ValueError` here."""

    def equation(time: Column, **numbers: Column) -> ReferencePoint:
        return sinusoids_at(time[0], SinusoidNumbers(**numbers))

    lengths = dict(zip(SinusoidNumbers._fields, sizes, strict=True))
    return compile_function(equation, {"time": 1} | lengths, name="sinusoids").call


@lru_cache(maxsize=32)
def power_kernel(size: int) -> Callable[..., ReferencePoint]:
    """Native code of polynomials c_5 u^5 + ... + c_0 in time u for r joints: a function that returns the
    `ReferencePoint` (r,). Its arguments are an array (2,), the time u since the polynomials' start (s) and 1 where they
    move or 0 at rest, and the coefficients (`size`,), `size` = 6 r: c_5 of all joints first, c_0 last, c_k in rad/s^k
    (m/s^k). It raises `InputError` on a wrong shape."""
    joints = size // (DEGREE + 1)

    def equation(given: Column, powers: Column) -> ReferencePoint:
        u, moves = given
        p = v = a = Column.zeros(joints)
        for k in range(DEGREE + 1):
            a = u * a + 2.0 * v
            v = u * v + p
            p = u * p + Column(powers.of[k * joints : (k + 1) * joints])
        return ReferencePoint(p, moves * v, moves * a)

    return compile_function(equation, {"given": 2, "powers": size}, name="spline").call


@lru_cache(maxsize=32)
def quintic_kernel(joints: int) -> Callable[..., ReferencePoint]:
    """Native code of a minimum-jerk motion between two waypoints for r `joints`: a function that returns the
    `ReferencePoint` (r,). Its arguments are an array (2,), the time since the motion's start and its duration (s), and
    the first and the last positions (r,), rad (m), at which it rests before and after. It raises `InputError` on a
    wrong shape."""

    def equation(given: Column, start: Column, end: Column) -> ReferencePoint:
        passed, length = given
        fade, slope, bend = quintic(passed / length)
        way = end - start
        return ReferencePoint(start + fade * way, (slope / length) * way, (bend / (length * length)) * way)

    return compile_function(equation, {"given": 2, "start": joints, "end": joints}, name="minimum_jerk").call


@dataclass(frozen=True, eq=False)
class Sinusoids:
    """Reference trajectory: for each of r joints a sum of sinusoids about a centre, faded in from rest.

    p(t) = center + fade(t) sum_i amplitude_i sin(2 pi frequency_i t + phase_i)

    `center` (r,) is in rad (m if prismatic); `amplitude` (rad or m), `frequency` (Hz) and `phase` (rad; None is zero)
    are (r,) for one sinusoid a joint or (h, r) for the sum of h; `start_time`, 2 s by default, is the length of the
    fade 10u^3 - 15u^4 + 6u^5, u = t/start_time, from 0 to 1; 0 is for no fade. With a fade the arm is at rest in the
    centre at time 0 and before; without one the sinusoids run at all times. Called with times t (...) in s, it returns
    the `ReferencePoint` then: positions, velocities and accelerations (..., r), in rad, rad/s and rad/s^2 (m, m/s and
    m/s^2 if prismatic). Raises `InputError` for other shapes, what is no number or not finite, and a negative start
    time.
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
        """The reference point of r joints at times `t` (...) in s: positions (..., r) in rad (m if prismatic),
        velocities in rad/s (m/s) and accelerations in rad/s^2 (m/s^2)."""
        own = SinusoidNumbers(*(Column(values.tolist()) for values in self.numbers))
        point = sinusoids_at(numbers(t, "reference: time"), own)
        return ReferencePoint(*(np.stack(column.of, axis=-1) for column in point))

    def at(self, t: float) -> ReferencePoint:
        """The reference point (r,) at one time `t` (s), as when called, in about a microsecond, for loops that ask each
        period. NaN is not refused."""
        return self._kernel(np.array((t,)), *self._flat)

    @cached_property
    def _kernel(self) -> Callable[..., ReferencePoint]:
        return sinusoid_kernel(*(part.size for part in self._flat))

    @cached_property
    def _flat(self) -> SinusoidNumbers:
        return SinusoidNumbers(*map(np.ascontiguousarray, self.numbers))

    @property
    def numbers(self) -> SinusoidNumbers:
        """Parameters of these sums of sinusoids as flat arrays, for r joints and h harmonics, a `SinusoidNumbers`.
        `center` (r,) and `amplitude` (h r,) are in rad (m if prismatic), `frequency` (h r,) in Hz, `phase` (h r,) in
        rad, and `start_time` (1,) in s is the length of the fade-in. The r terms of one harmonic come after those of
        the one before."""
        phase = np.zeros_like(self.amplitude) if self.phase is None else self.phase
        amplitude, frequency, phase = (np.ravel(values) for values in (self.amplitude, self.frequency, phase))
        return SinusoidNumbers(self.center, amplitude, frequency, phase, np.array([self.start_time]))


@dataclass(frozen=True, eq=False)
class Spline:
    """Reference trajectory through given positions at given times: the spline of degree 5, whose acceleration has two
    derivatives.

    `positions` (w, r) are w >= 6 positions of r joints in rad (m if prismatic), `times` (w,) in s, strictly increasing:
    samples of a path that has no formula in joints, such as what inverse kinematics makes of one in space. Velocities
    and accelerations are the spline's own derivatives. Before the first time it rests in the first position and after
    the last time in the last, with a jump of velocity and acceleration unless the samples rest there. Called with times
    t (...) in s, it returns the `ReferencePoint` then: positions, velocities and accelerations (..., r), in rad, rad/s
    and rad/s^2 (m, m/s and m/s^2 if prismatic).

    Raises `InputError` for fewer positions, another number of times, what is no number or not finite, and times that do
    not strictly increase; `MissingExtraError` at the first use without SciPy.
    """

    positions: Array
    times: Array

    def __post_init__(self) -> None:
        positions = np.atleast_2d(numbers(self.positions, "positions"))
        object.__setattr__(self, "positions", frozen_array(positions, positions.shape, "positions"))
        object.__setattr__(self, "times", frozen_array(self.times, (len(positions),), "times"))
        if len(positions) <= DEGREE or np.any(np.diff(self.times) <= 0.0):
            raise InputError(f"spline: expected at least {DEGREE + 1} positions at increasing times")

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """The reference point of r joints at times `t` (...) in s: positions (..., r) in rad (m if prismatic),
        velocities in rad/s (m/s) and accelerations in rad/s^2 (m/s^2). Raises `MissingExtraError` without SciPy."""
        time = numbers(t, "reference: time")
        inside = np.clip(time, self.times[0], self.times[-1])
        resting = ((time < self.times[0]) | (time > self.times[-1]))[..., None]
        p, v, a = (curve(inside) for curve in self._curves)
        return ReferencePoint(p, np.where(resting, 0.0, v), np.where(resting, 0.0, a))

    def at(self, t: float) -> ReferencePoint:
        """The reference point (r,) at one time `t` (s), as when called, in microseconds, for loops that ask each
        period. Raises `MissingExtraError` without SciPy."""
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
        """Start time (s) of each polynomial, and its coefficients (m, 6 r), the highest power of all joints first."""
        spline = self._curves[0]
        starts = np.unique(spline.t)[:-1]
        rows = [spline.derivative(k)(starts) / math.factorial(k) for k in range(DEGREE, -1, -1)]
        return starts.tolist(), np.concatenate(rows, axis=1)

    @cached_property
    def _curves(self) -> tuple[Any, Any, Any]:
        """The spline and its derivatives."""
        with needed("Spline"):
            from scipy.interpolate import make_interp_spline

        spline = make_interp_spline(self.times, self.positions, k=DEGREE)
        return spline, spline.derivative(), spline.derivative(2)


@dataclass(frozen=True, eq=False)
class MinimumJerk:
    """Reference trajectory through waypoints, at rest in each of them; each motion between two is a quintic of least
    jerk (Flash and Hogan 1985).

    `waypoints` (w, r) are w >= 2 positions of r joints in rad (m if prismatic), `times` (w,) when they are reached, in
    s, strictly increasing. Before the first time it rests in the first waypoint, after the last time in the last.
    Called with times t (...) in s, it returns the `ReferencePoint` then: positions, velocities and accelerations (...,
    r), in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic). Raises `InputError` for fewer waypoints, another
    number of times, what is no number or not finite, and times that do not strictly increase.
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
        """The reference point of r joints at times `t` (...) in s: positions (..., r) in rad (m if prismatic),
        velocities in rad/s (m/s) and accelerations in rad/s^2 (m/s^2)."""
        time = numbers(t, "reference: time")
        stretch = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2)
        start, length = self.times[stretch], np.diff(self.times)[stretch][..., None]
        fade, slope, bend = quintic((time - start)[..., None] / length)
        way = np.diff(self.waypoints, axis=0)[stretch]
        return ReferencePoint(self.waypoints[stretch] + fade * way, slope * way / length, bend * way / length**2)

    def at(self, t: float) -> ReferencePoint:
        """The reference point (r,) at one time `t` (s), as when called, in microseconds, for loops that ask each
        period. NaN is not refused."""
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
    """Reference trajectory that follows another one, `of`, up to a time `stop` (s), then comes to rest along its path
    within `over` (s; 1 by default), and stays there. It excites an adaptive controller for a limited interval.

    After `stop` the other's time runs on at the rate 1 - (10u^3 - 15u^4 + 6u^5), u = (t - stop)/over, which falls from
    1 to 0, so that positions, velocities and accelerations stay continuous. Called with times t (...) in s, it returns
    a `ReferencePoint` in the shapes and units of the other's. Raises `InputError` for an `of` that is no function of
    time, a `stop` below 0, an `over` that is not positive, and for either time that is no number or not finite.
    """

    reference: Reference
    stop: float
    duration: float = 1.0

    def __post_init__(self) -> None:
        if not callable(self.reference):
            raise InputError(f"halted: expected a reference, a function of time, got {self.reference!r}")
        stop, over = (real_number(getattr(self, name), f"halted: {name}") for name in ("stop", "duration"))
        if not (0.0 <= stop < math.inf and 0.0 < over < math.inf):
            raise InputError(
                f"halted: expected a stop at 0 s or later, and a positive time to come to rest, got {self.stop} and "
                f"{self.duration} s"
            )

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """The reference point at times `t` (...) in s: positions, velocities and accelerations in the shapes and units
        of the reference that is halted."""
        time = numbers(t, "reference: time")
        u = np.clip((time - self.stop) / self.duration, 0.0, 1.0)
        fallen, slope, _ = quintic(u)
        gone = u**4 * (2.5 + u * (u - 3.0))  # the integral of the step
        inner = self.reference(np.where(u > 0.0, self.stop + self.duration * (u - gone), time))
        rate, change = (1.0 - fallen)[..., None], (-slope / self.duration)[..., None]
        return ReferencePoint(inner.p, inner.v * rate, inner.a * rate**2 + inner.v * change)


@sent_as_made
@dataclass(frozen=True, eq=False)
class FadeIn:
    """Reference trajectory that begins at rest where an arm stands, at the positions `start` (r,) in rad (m if
    prismatic), and has become another one, `of`, after a time `over` (s; 3 by default).

    It is start + fade(t) (of(t) - start), fade = 10u^3 - 15u^4 + 6u^5, u = t/over: positions, velocities and
    accelerations are continuous, no position lies beyond both the start and the other's, and at time 0 and before it
    rests. Speeds are at most 1.875/over times the distance between the two, and the other's. Called with times t (...)
    in s, it returns the `ReferencePoint` then, (..., r) each. Raises `InputError` for an `of` that is no function of
    time, a `start` that does not fit it or is not finite, and an `over` that is not positive.
    """

    reference: Reference
    start: Array
    duration: float = 3.0

    def __post_init__(self) -> None:
        if not callable(self.reference):
            raise InputError(f"faded in: expected a reference, a function of time, got {self.reference!r}")
        object.__setattr__(self, "start", frozen_array(self.start, np.shape(self.reference(0.0).p), "faded in: start"))
        if not 0.0 < real_number(self.duration, "faded in: duration") < math.inf:
            raise InputError(f"faded in: expected a positive time, got {self.duration} s")

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """The reference point of r joints at times `t` (...) in s: positions (..., r) in rad (m if prismatic),
        velocities in rad/s (m/s) and accelerations in rad/s^2 (m/s^2)."""
        time = numbers(t, "reference: time")
        return self._between(self.reference(time), time[..., None])

    def at(self, t: float) -> ReferencePoint:
        """The reference point (r,) at one time `t` (s), as when called, in microseconds, for loops that ask each
        period. NaN is not refused."""
        point: ReferencePoint = getattr(self.reference, "at", self.reference)(t)
        return point if t >= self.duration else self._between(point, t)

    def _between(self, point: ReferencePoint, time: Scalar) -> ReferencePoint:
        fade, slope, bend = quintic(time / self.duration)
        slope, bend, way = slope / self.duration, bend / self.duration**2, point.p - self.start
        a = bend * way + 2.0 * slope * point.v + fade * point.a
        return ReferencePoint(self.start + fade * way, slope * way + fade * point.v, a)
