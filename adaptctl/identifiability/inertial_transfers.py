"""Inertial transfers of a tree: what can be moved from a link to its parent without any energy changing.

A body of pseudo-inertia J (4, 4) = sum of x x' dm over its points x = (position, 1) has, in a frame that stands at T
(4, 4) and moves with the twist X (T' = T X), the energy <X'X/2 - e4 g'T, J> with gravity g: a functional <M, J>. In a
frame that stands at G in another one, the same body has G J G' there.
"""

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

_TENS = np.stack([from_pseudo_inertia(unit) for unit in np.eye(16).reshape(16, 4, 4)], axis=1)
"""Matrix (10, 16) from the entries of a pseudo-inertia to its ten."""
NEGLIGIBLE = 1e-8
"""Relative size below which singular values count as zero: halfway, in digits, between lengths and round-off."""
POWERS = 5
"""Number of powers of A that matter: a turn's eigenvalues are 0, +-i and +-2i, so A^5 is a sum of lower powers, and a
shift has A^3 = 0."""
BODY = 11
"""Numbers of a body: its ten, and the inertia of the joint's rotor, whose energy is v^2/2."""


def twist_matrices(twists: Array) -> Array:
    """The matrices (..., 4, 4) of `twists` (..., 6): the cross-product matrix of the angular velocity in the upper
    left, the linear velocity in the last column, zeros below. Each twist is an angular velocity (3,), rad/s, and the
    velocity (3,) of the frame's origin, m/s or another unit of length per s, both along the moving frame's own axes. A
    frame of pose T (4, 4) that moves with the twist of matrix X has the rate T X. Nothing is checked."""
    out = np.zeros((*twists.shape[:-1], 4, 4))
    x, y, z = np.moveaxis(twists[..., :3], -1, 0)
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = x, y, z
    out[..., 1, 2], out[..., 2, 0], out[..., 0, 1] = -x, -y, -z
    out[..., :3, 3] = twists[..., 3:]
    return out


def twist_entries(matrices: Array) -> Array:
    """The twists (..., 6) of their `matrices` (..., 4, 4), the inverse of `twist_matrices`: each is an angular velocity
    (3,), rad/s, and the velocity (3,) of the frame's origin, m/s or another unit of length per s, both along the moving
    frame's own axes. Nothing is checked."""
    turn = [matrices[..., 2, 1], matrices[..., 0, 2], matrices[..., 1, 0]]
    return np.stack([*turn, *np.moveaxis(matrices[..., :3, 3], -1, 0)], axis=-1)


@dataclass(frozen=True, eq=False)
class JointFrames:
    """The frames of the N joints of a tree, each moving with its link so that its own joint's twist is constant in it;
    lengths are in units of `length` L in m.

    `parents` (N,) are the parent links' zero-based indices, -1 for the ground; `near` (N, 4, 4) the poses of the
    joints' frames, at joint position zero, in the frames of their parents' joints (in the world for joints on the
    ground); `far` (N, 4, 4) the poses of the links' frames in their joints'; `twists` (N, 6) are the joints' twists,
    angular then linear, along the axes of their own frames, per unit of their positions (rad, or L for a prismatic
    joint); `gravity` (3,) is the unit vector along gravity in the world, zero where there is none. Made by `of`;
    nothing is checked at construction.
    """

    length: float
    parents: tuple[int, ...]
    near: Array
    far: Array
    twists: Array
    gravity: Array

    @property
    def rotor_scales(self) -> Array:
        """The scales (N,) of the N joints' rotor inertias, with the unit of length L (m) that this object's `length`
        is: L^2, in m^2, where a joint turns, 1 where it slides. Rotor inertias divided by these are in kg."""
        return np.where(self.twists[:, :3].any(axis=1), self.length**2, 1.0)

    @classmethod
    def of(cls, mechanism: Mechanism) -> JointFrames:
        """The joint frames of a mechanism's tree, with lengths in units of its characteristic length (the largest
        distance from a joint to the next or to its link's frame, 1 m where there is none). Loop closures are left out.
        Nothing is checked."""
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
    """The coefficients f (..., 10) of linear functionals of a body's ten inertial parameters, one row for each of
    `matrices` M (..., 4, 4): f times the ten (m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz) is tr(M' J). J
    (4, 4) is the body's pseudo-inertia, the sum of x x' dm over its points x = (position, 1). Raises `ValueError` for
    matrices that have not 16 entries each."""
    return matrices.reshape(*matrices.shape[:-2], 16) @ UNIT_PSEUDO_INERTIAS.reshape(10, 16).T


def frame_changes(frames: Array) -> Array:
    """The matrices (..., 10, 10) that map a body's ten inertial parameters in a frame B to its ten in a frame A, one
    for each pose of B in A in `frames` (..., 4, 4), a homogeneous matrix of rotation and origin. The ten are m, mc_x,
    mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz, with lengths in the poses' unit. Raises `ValueError` for poses of
    another size."""
    G = frames[..., None, :, :]
    return _tens(G @ UNIT_PSEUDO_INERTIAS @ G.mT)


def frame_change_rates(twists: Array) -> Array:
    """The rates (..., 10, 10) at which a body's ten inertial parameters in a fixed frame change as the body begins to
    move with `twists`, given by their matrices S (..., 4, 4). The ten are m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz,
    I_yz, I_zz; the pseudo-inertia J (4, 4), the sum of x x' dm over the body's points x = (position, 1), changes at S J
    + J S'. Raises `ValueError` for matrices of another size."""
    moved = twists[..., None, :, :] @ UNIT_PSEUDO_INERTIAS
    return _tens(moved + moved.mT)


def _tens(matrices: Array) -> Array:
    """The ten (..., 10, n), a column each, of pseudo-inertias (..., n, 4, 4)."""
    return (matrices.reshape(*matrices.shape[:-2], 16) @ _TENS.T).mT


class LinkParameters(NamedTuple):
    """The n inertial parameters that belong to a link and its joint, or have been passed to it from its children, as
    bodies.

    `indices` (n,) are their zero-based positions among the mechanism's P inertial parameters; `bodies` (11, n) has a
    column for each: the body whose parameter is 1 and whose others are 0. A body is the ten (m, mc_x, mc_y, mc_z, I_xx,
    I_xy, I_yy, I_xz, I_yz, I_zz) in the joint's frame, then the joint's rotor inertia, in kg and in units of the tree's
    characteristic length. Nothing is checked.
    """

    indices: NDArray[np.int64]
    bodies: Array


@dataclass(frozen=True, eq=False)
class InertialTransfers:
    """The inertial transfers of a tree of N joints: the bodies (sets of inertial parameters) that can be moved from a
    link to its parent link without any energy changing, and the linear functionals of bodies that energies do depend
    on. Such bodies are called unobservable at the joint between the two links.

    A body (11,) is ten inertial parameters (m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz) in the joint's
    frame, then the inertia of the joint's rotor, in kg and in units of the length (m) of `frames`, the joints' frames.
    `own` (N,) are the links' own parameters; `to_parent` (N, 10, 10) maps the ten to the parent joint's frame (to the
    world for a joint on the ground), at joint position zero. For each joint, `observable` (c, 11) are these
    functionals, orthonormal, c of 1 to 11, and `unobservable` (11-c, 11) orthonormal bodies that change none; the rotor
    inertia is one of them where the joint has no rotor. Made by `inertial_transfers`; nothing is checked at
    construction.
    """

    frames: JointFrames
    own: tuple[LinkParameters, ...]
    to_parent: Array
    observable: tuple[Array, ...]
    unobservable: tuple[Array, ...]

    @property
    def parents(self) -> tuple[int, ...]:
        """Zero-based indices (N,) of the parents of the tree's N links, parents before their children; -1 for the
        ground."""
        return self.frames.parents

    def passed_to_parent(self, i: int, bodies: Array) -> Array:
        """The bodies (11, n) that n `bodies` (11, n) on the link of joint `i` (zero-based) become when they are moved
        to the parent link, at joint position zero: in the parent joint's frame, or in the world for a joint on the
        ground.

        A body is ten inertial parameters (m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz) in its joint's
        frame, in kg and in units of the tree's characteristic length, and a rotor inertia, which is 0 in the result. No
        energy changes if the bodies are unobservable at the joint, which is not checked. Raises `IndexError` for a
        joint beyond the last.
        """
        out = np.zeros_like(bodies)
        out[:10] = self.to_parent[i] @ bodies[:10]
        return out

    @property
    def nullity(self) -> int:
        """The nullity: the number of independent combinations of the tree's inertial parameters that change no energy.

        They are, at each joint, the combinations of the link's own parameters, and of those passed to it from its
        children, that can be moved to the parent link without any energy changing (unobservable ones). A link with mass
        can compensate what is passed to it; a massless one has no parameters for that, and passes its children's
        unobservable combinations on to its parent.
        """
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
        """True if the link of zero-based index `i` has no ten inertial parameters of its own, being described as
        massless. Raises `IndexError` for a link beyond the last."""
        return len(self.own[i].indices) < 10


def inertial_transfers(mechanism: Mechanism) -> InertialTransfers:
    """The inertial transfers of a mechanism's tree, from its geometry and gravity's direction alone. At every joint
    they are the unobservable bodies, sets of inertial parameters that can be moved from a link to its parent without
    any energy changing, and the linear functionals of bodies that energies do depend on.

    No states are sampled. The mechanism must be a tree whose parameters are not constrained and whose drives turn with
    one joint each; this is not checked.
    """
    frames = JointFrames.of(mechanism)
    rates = frame_change_rates(twist_matrices(frames.twists))
    across = frame_changes(frames.near)
    seen = _repeated(_functionals_at_zero(frames, across, rates), rates, POWERS)
    rows = np.zeros((*seen.shape[:2], BODY))
    rows[..., :10] = seen
    rows[:, 0, 10] = _rotors(mechanism)  # The first row is S'S, for v^2/2: so is a rotor's energy.
    _, values, vectors = np.linalg.svd(rows, full_matrices=False)
    counts = (values > NEGLIGIBLE * values[:, :1]).sum(axis=1).tolist()
    return InertialTransfers(
        frames=frames,
        own=_own(mechanism, frame_changes(frames.far)),
        to_parent=across,
        observable=tuple(v[:k] for v, k in zip(vectors, counts, strict=True)),
        unobservable=tuple(v[k:] for v, k in zip(vectors, counts, strict=True)),
    )


def _functionals_at_zero(frames: JointFrames, across: Array, rates: Array) -> Array:
    """Functionals (N, 17, 10) that energies depend on at q = 0, in each joint's frame: S'S, the <X'S, .>, the f'A.

    X and f run through bases of what they span on the parent link; rows that are not needed are zero.
    """
    S, near = twist_matrices(frames.twists), frames.near
    units = twist_matrices(np.eye(6))
    carried = twist_entries(np.linalg.inv(near)[:, None] @ units @ near[:, None])  # rows of X turn by it
    bracket = twist_entries(units @ S[:, None] - S[:, None] @ units)
    pairing = functionals(units.mT @ S[:, None])
    out = np.zeros((len(S), 17, 10))
    out[:, 0] = functionals(S.mT @ S)
    spans = {GROUND: (np.zeros((0, 6)), _row_space(np.concatenate([[0.0], -frames.gravity, np.zeros(6)])[None]))}
    for i, parent in enumerate(frames.parents):
        X, f = spans[parent]
        X, f = _moved(X, carried[i]), _moved(f, across[i])
        if parent == GROUND:
            f[:, 0] = 0.0  # A mass's potential where the tree stands is constant.
        out[i, 1 : 1 + len(X)] = X @ pairing[i]
        out[i, 7 : 7 + len(f)] = f @ rates[i]
        spans[i] = (_grown(X, frames.twists[i][None], bracket[i]), _grown(f, out[i], rates[i]))
    return out


def _moved(space: Array, matrix: Array) -> Array:
    """A space's basis (r, n) after an invertible change of frame; the identity, for the whole space, stays."""
    return space if len(space) == len(matrix) else space @ matrix


def _grown(space: Array, more: Array, generator: Array) -> Array:
    """A basis of the least space that holds a space (r, n), more rows, and the products of its rows with the
    generator (n, n)."""
    if len(space) == len(generator):
        return space
    return _row_space(_repeated(np.vstack([space, more]), generator, POWERS))


def _row_space(rows: Array) -> Array:
    """An orthonormal basis (r, n) of the span of rows (m, n); the identity where that is the whole space."""
    _, values, vectors = np.linalg.svd(rows, full_matrices=False)
    rank = int(np.count_nonzero(values > NEGLIGIBLE * values[:1]))
    return np.eye(rows.shape[1]) if rank == rows.shape[1] else np.asarray(vectors[:rank], dtype=np.float64)


def _repeated(rows: Array, generator: Array, times: int) -> Array:
    """Rows (..., m, n) and their products with powers of the generator, one below the other (..., times m, n)."""
    blocks = [rows]
    for _ in range(times - 1):
        blocks.append(blocks[-1] @ generator)
    return np.concatenate(blocks, axis=-2)


def _null_space(matrix: Array) -> Array:
    """An orthonormal basis (n, n - rank) of the null space of a matrix (m, n)."""
    _, values, vectors = np.linalg.svd(matrix)
    return np.asarray(vectors[int(np.count_nonzero(values > NEGLIGIBLE)) :].T, dtype=np.float64)


def _own(mechanism: Mechanism, to_joint: Array) -> tuple[LinkParameters, ...]:
    """Own parameters of every link; `to_joint` (N, 10, 10) takes tens from links' frames to their joints'."""
    description = mechanism.description
    own = [LinkParameters(np.zeros(0, dtype=np.int64), np.zeros((BODY, 0)))] * len(description.links)
    for place, i in enumerate(description.bodies):
        bodies = np.zeros((BODY, 10))
        bodies[:10] = to_joint[i]
        own[i] = LinkParameters(np.arange(10 * place, 10 * place + 10), bodies)
    rotors = np.flatnonzero(_rotors(mechanism)).tolist()
    for place, i in enumerate(rotors, 10 * len(description.bodies)):
        bodies = np.column_stack([own[i].bodies, np.eye(BODY)[:, 10]])
        own[i] = LinkParameters(np.append(own[i].indices, place), bodies)
    return tuple(own)


def _rotors(mechanism: Mechanism) -> Array:
    """1 for every joint (N,) that has a rotor, 0 for the others."""
    return np.array([float(link.joint.drive.rotor_inertia is not None) for link in mechanism.links])
