"""Accelerations that an arm may have, from what it did and what it was sent since."""

from __future__ import annotations

from collections import deque

import numpy as np

from adaptctl.arrays import Array
from adaptctl.hardware.robot import RobotReading

WINDOW, LEAST = 0.01, 3
"""s, and number of periods, over which an acceleration is measured: velocities are noisy"""


class PossibleAcceleration:
    """
    Greatest accelerations that an arm may have now.

    Parameters
    ----------
    inverses : ndarray
        Inverse mass matrices (n, r, r) at postures of the whole range.
    period : float
        Control period in s.

    Notes
    -----
    The torque alone says little: with a load that nobody knows, much of it holds weight. So the acceleration is the
    measured one of the last 10 ms, and what the change of the torque since then makes of it at worst.
    """

    def __init__(self, inverses: Array, period: float) -> None:
        self._inverses = inverses
        self._past: deque[tuple[float, Array, Array]] = deque(maxlen=1 + max(LEAST, round(WINDOW / period)))

    def take(self, reading: RobotReading, torque: Array) -> None:
        """
        Take a measurement.

        Parameters
        ----------
        reading : RobotReading
            Sound measurement.
        torque : ndarray
            Torque (r,) in N m (N) that acted until then.
        """
        self._past.append((reading.time, reading.v, torque))

    def along(self, v: Array, torque: Array) -> Array:
        """
        Return the greatest accelerations along velocities.

        Parameters
        ----------
        v : ndarray
            Velocities (r,) in rad/s (m/s).
        torque : ndarray
            Torque (r,) in N m (N) that acts now.

        Returns
        -------
        ndarray
            Accelerations (r,) in rad/s^2 (m/s^2), at least 0.
        """
        if len(self._past) < 2:
            return np.zeros_like(v)
        (since, first, before), (now, last, _) = self._past[0], self._past[-1]
        sign = np.sign(v)
        changed = np.maximum(sign * (self._inverses @ (torque - before)), 0.0).max(axis=0)
        return np.maximum(sign * (last - first) / (now - since) + changed, 0.0)
