"""Units of a log's columns, as factors to SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from adaptctl.errors import InputError
from adaptctl.logs.units import OTHER_TORQUE, POSITION, TIME, TORQUE, VELOCITY, spaced

TURNING = {"position": ("rad", "deg", "rev", "mrad"), "velocity": ("rad/s", "deg/s", "rpm"), "torque": ("N m", "mN m")}
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


def each_joint(what: str, symbol: str, joints: Sequence[str]) -> list[str]:
    """Units of a column of each joint: one for all, or a list with commas; `InputError` for another number."""
    symbols = [part.strip() for part in symbol.split(",")]
    if len(symbols) not in (1, len(joints)):
        raise InputError(
            f"unit of {what}: expected one, or one for each of {len(joints)} joints ({', '.join(joints)}), "
            f"got {len(symbols)}: {symbol}"
        )
    return symbols if len(symbols) > 1 else symbols * len(joints)


def usual_units(turns: Mapping[str, bool]) -> str:
    """Example of a list of units of positions."""
    return ",".join("deg" if turning else "mm" for turning in turns.values())


def validate_fitting(symbols: Mapping[str, Sequence[str]], turns: Mapping[str, bool], remedy: str = "") -> None:
    """Raise `InputError` for a joint's unit that is an angle where it slides, or a length where it turns."""
    for what, each in symbols.items():
        for symbol, (joint, turning) in zip(each, turns.items(), strict=True):
            own, others = (TURNING, SLIDING) if turning else (SLIDING, TURNING)
            whole = spaced(symbol).partition("/")[0] if what == "position" else spaced(symbol)
            foreign = whole in others.get(what, ())
            if foreign and (whole != others[what][0] or all(turns.values()) or len(set(each)) > 1):
                *first, last = own[what]
                expected = f"{', '.join(first)} or {last}" if first else last
                kind = "turns" if turning else "slides"
                mixed = remedy if len(set(turns.values())) > 1 else ""
                raise InputError(f"unit of {what}: joint {joint!r} {kind}: expected {expected}, got {symbol!r}{mixed}")


def factor(what: str, symbol: str) -> float:
    """Factor to SI units of a position's or velocity's unit by its symbol; `InputError` for an unknown one."""
    return _factor(what, spaced(symbol), POSITION) if what == "position" else _factor(what, symbol, VELOCITY)


def _factor(what: str, symbol: str, known: dict[str, float], others: tuple[str, ...] = ()) -> float:
    whole, mark, count = symbol.rpartition("/")
    if mark and count.isdecimal() and int(count) and whole in known:
        return known[whole] / int(count)
    if symbol not in known:
        counts = "; for counts, a unit over their number, such as rev/4096" if what == "position" else ""
        raise InputError(f"unit of {what}: expected one of {', '.join((*known, *others))}{counts}, got {symbol!r}")
    return known[symbol]
