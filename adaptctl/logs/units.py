"""Units of a log's columns."""

from __future__ import annotations

import math
import re

TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
POSITION = {"rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi, "m": 1.0, "mm": 1e-3, "mrad": 1e-3}
VELOCITY = {"rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.pi / 30.0, "m/s": 1.0, "mm/s": 1e-3}
TORQUE = {"N m": 1.0, "mN m": 1e-3, "N": 1.0}
# Units of quantities that are only proportional to a torque.
OTHER_TORQUE = ("A", "mA", "%", "1")
SPELLINGS = {
    "°": "deg",
    "°/s": "deg/s",
    "degree": "deg",
    "degrees": "deg",
    "radian": "rad",
    "radians": "rad",
    "sec": "s",
}


def spaced(symbol: str) -> str:
    """Unit's symbol as the tables of factors have it: "Nm" becomes "N m"."""
    return SPELLINGS.get(symbol, re.sub("N[*.·]?m", "N m", symbol))


def is_unit(symbol: str) -> bool:
    """True for a unit of a log's column, or a dash or nothing in its place."""
    return spaced(symbol) in (*TIME, *POSITION, *VELOCITY, *TORQUE, *OTHER_TORQUE, "", "-")
