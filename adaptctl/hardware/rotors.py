"""Rotor inertias for joints whose description has none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NotFoundError, SimplificationWarning, validate_kind, warn
from adaptctl.tuning.rotors import rotorless

ROTOR = 0.02
"""kg m^2 of rotor inertia at a joint of 1 N m; it grows with the square root of the torque limit. Those of an FR3 in
MuJoCo's menagerie, 0.195 at 87 N m and 0.074 at 12 N m, are met within 7 %."""


class RotorProfile(NamedTuple):
    """
    Published rotor inertias of a type of robot.

    Parameters
    ----------
    inertias : tuple of float
        Rotor inertias (r,) at the joints in kg m^2.
    source : str
        Where they are published.

    Examples
    --------
    >>> from adaptctl.hardware import ROTOR_PROFILES
    >>> len(ROTOR_PROFILES["fr3"].inertias)
    7
    """

    inertias: tuple[float, ...]
    source: str


ROTOR_PROFILES: Mapping[str, RotorProfile] = {
    "fr3": RotorProfile(
        (0.605721456, 0.605721456, 0.462474144, 0.462474144, 0.205544064, 0.205544064, 0.205544064),
        "reflected inertias provided by Franka, in manipulation/models/franka_description/README.md of Drake",
    ),
    "fr3-menagerie": RotorProfile((*4 * [0.195], *3 * [0.074]), "franka_fr3/fr3.xml of MuJoCo's menagerie"),
}
"""Published rotor inertias by type"""


def with_rotors(mechanism: Mechanism, profile: str | None = None) -> Mechanism:
    """
    Return the mechanism with rotor inertias for its revolute joints, where its description has none.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    profile : str, optional
        Name of published inertias in `ROTOR_PROFILES`. Default: a guess from the torque limits.

    Returns
    -------
    Mechanism
        Mechanism with rotor inertias, which are learned; the same if none is missing.

    Raises
    ------
    NotFoundError
        If the profile is unknown.
    InputError
        If the profile is of another number of joints, or the mechanism none.

    Warns
    -----
    SimplificationWarning
        If rotor inertias were guessed: gains follow from them.

    Notes
    -----
    The guess is 0.02 kg m^2 times the square root of the torque limit in N m. Gains need it within a factor of three;
    the estimate is learned.

    Examples
    --------
    >>> import warnings
    >>> from adaptctl.hardware import with_rotors
    >>> with warnings.catch_warnings(action="ignore"):
    ...     geared = with_rotors(arm)
    >>> geared.parameter_names[-2:]
    ('shoulder.rotor_inertia', 'elbow.rotor_inertia')
    """
    validate_kind(mechanism, Mechanism, "with_rotors", "as load(...) gives one")
    missing = rotorless(mechanism)
    inertias = _guessed(mechanism) if profile is None else _published(mechanism, profile)
    if not missing:
        return mechanism
    if profile is None:
        warn(
            f"{mechanism.name}: the description has no rotor inertia of {', '.join(missing)}: guessed from torque "
            "limits, and learned; gains follow from them, so give measured ones if you have them",
            SimplificationWarning,
        )
    return having_rotors(mechanism, {name: inertias[name] for name in missing})


def having_rotors(mechanism: Mechanism, inertias: Mapping[str, float | None]) -> Mechanism:
    """Mechanism with rotor inertias by its joints' names, where its description has none."""
    drives = [link.joint.drive for link in mechanism.links]
    given = [inertias.get(link.joint.name) for link in mechanism.links]
    return mechanism.with_drives(
        [replace(d, rotor_inertia=x) if d.rotor_inertia is None else d for d, x in zip(drives, given, strict=True)]
    )


def _guessed(mechanism: Mechanism) -> dict[str, float]:
    """Inertias that follow from the torque limits."""
    return {joint.name: float(f"{ROTOR * joint.limits.effort**0.5:.3g}") for joint in mechanism.primary_joints}


def _published(mechanism: Mechanism, profile: str) -> dict[str, float]:
    """Inertias of a profile."""
    if profile not in ROTOR_PROFILES:
        raise NotFoundError(f"rotors: unknown profile {profile!r}; known: {', '.join(ROTOR_PROFILES)}")
    values, names = ROTOR_PROFILES[profile].inertias, [joint.name for joint in mechanism.primary_joints]
    if len(values) != len(names):
        raise InputError(f"rotors: {profile} has {len(values)} joints, but {mechanism.name} has {len(names)}")
    return dict(zip(names, values, strict=True))
