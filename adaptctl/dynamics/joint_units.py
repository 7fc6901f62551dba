"""Units of a mechanism's joints, which turn or slide, as results state them."""

from __future__ import annotations

from collections.abc import Iterable

from adaptctl.dynamics.mechanism import Mechanism


def position_units(mechanism: Mechanism) -> tuple[str, ...]:
    """Units of position of a mechanism's r primary joints, r texts in their order."""
    return tuple(joint.kind.position_unit for joint in mechanism.primary_joints)


def position_unit(mechanism: Mechanism) -> str:
    """Unit of a position error over all primary joints of a mechanism."""
    return either(position_units(mechanism))


def error_unit(mechanism: Mechanism) -> str:
    """Unit in which position errors are shown, such as "mrad"."""
    return either(f"m{unit}" for unit in position_units(mechanism))


def either(units: Iterable[str]) -> str:
    """Unit of a number that takes all of several joints together."""
    return " or ".join(sorted(set(units), reverse=True))
