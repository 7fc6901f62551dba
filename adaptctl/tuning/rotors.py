"""Rotor inertias that a robot's file does not have."""

from __future__ import annotations

import numpy as np

from adaptctl.dynamics import Mechanism
from adaptctl.errors import SimplificationWarning, warn

URDF = "URDF file"
"""beginning of the source of a description from a format without rotors"""


def rotorless(mechanism: Mechanism) -> list[str]:
    """Names of driven revolute joints with a torque limit and no rotor inertia."""
    return [
        joint.name
        for joint in mechanism.primary_joints
        if joint.drive.rotor_inertia is None and joint.kind.is_revolute and np.isfinite(joint.limits.effort)
    ]


def rotor_note(mechanism: Mechanism) -> str:
    """Sentence on gains that lean on rotors which a URDF file does not have; empty for others."""
    if not mechanism.description.source.startswith(URDF) or not (names := rotorless(mechanism)):
        return ""
    return (
        f"{', '.join(names)}: URDF has no rotor inertias, so that gains are for the links alone, and geared joints of "
        "the robot may swing; give rotor_inertia in a TOML file (adaptctl new ROBOT.toml --like FILE.urdf), or use "
        "adaptctl.hardware.with_rotors in Python; adaptctl drive guesses them"
    )


def warn_of_rotors(mechanism: Mechanism) -> None:
    """Warn (`SimplificationWarning`) of gains that lean on rotors which the file does not have."""
    if note := rotor_note(mechanism):
        warn(f"{mechanism.name}: {note}", SimplificationWarning)
