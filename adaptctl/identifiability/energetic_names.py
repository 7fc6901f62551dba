"""Names of the parameters that enter the energy."""

from __future__ import annotations

from adaptctl.dynamics import Mechanism


def energetic_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the P inertial parameters of a mechanism that enter its kinetic or potential energy, such as
    ``link3.I_xx``, in the mechanism's order: all but friction, which energies cannot show. Nothing is raised."""
    return mechanism.parameter_names[: mechanism.energetic]
