"""Trajectories to follow: positions with their exact first and second derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.control.controller import ReferencePoint
from adaptctl.errors import InputError
from adaptctl.mechanism.pose import Array, frozen_array

DEGREE = 5
"""of splines"""


def quintic(u: Array) -> tuple[Array, Array, Array]:
    """The minimum-jerk step 10u^3 - 15u^4 + 6u^5 from 0 to 1 and its two derivatives, still outside [0, 1].

    Flash and Hogan (1985).
    """
    u = np.clip(u, 0.0, 1.0)
    rest = 1.0 - u
    return u**3 * (10.0 + u * (6.0 * u - 15.0)), 30.0 * (u * rest) ** 2, 60.0 * u * rest * (rest - u)


@dataclass(frozen=True, eq=False)
class Sinusoids:
    """Sums of sinusoids about a centre, faded in from rest.

    p(t) = center + fade(t) sum_h amplitude_h sin(2 pi frequency_h t + phase_h)

    `center` (r,); `amplitude`, `frequency` (Hz) and `phase` (rad) are (r,) or (h, r); `start_time` is the
    length of the quintic fade in s, 0 for none. With a fade the arm starts at rest in the centre.
    """

    center: Array
    amplitude: Array
    frequency: Array
    phase: Array | None = None
    start_time: float = 2.0

    def __post_init__(self) -> None:
        center = np.atleast_1d(np.asarray(self.center, dtype=np.float64))
        object.__setattr__(self, "center", frozen_array(center, center.shape[:1], "center"))
        terms = np.atleast_2d(np.asarray(self.amplitude, dtype=np.float64)).shape[0]
        for name in ("amplitude", "frequency", "phase"):
            given = getattr(self, name)
            rows = np.zeros((terms, center.size)) if given is None else np.atleast_2d(given)
            object.__setattr__(self, name, frozen_array(rows, (terms, center.size), name))
        if not (np.isfinite(self.start_time) and self.start_time >= 0.0):
            raise InputError(f"start_time: expected a finite time of at least 0 s, got {self.start_time}")

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """The reference (..., r) at times (...)."""
        time = np.asarray(t, dtype=np.float64)[..., None]
        y, dy, ddy = self._sum(time)
        if self.start_time == 0.0:
            return ReferencePoint(self.center + y, dy, ddy)
        fade, slope, bend = quintic(time / self.start_time)
        slope, bend = slope / self.start_time, bend / self.start_time**2
        return ReferencePoint(self.center + fade * y, slope * y + fade * dy, bend * y + 2.0 * slope * dy + fade * ddy)

    def _sum(self, time: Array) -> tuple[Array, Array, Array]:
        omega = 2.0 * np.pi * self.frequency
        angle = omega * time[..., None] + (0.0 if self.phase is None else self.phase)
        sine, cosine = self.amplitude * np.sin(angle), self.amplitude * np.cos(angle)
        return sine.sum(-2), (omega * cosine).sum(-2), (-(omega**2) * sine).sum(-2)


@dataclass(frozen=True, eq=False)
class Spline:
    """Through given positions at given times: the spline of degree 5, whose acceleration has two derivatives.

    `positions` (w, r) with w of at least 6, `times` (w,) in s, increasing: samples of a path that has no formula in
    joints, such as what inverse kinematics makes of one in space. Velocities and accelerations are the spline's
    own derivatives. Before the first time and after the last the arm rests, with a jump unless the samples rest there.
    """

    positions: Array
    times: Array

    def __post_init__(self) -> None:
        positions = np.atleast_2d(np.asarray(self.positions, dtype=np.float64))
        object.__setattr__(self, "positions", frozen_array(positions, positions.shape, "positions"))
        object.__setattr__(self, "times", frozen_array(self.times, (len(positions),), "times"))
        if len(positions) <= DEGREE or np.any(np.diff(self.times) <= 0.0):
            raise InputError(f"spline: expected at least {DEGREE + 1} positions at increasing times")

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """The reference (..., r) at times (...)."""
        time = np.asarray(t, dtype=np.float64)
        inside = np.clip(time, self.times[0], self.times[-1])
        moving = (inside == time)[..., None]
        p, v, a = (curve(inside) for curve in self._curves)
        return ReferencePoint(p, np.where(moving, v, 0.0), np.where(moving, a, 0.0))

    @cached_property
    def _curves(self) -> tuple[Callable[[Array], Array], ...]:
        """The spline and its derivatives."""
        from scipy.interpolate import make_interp_spline

        spline = make_interp_spline(self.times, self.positions, k=DEGREE)
        return spline, spline.derivative(), spline.derivative(2)


@dataclass(frozen=True, eq=False)
class MinimumJerk:
    """From rest to rest through waypoints, each stretch a quintic of least jerk (Flash and Hogan 1985).

    `waypoints` (w, r) with w of at least 2, `times` (w,) in s, increasing. Before the first time and after
    the last the arm rests.
    """

    waypoints: Array
    times: Array

    def __post_init__(self) -> None:
        waypoints = np.atleast_2d(np.asarray(self.waypoints, dtype=np.float64))
        object.__setattr__(self, "waypoints", frozen_array(waypoints, waypoints.shape, "waypoints"))
        object.__setattr__(self, "times", frozen_array(self.times, (len(waypoints),), "times"))
        if len(waypoints) < 2 or np.any(np.diff(self.times) <= 0.0):
            raise InputError("minimum jerk: expected at least two waypoints at increasing times")

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """The reference (..., r) at times (...)."""
        time = np.asarray(t, dtype=np.float64)
        stretch = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2)
        start, length = self.times[stretch], np.diff(self.times)[stretch][..., None]
        fade, slope, bend = quintic((time - start)[..., None] / length)
        way = np.diff(self.waypoints, axis=0)[stretch]
        return ReferencePoint(self.waypoints[stretch] + fade * way, slope * way / length, bend * way / length**2)
