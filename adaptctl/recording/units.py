"""Units of joints, as recordings and reports write them."""

from __future__ import annotations

from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import either


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
