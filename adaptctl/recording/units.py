"""Units of joints, as recordings and reports write them."""

from __future__ import annotations

from adaptctl.dynamics import Mechanism


def position_units(mechanism: Mechanism) -> tuple[str, ...]:
    """Units of the primary joints' positions (r,): rad or m."""
    return tuple(joint.kind.position_unit for joint in mechanism.primary_joints)


def torque_units(mechanism: Mechanism) -> tuple[str, ...]:
    """Units of the primary joints' torques (r,): N·m or N."""
    return tuple(typeset(joint.kind.effort_unit) for joint in mechanism.primary_joints)


def error_unit(mechanism: Mechanism) -> str:
    """Unit of a thousandth of a primary joint's position: mrad, mm, or either."""
    return " or ".join(f"m{unit}" for unit in sorted(set(position_units(mechanism)), reverse=True))


def typeset(unit: str) -> str:
    """Text of a unit as pages show it: ``kg m^2`` is ``kg·m²``."""
    if unit == "us":
        return "µs"
    return unit.replace(" ", "·").replace("^2", "²").replace("^1/2", "^½")
