"""The units of a log's columns: stated, or refused."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from adaptctl.errors import InputError

TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
POSITION = {"rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi, "m": 1.0, "mm": 1e-3}
VELOCITY = {"rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.pi / 30.0, "m/s": 1.0, "mm/s": 1e-3}
TORQUE = {"N m": 1.0, "mN m": 1e-3, "N": 1.0}
TURNING = {"position": ("rad", "deg", "rev"), "velocity": ("rad/s", "deg/s", "rpm"), "torque": ("N m", "mN m")}
SLIDING = {"position": ("m", "mm"), "velocity": ("m/s", "mm/s"), "torque": ("N",)}
"""Units of revolute and of prismatic joints."""
OTHER_TORQUE = ("A", "mA", "%", "1")
"""Units of quantities that are only proportional to a torque."""


@dataclass(frozen=True)
class Units:
    """Units of a log's columns, as factors to SI units: of `time` to s, of `position` to rad (or m), and of `torque` to
    N m (or N), None where the column is only proportional to a torque. `velocity` is the factor to rad/s (or m/s),
    None, the default, where it is not logged. Nothing is checked at construction."""

    time: float
    position: float
    torque: float | None
    """None where the column is only proportional to a torque"""
    velocity: float | None = None

    @classmethod
    def checked(cls, time: str, position: str, torque: str, velocity: str | None = None) -> Units:
        """The units, a `Units`, of columns by symbols: `time` one of s, ms, us, ns; `position` one of rad, deg, rev, m,
        mm; `torque` one of N m (or Nm), mN m, N, or A, mA, %, 1 for a quantity that is only proportional to it;
        `velocity` one of rad/s, deg/s, rpm, m/s, mm/s, or None where it is not logged. Raises `InputError`, which lists
        those that are known, for another symbol."""
        return cls(
            _factor("time", time, TIME),
            _factor("position", position, POSITION),
            None if torque in OTHER_TORQUE else _factor("torque", spaced(torque), TORQUE, OTHER_TORQUE),
            None if velocity is None else _factor("velocity", velocity, VELOCITY),
        )


def require_fitting(symbols: Mapping[str, str], turns: Mapping[str, bool]) -> None:
    """Raise `InputError`, naming the joint, where a unit cannot be that of a joint's column: one of angles for a joint
    that slides, or one of lengths for one that turns. `symbols` has the units' symbols by "position", "velocity" and
    "torque", other keys do not count, and `turns` by joint whether it turns. SI units are those of joints of both kinds
    where some slide: one column of a message has rad or m, whichever is its joint's."""
    for what, symbol in symbols.items():
        for joint, turning in turns.items():
            own, others = (TURNING, SLIDING) if turning else (SLIDING, TURNING)
            foreign = spaced(symbol) in others.get(what, ())
            if foreign and (spaced(symbol) != others[what][0] or all(turns.values())):
                *first, last = own[what]
                expected = f"{', '.join(first)} or {last}" if first else last
                kind = "turns" if turning else "slides"
                raise InputError(f"unit of {what}: joint {joint!r} {kind}: expected {expected}, got {symbol!r}")


def spaced(symbol: str) -> str:
    """A unit's `symbol`, a text, as tables of factors have it: "Nm" becomes "N m". Nothing is raised."""
    return symbol.replace("Nm", "N m")


def _factor(what: str, symbol: str, known: dict[str, float], others: tuple[str, ...] = ()) -> float:
    if symbol not in known:
        raise InputError(f"unit of {what}: expected one of {', '.join((*known, *others))}, got {symbol!r}")
    return known[symbol]
