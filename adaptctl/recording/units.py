"""Units of joints, as recordings and reports write them."""

from __future__ import annotations

from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import either

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
    turns = [joint.kind.turns for joint in mechanism.primary_joints]
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
    slides = any(link.joint.name == owner and not link.joint.kind.turns for link in mechanism.links)
    units = SLIDING if slides else TURNING
    return units.get(kind, "kg m" if kind.startswith("mc_") else "kg m^2")
