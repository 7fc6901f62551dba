"""Models of the friction and springs of a robot's drives."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.drive import Drive, DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification.drives_file import Drives

ALWAYS = (DriveParameter.VISCOUS, DriveParameter.COULOMB)
CURVES = ((), (DriveParameter.SQUARE_ROOT,), (DriveParameter.STRIBECK,))
OFFSETS = ((), (DriveParameter.OFFSET,))


@dataclass(frozen=True)
class FrictionModel:
    """Terms of friction and springs that are modelled."""

    kinds: tuple[DriveParameter, ...] = ALWAYS

    @property
    def words(self) -> str:
        """Names of the terms, separated by commas, such as "viscous, coulomb"."""
        return ", ".join(kind.value for kind in self.kinds)

    @classmethod
    def named(cls, words: str) -> FrictionModel:
        """Friction model of terms named in a text."""
        if not isinstance(words, str):
            raise InputError(f"friction: expected a text such as viscous,coulomb, got {words!r}")
        names = [name.strip() for name in words.split(",") if name.strip()]
        known = {kind.value: kind for kind in DriveParameter if not kind.is_rotor}
        if unknown := [name for name in names if name not in known]:
            raise InputError(f"friction: expected some of {', '.join(known)}, got {unknown[0]!r}")
        kinds = tuple(kind for name, kind in known.items() if name in names)
        return cls(kinds)

    def also(self, kinds: Iterable[DriveParameter]) -> FrictionModel:
        """Model with further terms."""
        every = {*self.kinds, *kinds}
        return FrictionModel(tuple(kind for kind in DriveParameter if kind in every))

    def columns(self, mechanism: Mechanism) -> Array:
        """Mask (P,) of links' parameters, rotor inertias and the model's terms."""
        drives = mechanism.description.drive_parameters
        kept = [float(kind in (*self.kinds, DriveParameter.ROTOR_INERTIA)) for _, kind in drives]
        return np.concatenate([np.ones(len(mechanism.parameter_names) - len(drives)), np.array(kept)])


CANDIDATES = tuple(FrictionModel((*ALWAYS, *curve, *offset)) for curve in CURVES for offset in OFFSETS)
SIMPLE_FRICTION = FrictionModel((*ALWAYS, DriveParameter.OFFSET))
"""Friction of fits that others are measured by: viscous and Coulomb, about an offset."""


def with_all_friction(mechanism: Mechanism, drives: Drives) -> Mechanism:
    """Mechanism whose primary drives, coupled by `drives`, have rotors, all friction and their own springs, zero."""
    if mechanism.unconstrained is not mechanism:
        raise InputError(
            f"{mechanism.name}: identification does not support constraints on the parameters; give "
            "`mechanism.unconstrained`"
        )
    coupled = dict(zip(drives.joints, drives.joint_drives(), strict=True))
    each = [_with_all(link.joint.drive, coupled.get(link.joint.name)) for link in mechanism.links]
    return mechanism.with_drives(each)


def unmoved_terms(mechanism: Mechanism, still: Collection[str]) -> tuple[str, ...]:
    """Names of friction and rotor inertias of drives whose joints all stand still."""
    terms = ((mechanism.links[i].joint, kind) for i, kind in mechanism.description.drive_parameters)
    told = {DriveParameter.OFFSET, *(kind for kind in DriveParameter if kind.is_spring)}
    return tuple(
        f"{joint.name}.{kind.value}"
        for joint, kind in terms
        if kind not in told and {joint.name, *(name for name, _ in joint.drive.turns_with)} <= set(still)
    )


def _with_all(own: Drive, coupled: Drive | None) -> Drive:
    if coupled is None:
        return own
    kinds = [kind for kind in DriveParameter if not kind.is_spring or own.value(kind) is not None]
    return coupled.with_terms(dict.fromkeys(kinds, 0.0))
