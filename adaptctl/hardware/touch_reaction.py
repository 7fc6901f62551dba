"""Touches of a driven arm, and what it does then: stop, comply, or retract."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Touch
from adaptctl.control.adaptation.doubt import YOUTH
from adaptctl.control.controller import Controller, Reference, ReferencePoint
from adaptctl.control.minimum_jerk import quintic
from adaptctl.errors import InputError
from adaptctl.hardware.checks import innermost
from adaptctl.hardware.force_sensor import ForceSensor

Reaction: TypeAlias = Literal["ignore", "stop", "comply", "retract"]
BACK = 1.0
"""s of the path that a retreat goes back"""
CALM = 1.0
"""s without a touch after which a touch is over"""
CLAMPED = 0.3
"""s of touch at rest after which what is touched is clamped"""
SENSOR = "force sensor"
"""name of what feels a measured force"""
SOFT = 0.2
"""share of the controller's damping that a complying arm keeps"""


class TouchEvent(NamedTuple):
    """
    Touch of a driven arm.

    Parameters
    ----------
    time : float
        Time in s.
    joint : str
        Joint whose external torque passed its level by most, or "force sensor".
    torque, level : float
        External torque and its level in N m (N), or measured force and what is a touch in N.
    unit : str, default "N m"
        Their unit.

    Examples
    --------
    >>> from adaptctl.hardware import TouchEvent
    >>> print(TouchEvent(2.0, "elbow", -5.21, 1.13))
    elbow felt -5.2 N m, above its level of 1.1 N m
    """

    time: float
    joint: str
    torque: float
    level: float
    unit: str = "N m"

    def __str__(self) -> str:
        return f"{self.joint} felt {self.torque:.2g} {self.unit}, above its level of {self.level:.2g} {self.unit}"


class Feeling:
    """Touches of a run, from the states of its controller."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names, self.events, self._last, self._free = names, list[TouchEvent](), -np.inf, -np.inf
        self.torque, self.touched = np.zeros(len(names)), False

    def feel(self, state: Any, time: float, sensor: ForceSensor | None = None) -> None:
        """Take up external torques of a state and a measured force, and whether they are a touch."""
        felt = self._by_torque(state)
        if felt is None and sensor is not None and sensor.pressed:
            felt = (SENSOR, sensor.pressed, sensor.level, "N")
        self.touched = felt is not None
        if felt is None:
            self._free = time
            return
        if time - self._last > CALM:
            self.events.append(TouchEvent(time, *felt))
        self._last = time

    def _by_torque(self, state: Any) -> tuple[str, float, float, str] | None:
        """Joint whose external torque passes its level by most, with both; None if none does."""
        touch, watch = touch_of(state), getattr(getattr(innermost(state), "law_state", None), "watch", None)
        if touch is None or watch is None:
            return None
        self.torque, level = np.array(touch.torque), np.array(touch.level)
        ready = watch.age[0] >= YOUTH and not watch.announced[0]
        if not ready or not (np.abs(self.torque) > level).any():
            return None
        k = int(np.argmax(np.abs(self.torque) - level))
        return self.names[k], float(self.torque[k]), float(level[k]), "N m"

    def clamps(self, since: float, time: float) -> bool:
        """True if something was felt all the time since the arm came to rest, for long enough."""
        return self.touched and time - max(since, self._free) > CLAMPED

    def over(self, time: float) -> bool:
        """True if nothing was felt for a while."""
        return time - self._last > CALM


@dataclass(frozen=True, eq=False)
class Retreat:
    """Path that turns round at a time, or later from there, goes back the way it came, and comes to rest."""

    path: Reference
    time: float
    seconds: float
    later: float = 0.0

    @property
    def back(self) -> float:
        """Time in s that is gone back at the path's own speed."""
        return max(0.0, min(BACK, self.time - 0.5 * self.seconds))

    @property
    def end(self) -> float:
        """Time in s at which it is at rest."""
        return self.time + self.later + 3.0 * self.seconds + self.back

    def __call__(self, t: Any) -> ReferencePoint:
        """Reference point at some times (...) in s."""
        passed = np.maximum(np.asarray(t, dtype=np.float64) - self.time - self.later, 0.0)
        d, b = self.seconds, self.back
        turned, slowed = np.clip(passed / (2.0 * d), 0.0, 1.0), np.clip((passed - 2.0 * d - b) / d, 0.0, 1.0)
        back = np.clip(passed - 2.0 * d, 0.0, b)
        way = 2.0 * d * turned - 4.0 * d * _area(turned) - back - d * (slowed - _area(slowed))
        (turning, turns), (slowing, slows) = (quintic(u)[:2] for u in (turned, slowed))
        rate, change = 1.0 - 2.0 * turning + slowing, (slows - turns) / d
        inner = self.path(np.maximum(self.time + way, 0.0))
        rate, change = rate[..., None], change[..., None]
        return ReferencePoint(inner.p, inner.v * rate, inner.a * rate**2 + inner.v * change)


def yielding(p: Array, v: Array) -> ReferencePoint:
    """Point of a complying arm: where it is, and most of the velocity that it has."""
    return ReferencePoint(p, (1.0 - SOFT) * v, np.zeros_like(p))


def touch_of(state: Any) -> Touch | None:
    """State of the observer in a controller's state; None without one."""
    touch = getattr(getattr(innermost(state), "law_state", None), "touch", None)
    return touch if isinstance(touch, Touch) else None


def validate_reaction(reaction: object, controller: Controller[Any]) -> None:
    """Raise `InputError` unless a reaction is known and the controller can carry it out."""
    if reaction not in get_args(Reaction):
        raise InputError(f"on_touch: expected {', '.join(map(repr, get_args(Reaction)))}, got {reaction!r}")
    if reaction == "comply" and controller.reference_size != controller.dof:
        raise InputError(
            "on_touch: 'comply' needs a controller whose reference is in joints; use 'stop' or 'retract' in task space"
        )


def _area(u: Array) -> Array:
    """Integral of the quintic from 0."""
    return u**4 * (2.5 - 3.0 * u + u**2)
