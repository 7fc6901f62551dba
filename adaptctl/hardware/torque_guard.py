"""Guard of the torques that leave the loop."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.hardware.robot import HardwareLimits

RATE_SHARE = 0.95
"""share of the robot's limit that rates keep to: at the limit itself, robots stop"""
MAX_FLOAT = float(np.finfo(np.float64).max)


class TorqueGuard:
    """
    Last stage of the loop: torques within limits and rates, from the first one on.

    Parameters
    ----------
    limits : HardwareLimits
        Limits of the robot.
    period : float
        Control period in s.
    held : ndarray
        Torque (r,) in N m (N) that acts now; no more than the limits is taken of it.

    Notes
    -----
    Limits that are lowered during a run take effect at the rate limit.

    Examples
    --------
    >>> from adaptctl.hardware import HardwareLimits, TorqueGuard
    >>> guard = TorqueGuard(HardwareLimits([9.0], [1.0], [-1.0], [1.0], torque_rate=1000.0), 0.001, np.zeros(1))
    >>> guard.limited(np.array([20.0]))
    array([0.95])
    """

    def __init__(self, limits: HardwareLimits, period: float, held: Array) -> None:
        self.limits = np.minimum(limits.torque, MAX_FLOAT)
        self.torque = np.clip(np.asarray(held, dtype=np.float64), -self.limits, self.limits)
        """torque (r,) that was let through last"""
        self._step = np.minimum(RATE_SHARE * period * limits.torque_rate, MAX_FLOAT)

    def limited(self, torque: Array) -> Array:
        """
        Return a torque within the limits, and keep it as the last one.

        Parameters
        ----------
        torque : ndarray
            Torque (r,) in N m (N); the last one is held where a number is not finite.

        Returns
        -------
        ndarray
            Torque (r,) that may be sent.
        """
        last = self.torque
        wanted = np.where(np.isfinite(torque), torque, last)
        within = np.minimum(np.maximum(wanted, -self.limits), self.limits)
        self.torque = np.minimum(np.maximum(within, last - self._step), last + self._step)
        return self.torque
