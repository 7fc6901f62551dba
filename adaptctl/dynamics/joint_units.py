"""Units of joints, for results."""

from __future__ import annotations

from collections.abc import Iterable

from adaptctl.dynamics.mechanism import Mechanism


def position_units(mechanism: Mechanism) -> tuple[str, ...]:
    """Units of position of the r primary joints."""
    return tuple(joint.kind.position_unit for joint in mechanism.primary_joints)


def position_unit(mechanism: Mechanism) -> str:
    """Unit of a position error over all primary joints."""
    return either(position_units(mechanism))


def error_unit(mechanism: Mechanism) -> str:
    """Unit for showing position errors, such as "mrad"."""
    return either(f"m{unit}" for unit in position_units(mechanism))


def either(units: Iterable[str]) -> str:
    """Common unit of several joints."""
    return " or ".join(sorted(set(units), reverse=True))
