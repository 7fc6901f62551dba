"""Names of the parameters that enter the energy."""

from __future__ import annotations

from adaptctl.dynamics import Mechanism


def energetic_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the P parameters that enter the energy: all but friction, which energies can never find."""
    return mechanism.parameter_names[: mechanism.energetic]
