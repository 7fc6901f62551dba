"""Friction models of a robot's drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.drive import DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.drive import COULOMB_SMOOTHING_SPEED
from adaptctl.errors import InputError
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.filtered_dynamics import RowFilter, SmoothMotion
from adaptctl.identification.preparation import DIFFERENCE_MARGIN

ALWAYS = (DriveParameter.VISCOUS, DriveParameter.COULOMB)
CURVES = ((), (DriveParameter.SQUARE_ROOT,), (DriveParameter.STRIBECK,))
OFFSETS = ((), (DriveParameter.OFFSET,))


@dataclass(frozen=True)
class FrictionModel:
    """Friction terms that are modelled, and whether load-dependent friction is (Hamon, Gautier and Garrec 2010)."""

    kinds: tuple[DriveParameter, ...] = ALWAYS
    load: bool = False

    @property
    def words(self) -> str:
        """Names of the terms, separated by commas, such as "viscous, coulomb, load"."""
        return ", ".join([*(kind.value for kind in self.kinds), *(["load"] if self.load else [])])

    @classmethod
    def named(cls, words: str) -> FrictionModel:
        """Friction model of terms named in a text."""
        if not isinstance(words, str):
            raise InputError(f"friction: expected a text such as viscous,coulomb, got {words!r}")
        names = [name.strip() for name in words.split(",") if name.strip()]
        known = {kind.value: kind for kind in DriveParameter if kind.is_friction}
        if unknown := [name for name in names if name not in (*known, "load")]:
            raise InputError(f"friction: expected some of {', '.join((*known, 'load'))}, got {unknown[0]!r}")
        kinds = tuple(kind for name, kind in known.items() if name in names)
        return cls(kinds, "load" in names)

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


def load_columns(
    motions: Sequence[SmoothMotion], mechanism: Mechanism, x: Array, cutoff: float, drives: Drives
) -> Array:
    """Regressor columns (n, r, r) of load-dependent friction in the rows of filtered motions."""
    rigid = mechanism.with_parameters(np.where(_friction(mechanism), 0.0, x[: len(mechanism.parameter_names)]))
    parts = []
    for motion in motions:
        row_filter = RowFilter.of(motion, cutoff)
        parts.append(row_filter.signal(_unfiltered(motion, rigid, drives))[row_filter.moving(motion)])
    return np.concatenate(parts)


def _unfiltered(motion: SmoothMotion, rigid: Mechanism, drives: Drives) -> Array:
    """Regressor (m, r, r) of load-dependent friction: |rigid torque| sign(shaft's speed)."""
    inner = slice(DIFFERENCE_MARGIN, -DIFFERENCE_MARGIN)
    p, v = motion.position[inner], motion.velocity[inner]
    torque = np.abs(rigid.inverse_dynamics(p, v, motion.acceleration()))
    ratios = drives.transmission / np.diag(drives.transmission)[:, None]
    speed = v @ ratios.T
    share = torque * speed / np.sqrt(speed**2 + COULOMB_SMOOTHING_SPEED**2)
    return np.pad(share[:, None, :] * ratios.T, ((DIFFERENCE_MARGIN, DIFFERENCE_MARGIN), (0, 0), (0, 0)))


def _friction(mechanism: Mechanism) -> Array:
    P = len(mechanism.parameter_names)
    return (np.arange(P) >= mechanism.num_energy_parameters).astype(np.float64)
