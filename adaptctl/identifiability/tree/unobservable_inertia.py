"""Which inertia can change hands across a joint without any energy changing: the null space of a tree, joint by joint.

Wensing, Niemeyer and Slotine (2017, "Observability in inertial parameter identification", arXiv:1711.03896): a change
of parameters changes no torque exactly when it is a sum of transfers, each of which takes inertia that a joint does
not feel from its link and gives it to the link before.

In a joint's own frame its twist S is constant, and a body d (ten) on its link is, for the link before, the body
exp(A q) d with A = `transfer_rates(S)`. With X a twist of the link before, its energy is

    f' exp(A q) d + v <X'S, exp(A q) d> + v^2/2 <S'S, d>,

f the functional that gives energies of bodies on the link before. It is the same for all q and v when f'A, <X'S, .>
and <S'S, .> vanish on exp(A q) d, that is on d, A d, A^2 d, ...: d cannot be observed through them. What matters of the
motion before the joint is only what f and X span, and these spans follow from the root, where f is gravity's alone and
X is zero: X spans, after the joint, all exp(-ad(S) q) X and S, and f the functionals that it spanned before and those
that the joint feels. A planar arm's spans stay small for good; most arms' are everything after three or four joints.

Why transfers are all there is: in an energy that never changes, only a leaf's own part has the leaf's q and v. So
the leaf's body must be one that its joint does not feel; give it to the link before, take the leaf off, and go on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import GROUND
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.tree.inertia_functionals import functionals, transfer_rates, transfers
from adaptctl.identifiability.tree.joint_frames import JointFrames, twist_entries, twist_matrices

NEGLIGIBLE = 1e-8
"""Of the largest: singular values below count as zero. Halfway, in digits, between lengths and round-off."""
POWERS = 5
"""Of A for a turn: its eigenvalues are 0, +-i and +-2i, so A^5 is a sum of lower powers. A shift has A^3 = 0."""
FELT = 11
"""A body's ten, and the inertia of the joint's rotor, whose energy is v^2/2."""


class Owned(NamedTuple):
    """Parameters of one link and its joint."""

    parameters: NDArray[np.int64]
    """(n,): which of the P"""
    bodies: Array
    """(11, n): each at 1, as a body"""


@dataclass(frozen=True, eq=False)
class InertialTransfers:
    """What every joint of a tree feels. Bodies are tens in the joint's frame, with lengths in units of the frames'
    length, and as an eleventh number the inertia of the joint's rotor."""

    frames: JointFrames
    owned: tuple[Owned, ...]
    """(N,)"""
    to_parent: Array
    """(N, 10, 10): tens in the joint's frame to those in the frame of the joint before, at zero"""
    felt: tuple[Array, ...]
    """(N,) of (r, 11): orthonormal functionals that the joint feels"""
    unfelt: tuple[Array, ...]
    """(N,) of (11 - r, 11): orthonormal bodies that it does not feel; a rotor that it does not have among them"""

    @property
    def parents(self) -> tuple[int, ...]:
        """Every link's parent (N,), -1 for the ground."""
        return self.frames.parents

    def given(self, i: int, bodies: Array) -> Array:
        """Bodies (11, n) that joint i does not feel, given to the link before."""
        out = np.zeros_like(bodies)
        out[:10] = self.to_parent[i] @ bodies[:10]
        return out

    @property
    def nullity(self) -> int:
        """How many independent combinations of parameters change no energy.

        They are what each joint does not feel of the bodies that are its link's own or have come to it. A link with
        mass makes up for what comes, a massless one owns nothing to do so and must pass it on.
        """
        count = 0
        waiting: list[list[Array]] = [[] for _ in self.parents]
        for i in reversed(range(len(self.parents))):
            bodies = np.hstack([self.owned[i].bodies, *waiting[i]])
            parent = self.parents[i]
            if parent != GROUND and self.massless(parent):
                unnoticed = bodies @ _null_space(self.felt[i] @ bodies)
                waiting[parent].append(self.given(i, unnoticed))
            elif self.massless(i):
                count += _null_space(self.felt[i] @ bodies).shape[1]
            else:
                count += bodies.shape[1] - len(self.felt[i])
        return count

    def massless(self, i: int) -> bool:
        """Whether a link owns no ten."""
        return len(self.owned[i].parameters) < 10


def inertial_transfers(mechanism: Mechanism) -> InertialTransfers:
    """What every joint feels, all from the tree's geometry and gravity's direction: nothing is sampled."""
    frames = JointFrames.of(mechanism)
    rates = transfer_rates(twist_matrices(frames.twists))
    across = transfers(frames.near)
    sensed = _repeated(_sensed(frames, across, rates), rates, POWERS)
    rows = np.zeros((*sensed.shape[:2], FELT))
    rows[..., :10] = sensed
    rows[:, 0, 10] = _rotors(mechanism)  # The first row is S'S, for v^2/2: so is a rotor's energy.
    _, values, vectors = np.linalg.svd(rows, full_matrices=False)
    counts = (values > NEGLIGIBLE * values[:, :1]).sum(axis=1).tolist()
    return InertialTransfers(
        frames=frames,
        owned=_owned(mechanism, transfers(frames.far)),
        to_parent=across,
        felt=tuple(v[:k] for v, k in zip(vectors, counts, strict=True)),
        unfelt=tuple(v[k:] for v, k in zip(vectors, counts, strict=True)),
    )


def _sensed(frames: JointFrames, across: Array, rates: Array) -> Array:
    """Functionals (N, 17, 10) that every joint feels at q = 0, in its frame: S'S, the <X'S, .> and the f'A.

    X and f run through bases of what they span on the link before; rows that are not needed are zero.
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
            f[:, 0] = 0.0  # Where the tree stands, which no joint feels.
        out[i, 1 : 1 + len(X)] = X @ pairing[i]
        out[i, 7 : 7 + len(f)] = f @ rates[i]
        spans[i] = (_grown(X, frames.twists[i][None], bracket[i]), _grown(f, out[i], rates[i]))
    return out


def _moved(space: Array, matrix: Array) -> Array:
    """A space's basis (r, n) after an invertible change of frame; what is everything stays everything."""
    return space if len(space) == len(matrix) else space @ matrix


def _grown(space: Array, more: Array, generator: Array) -> Array:
    """A basis of the least space that holds a space (r, n), more rows, and the products of its rows with the
    generator (n, n)."""
    if len(space) == len(generator):
        return space
    return _row_space(_repeated(np.vstack([space, more]), generator, POWERS))


def _row_space(rows: Array) -> Array:
    """An orthonormal basis (r, n) of what rows (m, n) span; the identity where that is everything."""
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
    """An orthonormal basis (n, n - rank) of what a matrix (m, n) takes to zero."""
    _, values, vectors = np.linalg.svd(matrix)
    return np.asarray(vectors[int(np.count_nonzero(values > NEGLIGIBLE)) :].T, dtype=np.float64)


def _owned(mechanism: Mechanism, to_joint: Array) -> tuple[Owned, ...]:
    """The parameters by link; `to_joint` (N, 10, 10) takes tens from links' frames to their joints'."""
    description = mechanism.description
    owned = [Owned(np.zeros(0, dtype=np.int64), np.zeros((FELT, 0)))] * len(description.links)
    for place, i in enumerate(description.bodies):
        bodies = np.zeros((FELT, 10))
        bodies[:10] = to_joint[i]
        owned[i] = Owned(np.arange(10 * place, 10 * place + 10), bodies)
    rotors = np.flatnonzero(_rotors(mechanism)).tolist()
    for place, i in enumerate(rotors, 10 * len(description.bodies)):
        bodies = np.column_stack([owned[i].bodies, np.eye(FELT)[:, 10]])
        owned[i] = Owned(np.append(owned[i].parameters, place), bodies)
    return tuple(owned)


def _rotors(mechanism: Mechanism) -> Array:
    """1 for every joint (N,) that has a rotor, 0 for the others."""
    return np.array([float(link.joint.drive.rotor_inertia is not None) for link in mechanism.links])
