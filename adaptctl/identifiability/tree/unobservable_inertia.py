"""Unobservable inertia of every joint of a tree: what can be transferred across it without any energy changing.

Wensing, Niemeyer and Slotine (2017, "Observability in inertial parameter identification", arXiv:1711.03896): a change
of parameters changes no torque exactly when it is a sum of transfers, each of which takes inertia that is unobservable
at a joint from its link and gives it to the parent link.

In a joint's own frame its twist S is constant, and a body d (ten) on its link is, for the parent link, the body
exp(A q) d with A = `frame_change_rates(S)`. With X the twist of the parent link, its energy is

    f' exp(A q) d + v <X'S, exp(A q) d> + v^2/2 <S'S, d>,

f the functional that gives energies of bodies on the parent link. It is the same for all q and v when f'A, <X'S, .>
and <S'S, .> vanish on exp(A q) d, that is on d, A d, A^2 d, ...: d is in the unobservable space of a linear system.
What matters of the motion before the joint is only what f and X span, and these spans follow from the root, where f is
gravity's alone and X is zero: X spans, after the joint, all exp(-ad(S) q) X and S, and f the functionals that it
spanned before and those that are observable at the joint. A planar arm's spans stay small for good; most arms' are
everything after three or four joints.

Why transfers are all there is: in an energy that never changes, only a leaf's own part has the leaf's q and v. So
the leaf's body must be unobservable at its joint; give it to the parent link, take the leaf off, and go on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import GROUND
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.tree.joint_frames import JointFrames, twist_entries, twist_matrices
from adaptctl.identifiability.tree.pseudo_inertia import frame_change_rates, frame_changes, functionals

NEGLIGIBLE = 1e-8
"""Relative size below which singular values count as zero: halfway, in digits, between lengths and round-off."""
POWERS = 5
"""Number of powers of A that matter: a turn's eigenvalues are 0, +-i and +-2i, so A^5 is a sum of lower powers, and a
shift has A^3 = 0."""
BODY = 11
"""Numbers of a body: its ten, and the inertia of the joint's rotor, whose energy is v^2/2."""


class LinkParameters(NamedTuple):
    """The n inertial parameters that belong to a link and its joint, or have been passed to it from its children, as
    bodies.

    `indices` (n,) are their zero-based positions among the mechanism's P inertial parameters; `bodies` (11, n) has a
    column for each: the body whose parameter is 1 and whose others are 0. A body is the ten (m, mc_x, mc_y, mc_z, I_xx,
    I_xy, I_yy, I_xz, I_yz, I_zz) in the joint's frame, then the joint's rotor inertia, in kg and in units of the tree's
    characteristic length. Nothing is checked.
    """

    indices: NDArray[np.int64]
    """Indices (n,) among the P parameters."""
    bodies: Array
    """Bodies (11, n), a column for each parameter at 1."""


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
    """Every link's own parameters (N,)."""
    to_parent: Array
    """Matrices (N, 10, 10) from tens in the joint's frame to those in the parent joint's frame, at zero."""
    observable: tuple[Array, ...]
    """Orthonormal functionals (r, 11) of bodies, for each of N joints, that energies depend on."""
    unobservable: tuple[Array, ...]
    """Orthonormal bodies (11 - r, 11), for each of N joints, that change no energy; a missing rotor among them."""

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
