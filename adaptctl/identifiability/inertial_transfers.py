"""Inertial transfers of a tree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import GROUND
from adaptctl.description.inertia import UNIT_PSEUDO_INERTIAS, from_pseudo_inertia
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.sampling import characteristic_length

# A body of pseudo-inertia J (4, 4), the sum of x x' dm over points x = (position, 1), has in a frame at T (4, 4) that
# moves with the twist X (T' = T X) the energy <X'X/2 - e4 g'T, J> with gravity g: a functional <M, J>. In a frame at G
# in another one, the same body has G J G' there.

# Matrix (10, 16) from the entries of a pseudo-inertia to its ten.
_TENS = np.stack([from_pseudo_inertia(unit) for unit in np.eye(16).reshape(16, 4, 4)], axis=1)
# Relative size below which singular values count as zero: halfway, in digits, between lengths and round-off.
RANK_TOLERANCE = 1e-8
# Number of powers of A that matter: a turn's eigenvalues are 0, +-i and +-2i, so A^5 is a sum of lower powers, and a
# shift has A^3 = 0.
GENERATOR_POWERS = 5
# Numbers of a body: its ten, and the inertia of the joint's rotor, whose energy is v^2/2.
BODY_PARAMETERS = 11


def twist_matrices(twists: Array) -> Array:
    """Matrices (..., 4, 4) of twists (..., 6), angular velocity first."""
    out = np.zeros((*twists.shape[:-1], 4, 4))
    x, y, z = np.moveaxis(twists[..., :3], -1, 0)
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = x, y, z
    out[..., 1, 2], out[..., 2, 0], out[..., 0, 1] = -x, -y, -z
    out[..., :3, 3] = twists[..., 3:]
    return out


def twist_entries(matrices: Array) -> Array:
    """Twists (..., 6) of their matrices (..., 4, 4)."""
    turn = [matrices[..., 2, 1], matrices[..., 0, 2], matrices[..., 1, 0]]
    return np.stack([*turn, *np.moveaxis(matrices[..., :3, 3], -1, 0)], axis=-1)


@dataclass(frozen=True, eq=False)
class JointFrames:
    """Joint frames of a tree, with lengths divided by its characteristic length."""

    length: float
    parents: tuple[int, ...]
    near: Array
    far: Array
    twists: Array
    gravity: Array

    @property
    def rotor_scales(self) -> Array:
        """Scales (N,) of the joints' rotor inertias."""
        return np.where(self.twists[:, :3].any(axis=1), self.length**2, 1.0)

    @classmethod
    def of(cls, mechanism: Mechanism) -> JointFrames:
        """Joint frames of a mechanism's tree."""
        links, length = mechanism.links, characteristic_length(mechanism)
        on_parent = _matrices([(k.parent_to_joint.rotation, k.parent_to_joint.translation) for k in links], length)
        far = _matrices([(k.joint_to_link.rotation, k.joint_to_link.translation) for k in links], length)
        hangs = np.array([k.parent != GROUND for k in links])
        parents = np.array([k.parent for k in links])
        near = np.where(hangs[:, None, None], far[parents], np.eye(4)) @ on_parent
        turns = np.array([k.joint.kind.is_revolute for k in links])[:, None]
        axes = np.array([k.joint.axis for k in links])
        twists = np.hstack([np.where(turns, axes, 0.0), np.where(turns, 0.0, axes)])
        gravity = mechanism.description.gravity
        strength = float(np.linalg.norm(gravity)) or 1.0
        return cls(length, tuple(k.parent for k in links), near, far, twists, gravity / strength)


def _matrices(poses: list[tuple[Array, Array]], length: float) -> Array:
    out = np.tile(np.eye(4), (len(poses), 1, 1))
    out[:, :3, :3] = [rotation for rotation, _ in poses]
    out[:, :3, 3] = [translation / length for _, translation in poses]
    return out


def functionals(matrices: Array) -> Array:
    """Coefficients (..., 10) of functionals <M, J> of a body's parameters, M (..., 4, 4)."""
    return matrices.reshape(*matrices.shape[:-2], 16) @ UNIT_PSEUDO_INERTIAS.reshape(10, 16).T


def frame_changes(frames: Array) -> Array:
    """Matrices (..., 10, 10) from a body's parameters in frame B to those in A."""
    G = frames[..., None, :, :]
    return _tens(G @ UNIT_PSEUDO_INERTIAS @ G.mT)


def frame_change_rates(twists: Array) -> Array:
    """Rates (..., 10, 10) of a body's parameters in a fixed frame under twists."""
    moved = twists[..., None, :, :] @ UNIT_PSEUDO_INERTIAS
    return _tens(moved + moved.mT)


def _tens(matrices: Array) -> Array:
    return (matrices.reshape(*matrices.shape[:-2], 16) @ _TENS.T).mT


class LinkParameters(NamedTuple):
    """Indices (n,) of parameters, and unit bodies (11, n)."""

    indices: NDArray[np.int64]
    bodies: Array


@dataclass(frozen=True, eq=False)
class InertialTransfers:
    """Observable functionals and unobservable bodies at every joint of a tree."""

    frames: JointFrames
    own: tuple[LinkParameters, ...]
    to_parent: Array
    observable: tuple[Array, ...]
    unobservable: tuple[Array, ...]

    @property
    def parents(self) -> tuple[int, ...]:
        """Indices (N,) of the links' parents, -1 for the ground."""
        return self.frames.parents

    def passed_to_parent(self, i: int, bodies: Array) -> Array:
        """Bodies (11, n) of a joint's link, in the parent link at position zero."""
        out = np.zeros_like(bodies)
        out[:10] = self.to_parent[i] @ bodies[:10]
        return out

    @property
    def nullity(self) -> int:
        """Number of unobservable combinations of parameters."""
        count = 0
        passed: list[list[Array]] = [[] for _ in self.parents]
        for i in reversed(range(len(self.parents))):
            bodies = np.hstack([self.own[i].bodies, *passed[i]])
            parent = self.parents[i]
            if parent != GROUND and self.massless(parent):
                unobserved = bodies @ _null_space(self.observable[i] @ bodies)
                passed[parent].append(self.passed_to_parent(i, unobserved))
            elif self.massless(i):
                count += _null_space(self.observable[i] @ bodies).shape[1]
            else:
                count += bodies.shape[1] - len(self.observable[i])
        return count

    def massless(self, i: int) -> bool:
        """True if a link has no parameters."""
        return len(self.own[i].indices) < 10


def inertial_transfers(mechanism: Mechanism) -> InertialTransfers:
    """Inertial transfers of a tree, from geometry and gravity's direction."""
    frames = JointFrames.of(mechanism)
    rates = frame_change_rates(twist_matrices(frames.twists))
    across = frame_changes(frames.near)
    seen = _repeated(_functionals_at_zero(frames, across, rates), rates, GENERATOR_POWERS)
    rows = np.zeros((*seen.shape[:2], BODY_PARAMETERS))
    rows[..., :10] = seen
    rows[:, 0, 10] = _rotors(mechanism)  # The first row is S'S, for v^2/2: so is a rotor's energy.
    _, values, vectors = np.linalg.svd(rows, full_matrices=False)
    counts = (values > RANK_TOLERANCE * values[:, :1]).sum(axis=1).tolist()
    return InertialTransfers(
        frames=frames,
        own=_own(mechanism, frame_changes(frames.far)),
        to_parent=across,
        observable=tuple(v[:k] for v, k in zip(vectors, counts, strict=True)),
        unobservable=tuple(v[k:] for v, k in zip(vectors, counts, strict=True)),
    )


def _functionals_at_zero(frames: JointFrames, across: Array, rates: Array) -> Array:
    S, near = twist_matrices(frames.twists), frames.near
    units = twist_matrices(np.eye(6))
    carried = twist_entries(np.linalg.inv(near)[:, None] @ units @ near[:, None])  # rows of X turn by it
    bracket = twist_entries(units @ S[:, None] - S[:, None] @ units)
    pairing = functionals(units.mT @ S[:, None])
    out = np.zeros((len(S), 17, 10))
    out[:, 0], out[:, 1:7], out[:, 7:] = functionals(S.mT @ S), pairing, rates  # of full spans, as most are
    spans = {GROUND: (np.zeros((0, 6)), _row_space(np.concatenate([[0.0], -frames.gravity, np.zeros(6)])[None]))}
    for i, parent in enumerate(frames.parents):
        X, f = spans[parent]
        if X.shape == carried[i].shape and f.shape == across[i].shape:
            spans[i] = X, f
            continue
        X, f = _moved(X, carried[i]), _moved(f, across[i])
        out[i, 1:] = 0.0
        out[i, 1 : 1 + len(X)] = X @ pairing[i]
        out[i, 7 : 7 + len(f)] = f @ rates[i]
        spans[i] = (_grown(X, frames.twists[i][None], bracket[i]), _grown(f, out[i], rates[i]))
    return out


def _moved(space: Array, matrix: Array) -> Array:
    return space if len(space) == len(matrix) else space @ matrix


def _grown(space: Array, more: Array, generator: Array) -> Array:
    if len(space) == len(generator):
        return space
    return _row_space(_repeated(np.vstack([space, more]), generator, GENERATOR_POWERS))


def _row_space(rows: Array) -> Array:
    _, values, vectors = np.linalg.svd(rows, full_matrices=False)
    rank = int(np.count_nonzero(values > RANK_TOLERANCE * values[:1]))
    return np.eye(rows.shape[1]) if rank == rows.shape[1] else np.asarray(vectors[:rank], dtype=np.float64)


def _repeated(rows: Array, generator: Array, times: int) -> Array:
    blocks = [rows]
    for _ in range(times - 1):
        blocks.append(blocks[-1] @ generator)
    return np.concatenate(blocks, axis=-2)


def _null_space(matrix: Array) -> Array:
    _, values, vectors = np.linalg.svd(matrix)
    return np.asarray(vectors[int(np.count_nonzero(values > RANK_TOLERANCE)) :].T, dtype=np.float64)


def _own(mechanism: Mechanism, to_joint: Array) -> tuple[LinkParameters, ...]:
    description = mechanism.description
    own = [LinkParameters(np.zeros(0, dtype=np.int64), np.zeros((BODY_PARAMETERS, 0)))] * len(description.links)
    for place, i in enumerate(description.bodies):
        bodies = np.zeros((BODY_PARAMETERS, 10))
        bodies[:10] = to_joint[i]
        own[i] = LinkParameters(np.arange(10 * place, 10 * place + 10), bodies)
    rotors = np.flatnonzero(_rotors(mechanism)).tolist()
    for place, i in enumerate(rotors, 10 * len(description.bodies)):
        bodies = np.column_stack([own[i].bodies, np.eye(BODY_PARAMETERS)[:, 10]])
        own[i] = LinkParameters(np.append(own[i].indices, place), bodies)
    return tuple(own)


def _rotors(mechanism: Mechanism) -> Array:
    return np.array([float(link.joint.drive.rotor_inertia is not None) for link in mechanism.links])
