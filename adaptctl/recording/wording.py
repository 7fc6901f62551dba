"""Numbers and their units as text, the same in recordings, figures and reports."""

from __future__ import annotations

import math

from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import either
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


TURNING = {"m": "kg", "viscous": "N m s", "square_root": "N m s^1/2"}
TURNING |= dict.fromkeys(("coulomb", "stribeck", "offset"), "N m")
SLIDING = {"m": "kg", "viscous": "N s/m", "square_root": "N s^1/2 m^-1/2", "rotor_inertia": "kg"}
SLIDING |= dict.fromkeys(("coulomb", "stribeck", "offset"), "N")
"""Units of masses, and of the drives of joints that turn and of those that slide."""


def torque_units(mechanism: Mechanism) -> tuple[str, ...]:
    """Units of torque of a mechanism's r primary (independent) joints, r texts in their order: "N·m", or "N" for a
    prismatic joint's force. Nothing is raised."""
    return tuple(typeset(joint.kind.effort_unit) for joint in mechanism.primary_joints)


def torque_error_unit(mechanism: Mechanism) -> str:
    """Unit, as text, of a torque error over all primary (independent) joints of a mechanism: "N·m", "N" where all are
    prismatic, or "N·m or N" where joints are of both kinds. Nothing is raised."""
    return either(torque_units(mechanism))


def coupling_unit(mechanism: Mechanism) -> str:
    """Unit, as text, of the entries off the diagonal of a mechanism's mass matrix, over all pairs of its primary
    (independent) joints: "kg m²" where all are revolute or there is one joint alone, "kg" where all are prismatic, "kg
    m" for one of each kind; with more joints of both kinds, those that occur, joined by "or". Nothing is raised."""
    turns = [joint.kind.is_revolute for joint in mechanism.primary_joints]
    found = {first + second for i, first in enumerate(turns) for second in turns[:i]}
    return " or ".join(("kg", "kg m", "kg m²")[power] for power in sorted(found or {2}, reverse=True))


def typeset(unit: str) -> str:
    """Typeset text of a `unit`, as report pages show it: "kg m^2" becomes "kg·m²". Spaces become middle dots, "^2" and
    "^1/2" raised signs, and "us" is "µs"; all else stays as it is. Nothing is raised."""
    if unit == "us":
        return "µs"
    return unit.replace(" ", "·").replace("^2", "²").replace("^1/2", "^½")


def parameter_unit(name: str, mechanism: Mechanism) -> str:
    """Unit, as text, of an inertial or friction parameter of a mechanism by its name: "kg m" for "link2.mc_x". What
    follows the last dot decides: "m" has kg; "mc_x", "mc_y", "mc_z" kg m; "viscous" N m s; "square_root" N m s^1/2;
    "coulomb", "stribeck" and "offset" N m; all others, moments and rotor inertias, kg m^2. Drives of prismatic joints
    have N s/m, N s^1/2 m^-1/2, N, and kg for a rotor's inertia. No name raises an error."""
    owner, _, kind = name.rpartition(".")
    slides = any(link.joint.name == owner and not link.joint.kind.is_revolute for link in mechanism.links)
    units = SLIDING if slides else TURNING
    return units.get(kind, "kg m" if kind.startswith("mc_") else "kg m^2")
