"""Units of a log's columns, as factors to SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from adaptctl.errors import InputError
from adaptctl.logs.units import OTHER_TORQUE, POSITION, TIME, TORQUE, VELOCITY, spaced

TURNING = {"position": ("rad", "deg", "rev"), "velocity": ("rad/s", "deg/s", "rpm"), "torque": ("N m", "mN m")}
# Units of revolute and of prismatic joints.
SLIDING = {"position": ("m", "mm"), "velocity": ("m/s", "mm/s"), "torque": ("N",)}


@dataclass(frozen=True)
class Units:
    """Factors from the units of a log's columns to SI units; None for a torque column without unit of torque."""

    time: float
    position: float
    torque: float | None
    velocity: float | None = None

    @classmethod
    def checked(cls, time: str, position: str, torque: str, velocity: str | None = None) -> Units:
        """Units by their symbols; `InputError` for unknown ones, all in one message."""
        given = {"time": (time, TIME), "position": (spaced(position), POSITION), "velocity": (velocity, VELOCITY)}
        if torque not in OTHER_TORQUE:
            given["torque"] = spaced(torque), TORQUE
        found, wrong = dict.fromkeys(("time", "position", "torque", "velocity"), 1.0), list[str]()
        for what, (symbol, known) in given.items():
            try:
                found[what] = 1.0 if symbol is None else _factor(what, symbol, known, OTHER_TORQUE * (what == "torque"))
            except InputError as error:
                wrong.append(str(error))
        if wrong:
            raise InputError("; ".join(wrong))
        return cls(
            found["time"],
            found["position"],
            None if torque in OTHER_TORQUE else found["torque"],
            None if velocity is None else found["velocity"],
        )


def validate_fitting(symbols: Mapping[str, str], turns: Mapping[str, bool]) -> None:
    """Raise `InputError` for a unit of angle on a joint that slides, or of length on one that turns."""
    for what, symbol in symbols.items():
        for joint, turning in turns.items():
            own, others = (TURNING, SLIDING) if turning else (SLIDING, TURNING)
            whole = spaced(symbol).partition("/")[0] if what == "position" else spaced(symbol)
            foreign = whole in others.get(what, ())
            if foreign and (whole != others[what][0] or all(turns.values())):
                *first, last = own[what]
                expected = f"{', '.join(first)} or {last}" if first else last
                kind = "turns" if turning else "slides"
                raise InputError(f"unit of {what}: joint {joint!r} {kind}: expected {expected}, got {symbol!r}")


def _factor(what: str, symbol: str, known: dict[str, float], others: tuple[str, ...] = ()) -> float:
    whole, mark, count = symbol.rpartition("/")
    if mark and count.isdecimal() and int(count) and whole in known:
        return known[whole] / int(count)
    if symbol not in known:
        counts = "; for counts, a unit over their number, such as rev/4096" if what == "position" else ""
        raise InputError(f"unit of {what}: expected one of {', '.join((*known, *others))}{counts}, got {symbol!r}")
    return known[symbol]
