"""Friction models of a robot's drives: candidates that an inner validation chooses from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.drive import DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.drive import SLOW
from adaptctl.errors import InputError
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.filtered_dynamics import RowFilter, SmoothMotion
from adaptctl.identification.fir_filter import AROUND

ALWAYS = (DriveParameter.VISCOUS, DriveParameter.COULOMB)
CURVES = ((), (DriveParameter.SQUARE_ROOT,), (DriveParameter.STRIBECK,))
OFFSETS = ((), (DriveParameter.OFFSET,))


@dataclass(frozen=True)
class FrictionModel:
    """A friction model: the terms of `Drive` that are modelled, and whether friction grows with the load besides.

    Load-dependent friction is mu |rigid torque| sign(s) a drive (Hamon, Gautier and Garrec 2010): linear in mu once
    the rigid torques are known, so it is found in a second round. Mechanisms do not have it.
    """

    kinds: tuple[DriveParameter, ...] = ALWAYS
    load: bool = False

    @property
    def words(self) -> str:
        """Names of the model's terms, separated by commas."""
        return ", ".join([*(kind.value for kind in self.kinds), *(["load"] if self.load else [])])

    @classmethod
    def named(cls, words: str) -> FrictionModel:
        """The friction model with these terms, named and separated by commas. Raises `InputError` for an unknown
        name."""
        names = [name.strip() for name in words.split(",") if name.strip()]
        known = {kind.value: kind for kind in DriveParameter if kind.is_friction}
        if unknown := [name for name in names if name not in (*known, "load")]:
            raise InputError(f"friction: expected some of {', '.join((*known, 'load'))}, got {unknown[0]!r}")
        kinds = tuple(kind for name, kind in known.items() if name in names)
        return cls(kinds, "load" in names)

    def columns(self, mechanism: Mechanism) -> Array:
        """Mask (P,) of 0 and 1: the parameters of a mechanism with all kinds of friction that belong to the model."""
        drives = mechanism.description.drive_parameters
        kept = [float(kind in (*self.kinds, DriveParameter.ROTOR_INERTIA)) for _, kind in drives]
        return np.concatenate([np.ones(len(mechanism.parameter_names) - len(drives)), np.array(kept)])


CANDIDATES = tuple(FrictionModel((*ALWAYS, *curve, *offset)) for curve in CURVES for offset in OFFSETS)


def with_all_friction(mechanism: Mechanism, drives: Drives) -> Mechanism:
    """The mechanism with a rotor and every kind of friction in every primary joint, zero each, coupled as its drives
    are; other joints keep what they have."""
    terms = dict.fromkeys(DriveParameter, 0.0)
    own = {name: drive.with_terms(terms) for name, drive in zip(drives.joints, drives.on_joints(), strict=True)}
    each = [own.get(link.joint.name, link.joint.drive) for link in mechanism.links]
    return mechanism.with_drives(each)


def load_columns(
    motions: Sequence[SmoothMotion], mechanism: Mechanism, x: Array, cutoff: float, drives: Drives
) -> Array:
    """The columns (n, r, r) of every drive's load-dependent friction, with rigid torques of parameters x (P,), in the
    motions' rows at a cut-off (Hz)."""
    rigid = mechanism.with_parameters(np.where(_friction(mechanism), 0.0, x[: len(mechanism.parameter_names)]))
    parts = []
    for motion in motions:
        row_filter = RowFilter.of(motion, cutoff)
        parts.append(row_filter.signal(_unfiltered(motion, rigid, drives))[row_filter.moving(motion)])
    return np.concatenate(parts)


def _unfiltered(motion: SmoothMotion, rigid: Mechanism, drives: Drives) -> Array:
    """Regressor (m, r, r) of load-dependent friction: |rigid torque| sign(shaft's speed), on the joints that the shaft
    turns with."""
    inner = slice(AROUND, -AROUND)
    p, v = motion.position[inner], motion.velocity[inner]
    torque = np.abs(rigid.inverse_dynamics(p, v, motion.acceleration()))
    ratios = drives.transmission / np.diag(drives.transmission)[:, None]
    speed = v @ ratios.T
    share = torque * speed / np.sqrt(speed**2 + SLOW**2)
    return np.pad(share[:, None, :] * ratios.T, ((AROUND, AROUND), (0, 0), (0, 0)))


def _friction(mechanism: Mechanism) -> Array:
    """(P,) 1 for friction's parameters."""
    P = len(mechanism.parameter_names)
    return (np.arange(P) >= mechanism.energetic).astype(np.float64)
