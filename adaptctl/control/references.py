"""Reference trajectories."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, finite_number, frozen_array, numbers
from adaptctl.caching import cached_property
from adaptctl.compilation import compile_function
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.minimum_jerk import quintic
from adaptctl.errors import InputError, shown
from adaptctl.scalars import Column, Scalar, cos, sin, where


def validate_reference(reference: object) -> None:
    """Raise `InputError` unless `reference` can be called."""
    if not callable(reference):
        made = "as Spline(positions, times) makes one"
        raise InputError(f"reference: expected a Reference, {made}, got {shown(reference)}")


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
            what = f"{name}, a row for each sinusoid and a column for each joint" if terms > 1 else name
            object.__setattr__(self, name, frozen_array(rows, (terms, center.size), what))
        finite_number(self.start_time, "start_time")

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
