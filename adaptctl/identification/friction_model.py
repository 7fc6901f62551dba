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
from adaptctl.identification.preparation import AROUND

ALWAYS = (DriveParameter.VISCOUS, DriveParameter.COULOMB)
CURVES = ((), (DriveParameter.SQUARE_ROOT,), (DriveParameter.STRIBECK,))
OFFSETS = ((), (DriveParameter.OFFSET,))


@dataclass(frozen=True)
class FrictionModel:
    """Friction model of a robot's drives: `kinds`, the friction terms of `Drive` that are modelled (viscous and Coulomb
    by default), and `load`, True where load-dependent friction is modelled too (False by default).

    Load-dependent friction is a torque mu |rigid torque| sign(s) of each drive, with a coefficient mu (unitless), the
    rigid torque that the joint takes without friction, and the shaft's speed s (Hamon, Gautier and Garrec 2010). It is
    linear in mu once the rigid torques are known, so it is found in a second round; a `Mechanism` cannot have it.
    Nothing is checked at construction.
    """

    kinds: tuple[DriveParameter, ...] = ALWAYS
    load: bool = False

    @property
    def words(self) -> str:
        """Names of the friction model's terms, separated by commas, such as "viscous, coulomb, load"; an empty text
        where it has no terms."""
        return ", ".join([*(kind.value for kind in self.kinds), *(["load"] if self.load else [])])

    @classmethod
    def named(cls, words: str) -> FrictionModel:
        """The friction model, a `FrictionModel`, with the terms that `words` names, separated by commas: some of
        "viscous", "coulomb", "square_root", "stribeck", "offset" and "load"; none for an empty text. Raises
        `InputError` for another name, and for what is no text."""
        if not isinstance(words, str):
            raise InputError(f"friction: expected a text such as viscous,coulomb, got {words!r}")
        names = [name.strip() for name in words.split(",") if name.strip()]
        known = {kind.value: kind for kind in DriveParameter if kind.is_friction}
        if unknown := [name for name in names if name not in (*known, "load")]:
            raise InputError(f"friction: expected some of {', '.join((*known, 'load'))}, got {unknown[0]!r}")
        kinds = tuple(kind for name, kind in known.items() if name in names)
        return cls(kinds, "load" in names)

    def columns(self, mechanism: Mechanism) -> Array:
        """Mask (P,) of zeros and ones over the P parameters of a `mechanism` with all kinds of friction, in the order
        of its `parameter_names`: 1 for the links' parameters, rotor inertias and the model's friction terms, 0 for
        other terms. Nothing is raised."""
        drives = mechanism.description.drive_parameters
        kept = [float(kind in (*self.kinds, DriveParameter.ROTOR_INERTIA)) for _, kind in drives]
        return np.concatenate([np.ones(len(mechanism.parameter_names) - len(drives)), np.array(kept)])


CANDIDATES = tuple(FrictionModel((*ALWAYS, *curve, *offset)) for curve in CURVES for offset in OFFSETS)


def with_all_friction(mechanism: Mechanism, drives: Drives) -> Mechanism:
    """A copy of the `mechanism` with a rotor and every kind of friction in the drive of each primary (independent)
    joint, all zero, and the drives coupled with other joints by the transmission of `drives`. Other joints keep their
    drives. Raises `InputError` for a mechanism under linear constraints on its parameters, which a fit would not keep
    to, and for drives that turn with joints unknown to the mechanism, or in ratios that overflow."""
    if mechanism.unconstrained is not mechanism:
        raise InputError(
            f"{mechanism.name}: an identification cannot keep to the relations among its parameters: give "
            "`mechanism.unconstrained`"
        )
    terms = dict.fromkeys(DriveParameter, 0.0)
    own = {name: drive.with_terms(terms) for name, drive in zip(drives.joints, drives.on_joints(), strict=True)}
    each = [own.get(link.joint.name, link.joint.drive) for link in mechanism.links]
    return mechanism.with_drives(each)


def load_columns(
    motions: Sequence[SmoothMotion], mechanism: Mechanism, x: Array, cutoff: float, drives: Drives
) -> Array:
    """Regressor columns (n, r, r), N m (N for prismatic joints), of load-dependent friction in the n rows of filtered
    equations of motion that a low-pass filter of `cutoff` Hz makes of smoothed `motions`. They are the torques of r
    joints (second axis) by the friction of each drive (third axis) for a coefficient of 1, for which friction is as
    large as the rigid torque (the torque without friction) at the drive's joint.

    `mechanism` has all kinds of friction, and `x` its P inertial and friction parameters in the order of
    `parameter_names`, SI units (more are ignored). Rows are taken where the log is flagged as moving at the row's
    instant and at both ends of the filter's kernel around it. `drives` is the transmission, which couples drives with
    joints. Raises `InputError` for parameters that no mechanism may have (not finite, above 1e20, or a rotor's inertia
    below zero) and motions shorter than the filter, `ValueError` for empty `motions` and for a cut-off not below half
    their rate.
    """
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
    return (np.arange(P) >= mechanism.num_energy_parameters).astype(np.float64)
