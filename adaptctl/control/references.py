"""Trajectories to follow: positions with their exact first and second derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.control.controller import ReferencePoint
from adaptctl.errors import InputError
from adaptctl.mechanism.pose import Array, frozen_array


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
