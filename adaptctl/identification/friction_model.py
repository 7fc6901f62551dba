"""Friction models of a robot's drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.drive import DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification.drives_file import Drives

ALWAYS = (DriveParameter.VISCOUS, DriveParameter.COULOMB)
CURVES = ((), (DriveParameter.SQUARE_ROOT,), (DriveParameter.STRIBECK,))
OFFSETS = ((), (DriveParameter.OFFSET,))


@dataclass(frozen=True)
class FrictionModel:
    """Friction terms that are modelled."""

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
        known = {kind.value: kind for kind in DriveParameter if kind.is_friction}
        if unknown := [name for name in names if name not in known]:
            raise InputError(f"friction: expected some of {', '.join(known)}, got {unknown[0]!r}")
        kinds = tuple(kind for name, kind in known.items() if name in names)
        return cls(kinds)

    def columns(self, mechanism: Mechanism) -> Array:
        """Mask (P,) of links' parameters, rotor inertias and the model's friction terms."""
        drives = mechanism.description.drive_parameters
        kept = [float(kind in (*self.kinds, DriveParameter.ROTOR_INERTIA)) for _, kind in drives]
        return np.concatenate([np.ones(len(mechanism.parameter_names) - len(drives)), np.array(kept)])


CANDIDATES = tuple(FrictionModel((*ALWAYS, *curve, *offset)) for curve in CURVES for offset in OFFSETS)


def with_all_friction(mechanism: Mechanism, drives: Drives) -> Mechanism:
    """Mechanism with a rotor and every kind of friction in each primary drive, zero, coupled by `drives`."""
    if mechanism.unconstrained is not mechanism:
        raise InputError(
            f"{mechanism.name}: identification does not support constraints on the parameters; give "
            "`mechanism.unconstrained`"
        )
    terms = dict.fromkeys(DriveParameter, 0.0)
    own = {name: drive.with_terms(terms) for name, drive in zip(drives.joints, drives.joint_drives(), strict=True)}
    each = [own.get(link.joint.name, link.joint.drive) for link in mechanism.links]
    return mechanism.with_drives(each)
