"""Robots for tests of `drive`: MuJoCo's, with a record of what they were sent, and with faults."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

import numpy as np

import adaptctl
from adaptctl.control.controller import ReferencePoint
from adaptctl.hardware import MuJoCoRobot, RobotReading

ARM = adaptctl.load("two_link")
FAULTS: dict[str, Callable[[RobotReading, RobotReading], Any]] = {
    "nan": lambda r, last: RobotReading(r.time, r.p * np.nan, r.v),
    "infinite": lambda r, last: RobotReading(r.time, r.p, r.v * np.inf),
    "none": lambda r, last: None,
    "repeated": lambda r, last: last,
    "turned": lambda r, last: RobotReading(r.time, r.p + 2.0 * np.pi, r.v),
    "jumping": lambda r, last: RobotReading(r.time, r.p + np.array([0.0, 0.5]), r.v),
    "fast": lambda r, last: RobotReading(r.time, r.p, r.v + 50.0),
    "short": lambda r, last: RobotReading(r.time, r.p[:1], r.v),
    "late": lambda r, last: RobotReading(r.time + 0.3 * 0.004, r.p, r.v),
    "early": lambda r, last: RobotReading(last.time + 1e-6, r.p, r.v),
    "words": lambda r, last: RobotReading("now", "p", "v"),  # type: ignore[arg-type]
}


class RecordedRobot(MuJoCoRobot):
    """MuJoCo's robot, which keeps every torque and every posture once it is driven."""

    def start(self, torque: Any) -> None:
        self.sent, self.states, self.tick = [np.array(torque)], [self.states_now()], 0
        super().start(torque)

    def states_now(self) -> Any:
        return np.concatenate((self._state.p, self._state.v))

    def read(self) -> RobotReading:
        reading = super().read()
        if hasattr(self, "sent") and not self._braked:
            self.tick += 1
            self.states.append(self.states_now())
        return reading

    def write(self, torque: Any) -> None:
        self.sent.append(np.array(torque))
        super().write(torque)

    @property
    def breaches(self) -> list[str]:
        """What was beyond a limit."""
        sent, states, r = np.array(self.sent), np.array(self.states), self.plant.dof
        found = {
            "torque": np.abs(sent) > self.limits.torque,
            "rate": np.abs(np.diff(sent, axis=0)) > self.period * self.limits.torque_rate,
            "range": (states[:, :r] < self.limits.lower) | (states[:, :r] > self.limits.upper),
        }
        return [name for name, mask in found.items() if mask.any() or not np.isfinite(sent).all()]


class FaultyRobot(RecordedRobot):
    """Robot whose measurements are wrong for some ticks, or that refuses torques."""

    fault = ""
    faults: tuple[tuple[int, int], ...] = ()  # first tick and length
    interrupted_at = -1

    def read(self) -> RobotReading:
        reading = super().read()
        if not hasattr(self, "sent"):
            return reading
        if self.tick == self.interrupted_at:
            signal.raise_signal(signal.SIGINT)
        if any(since <= self.tick < since + length for since, length in self.faults):
            if self.fault == "closed":
                raise OSError("the socket is closed")
            if self.fault in FAULTS:
                return FAULTS[self.fault](reading, self.last)
        self.last = reading
        return reading

    def write(self, torque: Any) -> None:
        if self.fault == "refused" and self.tick >= self.faults[0][0]:
            raise RuntimeError("motion aborted")
        super().write(torque)


class LyingReference:
    """Reference that stands still where it is checked, and runs off when it is followed."""

    def __init__(self, p: Any, v: Any) -> None:
        self.p, self.v = p, v

    def __call__(self, t: Any) -> ReferencePoint:
        rest = np.zeros_like(np.asarray(t, dtype=np.float64)[..., None] * self.p)
        return ReferencePoint(rest + self.p, rest, rest)

    def at(self, t: float) -> ReferencePoint:
        """Point of a start within 0.6 s, then full speed."""
        u = min(max(t - 0.6, 0.0) / 0.6, 1.0)
        p = self.p + self.v * (0.3 * u * u + max(t - 1.2, 0.0))
        return ReferencePoint(p, self.v * u, self.v / 0.6 if 0.0 < u < 1.0 else 0.0 * self.v)
