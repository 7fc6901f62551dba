"""Numbers and their units as text, the same in recordings, figures and reports."""

from __future__ import annotations

import math

from adaptctl.recording.page import INCOMPLETE as INCOMPLETE


def number(value: float | None, digits: int = 3) -> str:
    """Number formatted as text with `digits` significant digits, 3 by default, such as "0.0123"; "–", a dash, for None.
    Numbers below 1e-4 or from 1e5 on in size are written with a power of ten, such as "2.80·10⁻¹⁴", and those from 10
    to the power `digits` on as whole numbers; NaN and infinity in words, such as "not a number". Nothing is checked."""
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    if 1e-4 <= abs(value) < 1e5:
        rounded = float(f"{value:.{digits}g}")
        return f"{value:.{digits}g}" if abs(rounded) < 10.0**digits else f"{value:.0f}"
    return scientific(value, digits)


def scientific(value: float, digits: int = 3) -> str:
    """Number formatted as text, as a multiple of a power of ten with `digits` significant digits, 3 by default: 2.8e-14
    is "2.80·10⁻¹⁴". NaN and infinity are in words: "not a number", "infinity", "minus infinity". Nothing is checked."""
    if not math.isfinite(value):
        return "not a number" if math.isnan(value) else "infinity" if value > 0.0 else "minus infinity"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(_RAISED)}"


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def error(value: float | None, unit: str) -> str:
    """Tracking error `value`, given in rad (m if prismatic), formatted as text in thousandths with their `unit`: 0.012
    and "mrad" give "12 mrad". It is "–", a dash, for None, and "not a number" or "infinity", without a unit, for NaN
    and infinity. Nothing is raised."""
    if value is None or not math.isfinite(value):
        return number(value)
    return f"{number(1e3 * value)} {unit}"


def headline(outcome_words: str, complete: bool) -> str:
    """The outcome of an experiment as text, `outcome_words`; before it, where `complete` is False, a line that says
    that the experiment was interrupted. Nothing is raised."""
    return outcome_words if complete else f"{INCOMPLETE}\n{outcome_words}"
