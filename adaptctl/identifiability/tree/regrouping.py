"""A tree's parameters regrouped from the leaves to the root, in time that grows with the number of links."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import GROUND
from adaptctl.identifiability.regrouping import Regrouping
from adaptctl.identifiability.tree.unobservable_inertia import NEGLIGIBLE, InertialTransfers, Owned

Indices = NDArray[np.int64]

FEW = 6
"""Others that go to the link before as they are; of more, envoys go."""


class _Parting(NamedTuple):
    """What became of the parameters that met at a link."""

    kept: Indices
    others: Indices
    shares: Array
    """(kept, others): what the kept ones say of the others"""
    envoys: Indices
    """those of the others that go to the link before"""
    followers: Indices
    """the rest of the others"""
    weights: Array
    """(envoys, followers): what followers say beyond the kept ones, as envoys do"""


def tree_regrouping(transfers: InertialTransfers, order: Sequence[int], tolerance: float) -> Regrouping:
    """Remove parameters in an order, the first first; what stays is the same as by looking at all at once.

    At each link, from the leaves, its parameters and those that come from the links above are bodies, d. Its joint
    feels only F d, so as many are kept as F d has independent columns, the last in the order before the others. Of
    each of the others the kept ones say all that the joint feels, F d = (F d_kept) c, and what is left of it,
    d - d_kept c, goes to the link before. Only few of these are independent; the last ones in the order go as
    envoys of all. What reaches the ground is felt by nobody.

    What a subtree keeps is kept for good: a parameter stays when the null vectors' rows of those before it determine
    its own (Sheu and Walker 1991, theorem 4.1), and rows that do so within a subtree do so among all. In the same way
    none that is not an envoy will ever be kept.
    """
    importance = np.empty(len(order))
    importance[list(order)] = np.arange(len(order))
    partings: list[_Parting] = []
    pools = [[owned] for owned in transfers.owned]
    for i in reversed(range(len(pools))):
        pool = Owned(np.concatenate([p for p, _ in pools[i]]), np.hstack([d for _, d in pools[i]]))
        parting, left = _parted(pool, transfers.felt[i], transfers.unfelt[i], importance, tolerance)
        partings.append(parting)
        if transfers.parents[i] != GROUND:
            pools[transfers.parents[i]].append(Owned(parting.envoys, transfers.given(i, left)))
    return _collected(partings, len(order))


def _parted(pool: Owned, felt: Array, unfelt: Array, importance: Array, tolerance: float) -> tuple[_Parting, Array]:
    """Who stays, who goes, and the bodies (11, n) that the envoys take along."""
    names, bodies = pool
    stay, go, shares = _chosen(felt @ bodies, importance[names], tolerance)
    left = bodies[:, go] - bodies[:, stay] @ shares
    others = names[go]
    if len(go) <= FEW:
        return _Parting(names[stay], others, shares, others, others[:0], np.zeros((len(go), 0))), left
    lead, follow, weights = _chosen(unfelt @ left, importance[others], tolerance)
    return _Parting(names[stay], others, shares, others[lead], others[follow], weights), left[:, lead]


def _chosen(columns: Array, importance: Array, tolerance: float) -> tuple[Indices, Indices, Array]:
    """The most important columns (r, n) that are independent, the others, and c in others = chosen @ c.

    A column is taken when more than `tolerance` of it is left beside those taken before, as long as there are such.
    """
    order = np.argsort(-importance)
    columns = columns[:, order]
    left, taken, directions = columns, list[int](), list[Array]()
    for _ in range(min(columns.shape)):
        sizes = np.einsum("ij,ij->j", left, left)
        best = int((sizes > tolerance**2).argmax())
        if not sizes[best] > tolerance**2:
            best = int(sizes.argmax())
            if sizes[best] <= NEGLIGIBLE**2:
                break
        direction = left[:, best] / math.sqrt(sizes[best])
        left = left - direction[:, None] * (direction @ left)
        taken.append(best)
        directions.append(direction)
    rest = np.ones(len(order), dtype=bool)
    rest[taken] = False
    seen = np.array(directions).reshape(len(taken), len(columns)) @ columns
    return order[taken], order[rest], np.asarray(np.linalg.solve(seen[:, taken], seen[:, rest]), dtype=np.float64)


def _collected(partings: Sequence[_Parting], parameters: int) -> Regrouping:
    """The regrouping from what happened at each link, leaves first, unrolled from the root.

    A row is for one that is kept, in the order of keeping, and begins with what it says at its own link. One that is
    kept farther on was said in part at the links that it passed: it means the rest of itself, so the rows of those
    who said it lose as much of its row, which is complete by then. Followers say what their envoys say farther on.
    """
    order = np.concatenate([parting.kept for parting in partings])
    row = np.full(parameters, -1)
    row[order] = np.arange(len(order))
    said = np.zeros((len(order), parameters))
    said[np.arange(len(order)), order] = 1.0
    end = len(order)
    for parting in reversed(partings):
        begin = end - len(parting.kept)
        said[begin:end, parting.others] = parting.shares
        said[end:, parting.followers] = said[end:, parting.envoys] @ parting.weights
        later = parting.envoys[row[parting.envoys] >= 0]
        said[begin:end] -= said[begin:end, later] @ said[row[later]]
        end = begin
    removed = np.flatnonzero(row < 0)
    rising = np.argsort(order)
    return Regrouping(tuple(order[rising].tolist()), tuple(removed.tolist()), said[np.ix_(rising, removed)], len(order))
