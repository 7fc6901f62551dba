"""Limitations of each joint's gains, in words."""

from __future__ import annotations

from adaptctl.dynamics import Mechanism
from adaptctl.tuning.carried_gains import CarriedGains

MORE = 4.0
"""times as much damping, for which a rotor is named"""


def limitations(mechanism: Mechanism, carried: CarriedGains) -> tuple[str, ...]:
    """Sentences (a tuple of r texts), one for each of the `mechanism`'s r joints, on what limits its gains, Slotine and
    Li's bandwidth and damping. It is the control period, named with the rotor inertia that would allow four times the
    damping, or the torque limit. `carried` has the gains and what limits each. Nothing is checked."""
    return tuple(_limitation(mechanism, carried, j) for j in range(mechanism.dof))


def _limitation(mechanism: Mechanism, carried: CarriedGains, j: int) -> str:
    joint = mechanism.primary_joints[j]
    unit = "kg m²" if joint.kind.turns else "kg"
    if carried.by_hold[j]:
        rotor = (MORE - 1.0) * carried.free_inertia[j]
        kind = "a rotor" if joint.kind.turns else "a drive"
        return f"the control period holds K low: {kind} of {rotor:.1g} {unit} would allow {MORE:g} times"
    if carried.by_torque[j]:
        return "its torque limit holds Λ and K low"
    return "its torque limit holds K low"
