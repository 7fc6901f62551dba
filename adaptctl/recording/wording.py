"""Numbers and their units as text, the same in recordings, figures and reports."""

from __future__ import annotations

import math

from adaptctl.description.drive import HARMONICS
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import either
from adaptctl.recording.page import INCOMPLETE as INCOMPLETE


def number(value: float | None, digits: int = 3) -> str:
    """Number as text with `digits` significant digits, such as "0.0123" or "2.80·10⁻¹⁴"."""
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    if 1e-4 <= abs(value) < 1e5:
        rounded = float(f"{value:.{digits}g}")
        return f"{value:.{digits}g}" if abs(rounded) < 10.0**digits else f"{value:.0f}"
    return scientific(value, digits)


def scientific(value: float, digits: int = 3) -> str:
    """Number as a multiple of a power of ten: 2.8e-14 is "2.80·10⁻¹⁴"."""
    if not math.isfinite(value):
        return "not a number" if math.isnan(value) else "infinity" if value > 0.0 else "minus infinity"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(_RAISED)}"


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def error(value: float | None, unit: str) -> str:
    """Tracking error (rad or m) as text in thousandths: 0.012 is "12 mrad"."""
    if value is None or not math.isfinite(value):
        return number(value)
    return f"{number(1e3 * value)} {unit}"


def headline(outcome_words: str, complete: bool) -> str:
    """Outcome of an experiment, after a line that says so where it was interrupted."""
    return outcome_words if complete else f"{INCOMPLETE}\n{outcome_words}"


TURNING = {"m": "kg", "viscous": "N m s", "square_root": "N m s^1/2", "stiffness": "N m/rad"}
TURNING |= dict.fromkeys(("coulomb", "stribeck", "offset", *(kind.value for kind in HARMONICS)), "N m")
SLIDING = {"m": "kg", "viscous": "N s/m", "square_root": "N s^1/2 m^-1/2", "rotor_inertia": "kg", "stiffness": "N/m"}
SLIDING |= dict.fromkeys(("coulomb", "stribeck", "offset"), "N")
"""Units of masses, and of the drives of joints that turn and of those that slide."""


def torque_units(mechanism: Mechanism) -> tuple[str, ...]:
    """Units of torque of the r primary joints: "N·m" or "N"."""
    return tuple(typeset(joint.kind.effort_unit) for joint in mechanism.primary_joints)


def torque_error_unit(mechanism: Mechanism) -> str:
    """Unit of a torque error over all joints: "N·m", "N", or "N·m or N"."""
    return either(torque_units(mechanism))


def coupling_unit(mechanism: Mechanism) -> str:
    """Unit of the mass matrix's entries off the diagonal, by the kinds of joints."""
    turns = [joint.kind.is_revolute for joint in mechanism.primary_joints]
    found = {first + second for i, first in enumerate(turns) for second in turns[:i]}
    return " or ".join(("kg", "kg m", "kg m²")[power] for power in sorted(found or {2}, reverse=True))


def typeset(unit: str) -> str:
    """Unit as report pages show it: "kg m^2" becomes "kg·m²"."""
    if unit == "us":
        return "µs"
    return unit.replace(" ", "·").replace("^2", "²").replace("^1/2", "^½")


def parameter_unit(name: str, mechanism: Mechanism) -> str:
    """Unit of an inertial or friction parameter by its name: "kg m" for "link2.mc_x"."""
    owner, _, kind = name.rpartition(".")
    slides = any(link.joint.name == owner and not link.joint.kind.is_revolute for link in mechanism.links)
    units = SLIDING if slides else TURNING
    return units.get(kind, "kg m" if kind.startswith("mc_") else "kg m^2")
