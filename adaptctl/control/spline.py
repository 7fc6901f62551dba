"""Splines through positions."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, numbers
from adaptctl.caching import cached_property
from adaptctl.compilation import compile_function
from adaptctl.control.controller import ReferencePoint
from adaptctl.errors import InputError
from adaptctl.optional_packages import needed
from adaptctl.scalars import Column

SPLINE_DEGREE = 5
MAX_END_SPEEDUP = 2.0
"""speed of a spline at its ends over that of its first or last two positions"""
MIN_END_SHARE, REST_SHARE = 0.25, 1e-3
"""of the largest speed between two positions: slower ends may be those of a turn, unless the two positions are equal"""
OVERSHOOT_SAMPLES = 9
"""number of times between two positions"""


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
        if len(positions) == 1 < np.ndim(self.times):
            raise InputError(
                "spline: expected positions (w, r) and times (w,); Spline(positions, times), in this order"
            )
        object.__setattr__(self, "positions", frozen_array(positions, positions.shape, "positions"))
        object.__setattr__(self, "times", frozen_array(self.times, (len(positions),), "times"))
        if len(positions) <= SPLINE_DEGREE or np.any(np.diff(self.times) <= 0.0):
            raise InputError(f"spline: expected at least {SPLINE_DEGREE + 1} positions at increasing times")

    @classmethod
    def from_csv(cls, path: str | Path, joints: Sequence[str]) -> Spline:
        """
        Read a spline's positions from a CSV file.

        Parameters
        ----------
        path : str or Path
            File with a header: a column `time` in s, and one for each joint in rad (m), named as the joint or
            `position.` and the joint, as `adaptctl excite` writes it. Other columns are ignored.
        joints : sequence of str
            Names of the r joints in their order, such as `[joint.name for joint in arm.primary_joints]`.

        Returns
        -------
        Spline
            Spline through the rows.

        Raises
        ------
        FileError
            If the file cannot be read, lacks a column, has a cell that is no finite number, or a time that does not
            increase; the message has the line.
        InputError
            If there are fewer than 6 rows.

        Examples
        --------
        >>> rows = [f"{t},{0.1 * t},{0.2 * t}" for t in range(8)]
        >>> _ = (tmp / "motion.csv").write_text("\\n".join(["time,shoulder,elbow", *rows]))
        >>> adaptctl.control.Spline.from_csv(tmp / "motion.csv", ["shoulder", "elbow"]).positions[3]
        array([0.3, 0.6])
        """
        from adaptctl.control.reference_file import read_waypoints

        found = read_waypoints(path, joints)
        return cls(found.positions, found.times)

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
