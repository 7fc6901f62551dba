"""Equations of motors' torque columns with links, payloads and drives as parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, positive_number
from adaptctl.description.inertia import from_center_of_mass, is_physically_consistent, transformed
from adaptctl.description.readers.entries import Tensor
from adaptctl.identification.drives_content import PayloadEntry
from adaptctl.identification.entropic import EntropicPrior
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.friction_model import ALWAYS, SIMPLE_FRICTION
from adaptctl.identification.loaded_fit import KnownValue, LoadedEquations
from adaptctl.identification.momentum_balance import PackedRegressor
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.payloads import known_ten, payload_columns, payload_place

# Share of peak speed below which a motor's rows do not count.
SLOW = 0.02
# Mass in kg of a payload that nothing is known of, and radius in m of the ball that it is taken for.
UNKNOWN_MASS, BALL = 1.0, 0.1


def loaded_equations(evidence: LogEvidence, cutoff: float, payloads: tuple[PayloadEntry, ...]) -> LoadedEquations:
    """Equations of the motors' torque columns, with payloads after the links."""
    mechanism = evidence.mechanism
    settings = FitSettings(SIMPLE_FRICTION, 1.0, cutoff, SLOW)
    links, mask = 10 * len(mechanism.description.bodies), settings.columns(mechanism)
    drives = np.flatnonzero(mask[links:]) + links
    moved = links + 10 * len(payloads)
    place = {c: c if c < links else moved + int(np.searchsorted(drives, c)) for c in [*range(links), *drives.tolist()]}
    return LoadedEquations(
        _of_motors(evidence, cutoff, payloads, drives),
        _prior(evidence, payloads, place),
        [known for q, payload in enumerate(payloads) for known in _known(payload, evidence, links + 10 * q)],
        np.flatnonzero(np.isnan(evidence.drives.constants)),
        np.array([*(place[c] for c in evidence.independent(settings).tolist()), *range(links, moved)]),
        _friction(evidence, place),
    )


def _of_motors(
    evidence: LogEvidence, cutoff: float, payloads: Sequence[PayloadEntry], drives: NDArray[np.int64]
) -> NormalEquations:
    """Normal equations of the motors' torque columns, of links, payloads and some parameters of drives."""
    mechanism, inverse = evidence.mechanism, np.linalg.inv(evidence.drives.transmission)
    links = 10 * len(mechanism.description.bodies)
    width = links + 10 * len(payloads) + len(drives)
    total = NormalEquations.zero(evidence.blocks, mechanism.dof, width)
    for rows, motions, block, peaks in evidence.parts(cutoff):
        carried = [payload_columns(payload, rows, motions, mechanism) for payload in payloads]
        Y = np.concatenate([rows.regressor[..., :links], *carried, rows.regressor[..., drives]], axis=-1)
        regressor = PackedRegressor.of(np.einsum("jk,njp->nkp", inverse, Y))
        total.add(regressor, rows.torque @ inverse, block, rows.used(SLOW * peaks))
    return total


def _prior(evidence: LogEvidence, payloads: tuple[PayloadEntry, ...], place: dict[int, int]) -> EntropicPrior:
    old = evidence.prior
    tens = [transformed(_first_ten(payload), payload_place(payload, evidence.mechanism).pose) for payload in payloads]
    kept = [k for k, c in enumerate(old.positive.tolist()) if c in place]
    positive = np.array([place[int(old.positive[k])] for k in kept], dtype=np.int64)
    return EntropicPrior(np.vstack([old.tens, *tens]), positive, old.scales[kept])


def _first_ten(payload: PayloadEntry) -> Array:
    """Ten parameters of a payload in its own frame, what is unknown of them those of a ball."""
    if payload.is_known:
        return known_ten(payload)
    mass = UNKNOWN_MASS if payload.mass is None else payload.mass
    positive_number(mass, f"payload in {payload.log}: mass: expected a positive number of kg")
    ball = Tensor(xx=0.4 * mass * BALL**2, yy=0.4 * mass * BALL**2, zz=0.4 * mass * BALL**2)
    inertia = payload.inertia_at_center or ball
    ten = from_center_of_mass(mass, payload.center_of_mass or (0.0, 0.0, 0.0), inertia.matrix())
    return known_ten(payload) if not is_physically_consistent(ten) else ten


def _known(payload: PayloadEntry, evidence: LogEvidence, first: int) -> list[KnownValue]:
    """Known values among a payload's ten parameters, in the frame of its link."""
    if payload.mass is None:
        return []
    ten = transformed(_first_ten(payload), payload_place(payload, evidence.mechanism).pose)
    count = 10 if payload.is_known else 4 if payload.center_of_mass is not None else 1
    sizes = payload.mass * np.array([1.0, *(3 * [BALL]), *(6 * [BALL**2])])
    return [KnownValue(first + k, float(ten[k]), float(sizes[k])) for k in range(count)]


def _friction(evidence: LogEvidence, place: dict[int, int]) -> NDArray[np.int64]:
    names = list(evidence.mechanism.parameter_names)
    joints = [joint.name for joint in evidence.mechanism.primary_joints]
    return np.array(
        [[place[names.index(f"{joint}.{kind.value}")] for kind in ALWAYS] for joint in joints], dtype=np.int64
    )
