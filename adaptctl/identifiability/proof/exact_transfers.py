"""Exact energy changes of bodies moved from a joint's link to its parent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from adaptctl.description import GROUND, Description
from adaptctl.description.inertia import UNIT_PSEUDO_INERTIAS
from adaptctl.identifiability.proof.arithmetic import (
    PRIME,
    Residues,
    centred,
    random_residues,
    random_turns,
    stacked_residues,
)
from adaptctl.identifiability.proof.exact_geometry import ExactFrame

# A body of pseudo-inertia J (4, 4) in a frame at T (4, 4) in the upright world, that changes by V, has the energy
# <V'V/2 + g e4 e3'T, J> with gravity g. Four times that is an integer, and no other ranks.
_UNITS = (2.0 * UNIT_PSEUDO_INERTIAS).astype(np.int64).reshape(10, 16).T


def energy_changes(description: Description, joints: Sequence[ExactFrame], samples: int, seed: int) -> Residues:
    """Energy changes (N, samples, 11) at random states of a tree whose joints have an axis z, as residues."""
    rng, shape = np.random.default_rng(seed), (len(joints), samples)
    c, s = (x.residues for x in random_turns(shape, rng))
    lengths, rates = (random_residues(shape, rng).residues for _ in range(2))
    turns = np.array([[link.joint.kind.is_revolute] for link in description.links])
    near = np.stack([_matrix(frame) for frame in joints])[:, None]
    poses = centred(near @ _moved(np.where(turns, c, 1), turns * s, ~turns * lengths, 1))
    rises = centred(rates[..., None, None] * _moved(turns * -s, turns * c, ~turns, 0))
    free, held = _motions(description, near, poses, centred(near @ rises))
    rotors = np.array([[link.joint.drive.rotor_inertia is not None] for link in description.links])
    weight = 2 if description.gravity.any() else 0
    changes = [*np.moveaxis(_energies(free, weight) - _energies(held, weight), -1, 0), rotors * rates * rates]
    return np.stack(changes, axis=-1) % PRIME


def _motions(description: Description, near: Any, poses: Any, changes: Any) -> tuple[Any, Any]:
    """Poses and their changes (N, 2, samples, 4, 4) of links, and those of each that its joint alone holds at zero."""
    free, held = np.empty((2, len(poses), 2, *poses.shape[1:]), dtype=np.int64)
    world = np.stack([np.eye(4, dtype=np.int64), np.zeros((4, 4), dtype=np.int64)])[:, None]
    for i, link in enumerate(description.links):
        before = world if link.parent == GROUND else free[link.parent]
        free[i], held[i] = before @ poses[i], before @ near[i]
        free[i, 1] += centred(before[0] @ changes[i])
        free[i] = centred(free[i])
    return free, centred(held)


def _energies(motions: Any, weight: int) -> Any:
    """Energies (N, samples, 10), taken four times, of unit bodies."""
    T, V = motions[:, 0], motions[:, 1]
    functionals = V.mT @ V
    functionals[..., 3] += weight * T[..., 2, :]
    return centred(functionals).reshape(*T.shape[:2], 16) @ _UNITS


def _matrix(frame: ExactFrame) -> Residues:
    """Matrix (4, 4) of a pose."""
    rows = zip(frame.rotation, frame.origin, strict=True)
    entries = [entry for row, x in rows for entry in (*row, x)]
    return centred(stacked_residues([*entries, 0.0, 0.0, 0.0, 1.0], 1).reshape(4, 4))


def _moved(c: Any, s: Any, length: Any, one: int) -> Any:
    """Matrices (..., 4, 4) of a turn about z or a move along it; with `one` 0, of their changes."""
    out = np.zeros((*c.shape, 4, 4), dtype=np.int64)
    out[..., 0, 0] = out[..., 1, 1] = c
    out[..., 1, 0], out[..., 0, 1], out[..., 2, 3] = s, -s, length
    out[..., 2, 2] = out[..., 3, 3] = one
    return out
