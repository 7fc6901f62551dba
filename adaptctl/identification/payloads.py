"""Known payloads: bodies that a link carries throughout a log, whose torques are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_center_of_mass, is_physically_consistent
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identification.drives_file import Drives, PayloadEntry
from adaptctl.identification.filtered_dynamics import Rows, SmoothMotion
from adaptctl.identification.joint_log import same_place


def payload_torques(rows: Rows, motions: Sequence[SmoothMotion], mechanism: Mechanism, drives: Drives) -> Array:
    """The contribution (n, r), N m (N for a prismatic joint), of known payloads, bodies fixed to links, to the torques
    of r joints in n `rows` of low-pass filtered equations of motion. The payloads are those of `drives`, each in the
    rows of the log that it names by path or file name; `motions` are the logs' smoothed motions, and the rows'
    regressors are on the parameters of `mechanism`. Raises `InputError` for a payload on an unknown link, and for a
    mass, centre and inertia that no body has."""
    out = np.zeros_like(rows.torque)
    for payload in drives.payloads:
        columns, ten = _columns(payload, mechanism), _ten(payload)
        for motion in motions:
            if same_place(payload.log, motion.log.source):
                here = rows.log == motion.number
                out[here] += rows.regressor[here][:, :, columns] @ ten
    return out


def without_payloads(rows: Rows, motions: Sequence[SmoothMotion], mechanism: Mechanism, drives: Drives) -> Rows:
    """A copy of the `rows` of low-pass filtered equations of motion, a `Rows`, with the torques that the robot alone
    takes. The torques of the known payloads of `drives`, bodies fixed to links, are subtracted in the rows of the logs
    that the payloads name by path or file name. `motions` are the logs' smoothed motions, and the rows' regressors are
    on the parameters of `mechanism`. Raises `InputError` for a payload on an unknown link, and for a mass, centre and
    inertia that no body has."""
    return replace(rows, torque=rows.torque - payload_torques(rows, motions, mechanism, drives))


def _columns(payload: PayloadEntry, mechanism: Mechanism) -> slice:
    names = mechanism.description.body_names
    if payload.link not in names:
        raise InputError(f"payload in {payload.log}: there is no link {payload.link!r}; there is {', '.join(names)}")
    first = 10 * names.index(payload.link)
    return slice(first, first + 10)


def _ten(payload: PayloadEntry) -> Array:
    ten = from_center_of_mass(payload.mass, payload.center_of_mass, payload.inertia_at_center.matrix())
    if not is_physically_consistent(ten):
        raise InputError(f"payload in {payload.log}: no body has this mass, centre and inertia")
    return ten
