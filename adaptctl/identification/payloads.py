"""Bodies that a robot carries in some logs: where, since when, and what is known of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, positive_number, real_number
from adaptctl.description.inertia import from_center_of_mass, is_physically_consistent, transformed
from adaptctl.description.places import PlaceOnLink, place_on_link
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification.columns import same_place
from adaptctl.identification.drives_content import PayloadEntry
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.filtered_dynamics import Rows, SmoothMotion

# Periods of a row's cut-off around the instant at which a body is taken, in which rows do not count.
TAKING = 1.0


def with_unknown_payloads(
    drives: Drives,
    logs: Sequence[str | Path],
    payloads: Mapping[str, str] | None,
    mass: float | None,
    after: float | None,
) -> Drives:
    """Drives with unknown bodies at links by logs, of a mass (kg) and from a time (s) on, if these are known."""
    if mass is not None:
        positive_number(mass, "payload_mass: expected a positive number of kg")
    since = -math.inf if after is None else real_number(after, "payload_after")
    if not payloads and not (mass is None and after is None):
        given = "payload_after" if mass is None else "payload_mass"
        raise InputError(f"{given}: of no payload; give payloads (--payload LOG=LINK) too")
    for log in payloads or {}:
        if not any(same_place(log, own) for own in logs):
            raise InputError(f"payloads: expected one of the logs {', '.join(map(str, logs))}, got {log!r}")
    pairs = (payloads or {}).items()
    more = [PayloadEntry(log=log, link=link, mass=mass, after=since) for log, link in pairs]
    return replace(drives, payloads=(*drives.payloads, *more))


def payload_place(payload: PayloadEntry, mechanism: Mechanism) -> PlaceOnLink:
    """Link that carries a payload, and the pose of the payload's frame on it."""
    return place_on_link(
        mechanism.description, payload.link, f"payload in {payload.log}", mechanism.description.body_names
    )


def loaded_rows(payload: PayloadEntry, rows: Rows, motions: Sequence[SmoothMotion]) -> NDArray[np.bool_]:
    """Mask (n,) of the rows in which a payload is carried."""
    return in_log(payload, rows, motions) & (rows.time >= payload.after)


def in_log(payload: PayloadEntry, rows: Rows, motions: Sequence[SmoothMotion]) -> NDArray[np.bool_]:
    """Mask (n,) of the rows of a payload's log."""
    numbers = [motion.number for motion in motions if same_place(payload.log, motion.log.source)]
    return np.isin(rows.log, numbers)


def payload_columns(payload: PayloadEntry, rows: Rows, motions: Sequence[SmoothMotion], mechanism: Mechanism) -> Array:
    """Regressor (n, r, 10) of a payload's ten parameters in the frame of the link that carries it."""
    first = 10 * mechanism.description.body_names.index(payload_place(payload, mechanism).link)
    here = loaded_rows(payload, rows, motions)
    return np.asarray(rows.regressor[..., first : first + 10] * here[:, None, None])


def without_payloads(rows: Rows, motions: Sequence[SmoothMotion], mechanism: Mechanism, drives: Drives) -> Rows:
    """Rows with the torques that the robot alone takes: known payloads subtracted, instants of taking left out."""
    torque, moving = rows.torque.copy(), rows.moving.copy()
    for payload in drives.payloads:
        moving &= ~(in_log(payload, rows, motions) & _near_taking(payload, rows.time, rows.cutoff))
        if payload.is_known and not np.isnan(drives.constants).any():
            ten = transformed(known_ten(payload), payload_place(payload, mechanism).pose)
            torque -= payload_columns(payload, rows, motions, mechanism) @ ten
    return replace(rows, torque=torque, moving=moving)


def taken_there(drives: Drives, source: str, time: Array, cutoff: float) -> NDArray[np.bool_]:
    """Mask (n,) of the instants (s) of a log at which a body is just being taken, for rows of a cut-off (Hz)."""
    own = (payload for payload in drives.payloads if same_place(payload.log, source))
    return np.any([np.zeros(len(time), np.bool_), *(_near_taking(one, time, cutoff) for one in own)], axis=0)


def _near_taking(payload: PayloadEntry, time: Array, cutoff: float) -> NDArray[np.bool_]:
    return np.asarray(np.abs(time - payload.after) < TAKING / cutoff)


def known_ten(payload: PayloadEntry) -> Array:
    """Ten parameters of a known payload in its own frame."""
    mass, center, inertia = payload.mass, payload.center_of_mass, payload.inertia_at_center
    if mass is not None and center is not None and inertia is not None:
        ten = from_center_of_mass(mass, center, inertia.matrix())
        if np.all(np.isfinite(ten)) and is_physically_consistent(ten):
            return ten
    raise InputError(f"payload in {payload.log}: this mass, centre and inertia are not physically consistent")
