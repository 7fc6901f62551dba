"""Minimum-jerk motions."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, numbers
from adaptctl.caching import cached_property
from adaptctl.compilation import compile_function
from adaptctl.control.controller import ReferencePoint
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Scalar, clip


def quintic(u: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Minimum-jerk step and its two derivatives."""
    u = clip(u, 0.0, 1.0)
    rest = 1.0 - u
    slope = u * rest
    return u * u * u * (10.0 + u * (6.0 * u - 15.0)), 30.0 * slope * slope, 60.0 * slope * (rest - u)


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
