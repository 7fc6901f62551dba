"""Measurements that can be trusted, without turns that encoders lose."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import Joint
from adaptctl.hardware.robot import HardwareLimits, RobotReading, finite_vector

TURN = 2.0 * math.pi
NOISE = 2e-3
"""rad (m) by which measured positions may differ beyond what the speed limit allows"""
SPEED_MARGIN = 1.5
"""times the speed limit, beyond which a change of position is no motion"""


class Measurements:
    """
    Readings of a robot, checked one against the other.

    Parameters
    ----------
    joints : sequence of Joint
        Joints of the mechanism (r,).
    limits : HardwareLimits
        Limits of the robot.
    period : float
        Control period in s.
    near : ndarray
        Positions (r,) in rad (m) from which joints without limits are at most half a turn away at first.

    Notes
    -----
    Revolute joints are followed across a whole turn, so that an encoder may wrap or count from 0. `fault` says in a few
    words why the last reading was not trusted; it is empty for a sound one.
    """

    def __init__(self, joints: Sequence[Joint], limits: HardwareLimits, period: float, near: Array) -> None:
        self._turns = np.array([joint.kind.position_unit == "rad" for joint in joints])
        self._limits, self._near = limits, near
        self._speed = np.where(np.isfinite(limits.velocity), SPEED_MARGIN * limits.velocity, np.inf)
        self._too_fast, self._period = 2.0 * limits.velocity, period
        self.latest: RobotReading | None = None
        """last sound reading, turns undone"""
        self.fault = ""

    def taken(self, reading: object) -> RobotReading | None:
        """Sound reading, None where it cannot be trusted."""
        self.fault = ""
        r = len(self._turns)
        if not isinstance(reading, tuple) or len(reading) != 4:
            self.fault = "no measurement"
            return None
        time, p, v = finite_vector([reading[0]], 1), finite_vector(reading[1], r), finite_vector(reading[2], r)
        if p is None or v is None or time is None:
            self.fault = "numbers that are not finite, or too few"
            return None
        near = self._first(p) if self.latest is None else self.latest.p
        p = np.where(self._turns, p + TURN * np.round((near - p) / TURN), p)
        if self.latest is not None:
            self.fault = self._jump(float(time[0]), p, v, self.latest)
        if self.fault:
            return None
        self.latest = RobotReading(float(time[0]), p, v, finite_vector(reading[3], r))
        return self.latest

    def expected(self, time: float) -> RobotReading:
        """RobotReading that the last sound one lets expect at a time, by its velocities."""
        last = self.latest or RobotReading(time, self._near, np.zeros_like(self._near))
        return RobotReading(time, last.p + (time - last.time) * last.v, last.v)

    def _first(self, p: Array) -> Array:
        """Positions (r,) near which the first reading is taken: its own within limits, else the middle of the range."""
        lower, upper = self._limits.lower, self._limits.upper
        with np.errstate(invalid="ignore"):
            middle = np.where(np.isfinite(lower) & np.isfinite(upper), 0.5 * (lower + upper), self._near)
        free = ~(np.isfinite(lower) | np.isfinite(upper))
        return np.where((p >= lower) & (p <= upper) & ~free, p, middle)

    def _jump(self, time: float, p: Array, v: Array, last: RobotReading) -> str:
        if time <= last.time:
            return "a repeated measurement"
        reach = self._speed * max(time - last.time, self._period) + NOISE
        if (abs(p - last.p) > reach).any():
            return "a jump of the measured position"
        return "a speed far above the limit" if (abs(v) > self._too_fast).any() else ""
