"""Torque constants of motors from logs (Gautier and Briot 2014)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from msgspec import structs

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_center_of_mass, is_physically_consistent, transformed
from adaptctl.description.places import place_on_link
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog, same_place
from adaptctl.identification.drives_file import Drives, PayloadEntry
from adaptctl.identification.filtered_dynamics import Rows, SmoothMotion
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.friction_model import FrictionModel

# With W the joint torques of a unit of every motor's torque column, Y beta - W K = 0 is homogeneous in the constants K
# and parameters beta. A known payload or constant fixes their scale; without either, K is the direction that Y explains
# best, and the scale that at which the links are nearest to the robot's file.


def payload_torques(rows: Rows, motions: Sequence[SmoothMotion], mechanism: Mechanism, drives: Drives) -> Array:
    """Torques (n, r) of known payloads in rows of filtered equations."""
    out = np.zeros_like(rows.torque)
    for payload in drives.payloads:
        names, what = mechanism.description.body_names, f"payload in {payload.log}"
        link, pose = place_on_link(mechanism.description, payload.link, what, names)
        first, ten = 10 * names.index(link), transformed(_ten(payload), pose)
        for motion in motions:
            if same_place(payload.log, motion.log.source):
                here = rows.log == motion.number
                out[here] += rows.regressor[here][:, :, first : first + 10] @ ten
    return out


def without_payloads(rows: Rows, motions: Sequence[SmoothMotion], mechanism: Mechanism, drives: Drives) -> Rows:
    """Rows with the torques that the robot alone takes, known payloads subtracted."""
    return replace(rows, torque=rows.torque - payload_torques(rows, motions, mechanism, drives))


def _ten(payload: PayloadEntry) -> Array:
    ten = from_center_of_mass(payload.mass, payload.center_of_mass, payload.inertia_at_center.matrix())
    if not is_physically_consistent(ten):
        raise InputError(f"payload in {payload.log}: this mass, centre and inertia are not physically consistent")
    return ten


WEIGHTING_ROUNDS = 3
# Least ratio of the two smallest shares that are left, so that one direction is told from the next.
MIN_SHARE_RATIO = 1.5


def torque_constants(evidence: LogEvidence, cutoff: float) -> tuple[Array, str]:
    """Torque constants (r,) for a unit of the torque columns, and how the unknown ones were found."""
    drives, rows = evidence.drives, evidence.rows[cutoff].moved
    unknown = np.flatnonzero(np.isnan(drives.constants))
    names = ", ".join(drives.motors[i].name for i in unknown.tolist())
    of_motors = _of_motors(rows, drives)
    carried = payload_torques(rows, evidence.motions, evidence.mechanism, drives)
    columns = evidence.independent(FitSettings(FrictionModel(), 1.0, cutoff))
    known = of_motors[..., [i for i in range(len(drives.motors)) if i not in unknown]].sum(axis=-1)
    wanted = known - carried
    if np.any(wanted):
        found = _solved(rows.regressor[..., columns], of_motors[..., unknown], wanted)
        words = f"torque constants of {names} are identified from the known constants and payloads"
    else:
        direction = _direction(rows.regressor[..., columns], of_motors[..., unknown], names)
        found = _scale(evidence, rows, of_motors[..., unknown] @ direction) * direction
        words = (
            f"torque constants of {names} are identified up to a common scale, with the link masses of the robot "
            "file; a known payload or one known constant determines the scale"
        )
    if not np.all(found > 0.0):
        raise InputError(f"torque constants of {names}: the estimates {found.round(4).tolist()} are not all positive")
    constants = drives.constants.copy()
    constants[unknown] = found
    return constants, words


def with_constants(log: JointLog, drives: Drives, constants: Array) -> JointLog:
    """Log with joint torques by given torque constants, where the drives' are unknown."""
    factors = np.where(np.isnan(drives.constants), constants, 1.0)
    motors = log.torque @ np.linalg.inv(drives.transmission)
    return replace(log, torque=drives.torque(motors * factors))


def known_drives(drives: Drives, constants: Array) -> Drives:
    """Drives with given torque constants (r,)."""
    pairs = zip(drives.motors, constants.tolist(), strict=True)
    return replace(drives, motors=tuple(structs.replace(motor, torque_constant=k) for motor, k in pairs))


def _of_motors(rows: Rows, drives: Drives) -> Array:
    """Joint torques (n, r, r) of each motor's part of the rows' torques."""
    motors = rows.torque @ np.linalg.inv(drives.transmission)
    return np.asarray(motors[:, None, :] * drives.transmission.T)


def _solved(Y: Array, W: Array, wanted: Array) -> Array:
    """K of Y beta - W K = wanted, joints weighted by their residuals."""
    whole = np.concatenate([Y, -W], axis=-1)
    deviations = np.sqrt(np.mean(wanted**2, axis=0)) + 1e-9
    x = np.zeros(whole.shape[-1])
    for _ in range(WEIGHTING_ROUNDS):
        rows = (whole / deviations[:, None]).reshape(-1, whole.shape[-1])
        size = np.linalg.norm(rows, axis=0)
        size[size == 0.0] = 1.0
        x = np.linalg.lstsq(rows / size, (wanted / deviations).ravel())[0] / size
        deviations = np.sqrt(np.mean((whole @ x - wanted) ** 2, axis=0)) + 1e-9
    return x[Y.shape[-1] :]


def _direction(Y: Array, W: Array, names: str) -> Array:
    """K, up to its length, of which Y leaves the smallest part."""
    size = np.sqrt(np.mean(W**2, axis=(0, 2)))
    rows, wide = (part / size[:, None] for part in (Y, W))
    flat, torques = rows.reshape(-1, Y.shape[-1]), wide.reshape(-1, W.shape[-1])
    length = np.linalg.norm(torques, axis=0)
    norms = np.linalg.norm(flat, axis=0)
    explained = np.linalg.lstsq(flat / np.where(norms > 0.0, norms, 1.0), torques / length)[0]
    left = torques / length - flat / np.where(norms > 0.0, norms, 1.0) @ explained
    _, values, vectors = np.linalg.svd(left, full_matrices=False)
    if len(values) > 1 and values[-2] < MIN_SHARE_RATIO * values[-1]:
        raise InputError(
            f"torque constants of {names}: the log does not distinguish them; record a motion of more joints at "
            "once, or one with a known payload"
        )
    direction = vectors[-1] / length
    return np.asarray(direction * np.sign(direction.sum()))


def _scale(evidence: LogEvidence, rows: Rows, torque: Array) -> float:
    """Factor that turns the torques into those of the prior's links."""
    tens = evidence.prior.tens.ravel()
    drives = FrictionModel().columns(evidence.mechanism)
    drives[: tens.size] = 0.0
    own = rows.regressor[..., np.flatnonzero(drives)]
    weight = rows.regressor[..., : tens.size] @ tens
    return float(_solved(own, torque[..., None], -weight)[0])
