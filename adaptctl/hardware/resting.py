"""Ranges and speeds from which an arm can still be brought to rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.control.gains.workspace import reachable
from adaptctl.dynamics import Mechanism
from adaptctl.hardware.robot import HardwareLimits
from adaptctl.hardware.torque_guard import RATE_SHARE

BRAKE_SHARE = 0.5
"""share of the torque left after gravity that a planned stop uses: the rest is for what the model does not know"""
SAMPLES, LOOP_SAMPLES = 64, 200
"""number of postures, and of those of an arm with loops, which close at some of them"""
PEAK = 1.875
"""greatest slope of a quintic step, times its duration"""
MIN_STOP, MAX_STOP = 0.1, 3.0
"""s"""
MARGIN = 0.03
"""rad (m) in front of a joint's end that stay free"""
MAX_SPEED = 1e3
"""rad/s (m/s) of a joint without a speed limit"""


class StoppingDistance:
    """
    Durations and places of planned stops.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    limits : HardwareLimits
        Limits of the robot.
    period : float
        Control period in s.

    Notes
    -----
    Decelerations follow from the torque left after gravity and the inertia at postures drawn from the whole range. All
    joints come to rest at once, so a stop takes as long as the slowest joint needs. The way to rest contains the time
    in which torque that drives on is turned round at the rate limit: speeds towards an end fall as sqrt(2 a d).
    """

    def __init__(self, mechanism: Mechanism, limits: HardwareLimits, period: float) -> None:
        inertia, gravity = _sampled(mechanism, limits)
        self._limits = limits
        torque = np.minimum(limits.torque, 1e6)
        left = np.maximum(BRAKE_SHARE * (torque - np.abs(gravity)), 0.02 * torque)
        speed = np.minimum(limits.velocity, MAX_SPEED)
        needed = np.abs(inertia) @ speed  # N m s: torque times duration of a stop from full speed
        rate = float((left / needed).min())
        self.deceleration = rate * speed
        """rad/s^2 (m/s^2), (r,), of joints that stop at once"""
        self.inverses: Array = np.linalg.inv(inertia).astype(np.float64)
        """inverse mass matrices (n, r, r) at these postures"""
        self._rate, self._period = RATE_SHARE * limits.torque_rate, period

    def duration(self, v: Array) -> Array:
        """Durations (...) in s of stops from velocities (..., r)."""
        return np.asarray(np.clip(PEAK * (np.abs(v) / self.deceleration).max(axis=-1), MIN_STOP, MAX_STOP))

    def beyond(self, p: Array, v: Array, net: ArrayLike = 0.0, acceleration: ArrayLike = 0.0) -> Array:
        """Mask (..., r) of joints that would leave their range in a stop, at net torques and accelerations (r,)."""
        speed, sign = np.abs(v), np.sign(v)
        turning = 2.0 * self._period + 2.0 * np.maximum(sign * net, 0.0) / self._rate
        gained = acceleration * turning / 4.0
        way = speed * turning + gained * turning + 0.5 * (speed + gained) * self.duration(speed + gained)[..., None]
        rest = p + sign * way
        return np.asarray(
            ((rest > self._limits.upper - MARGIN) & (v > 0.0)) | ((rest < self._limits.lower + MARGIN) & (v < 0.0))
        )


def _sampled(mechanism: Mechanism, limits: HardwareLimits) -> tuple[Array, Array]:
    """Mass matrices (n, r, r) and gravity torques (n, r)."""
    lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    random = np.random.default_rng(0)
    p = random.uniform(lower, upper, (SAMPLES if mechanism.is_plain_tree else LOOP_SAMPLES, mechanism.dof))
    if not mechanism.is_plain_tree:
        p = np.concatenate([p[reachable(mechanism, p)], [mechanism.neutral_configuration]])
    rest = np.zeros_like(p)
    return mechanism.mass_matrix(p), mechanism.inverse_dynamics(p, rest, rest)
