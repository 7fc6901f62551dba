"""References that fade in or stop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, finite_number, frozen_array, numbers, positive_number
from adaptctl.caching import sent_as_made
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.control.minimum_jerk import quintic
from adaptctl.errors import InputError
from adaptctl.scalars import Scalar, clip


def point_at(reference: Reference, t: float) -> ReferencePoint:
    """Reference point at one time, by the quicker `at` where there is one."""
    point: ReferencePoint = getattr(reference, "at", reference)(t)
    return point


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
        finite_number(self.stop, "stopped reference: stop")
        positive_number(self.duration, "stopped reference: duration: expected a positive number of s")

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
        positive_number(self.duration, "fade in: duration: expected a positive number of s")

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
