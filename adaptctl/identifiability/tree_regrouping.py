"""A tree's parameters regrouped from the leaves to the root, in time that grows with the number of links."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from adaptctl.identifiability.inertial_transfers import NEGLIGIBLE, InertialTransfers, Owned
from adaptctl.identifiability.regrouping import Regrouping
from adaptctl.mechanism import GROUND
from adaptctl.mechanism.pose import Array


def tree_regrouping(transfers: InertialTransfers, order: Sequence[int], tolerance: float) -> Regrouping:
    """Remove parameters in an order, the first first; what stays is the same as by looking at all at once.

    At each link, from the leaves, its parameters and those that no link above it has kept are bodies, d. Its joint
    feels only F d, so as many are kept as F d has independent columns, the last in the order before the others. Of
    each of the others the kept ones say all that the joint feels, F d = (F d_kept) c, and what is left of it,
    d - d_kept c, goes to the link before. What reaches the ground is felt by nobody.

    What a subtree keeps is kept for good: a parameter stays when the null vectors' rows of those before it determine
    its own (Sheu and Walker 1991, theorem 4.1), and rows that do so within a subtree do so among all.
    """
    importance = np.empty(len(order))
    importance[list(order)] = np.arange(len(order))
    said = np.zeros((len(order), len(order)))
    kept: list[int] = []
    pools = [[owned] for owned in transfers.owned]
    for i in reversed(range(len(pools))):
        parameters, bodies = np.concatenate([p for p, _ in pools[i]]), np.hstack([d for _, d in pools[i]])
        felt = transfers.felt[i] @ bodies
        stay, go = _chosen(felt, importance[parameters], tolerance)
        coefficients = _solved(felt[:, stay], felt[:, go])
        said[np.ix_(parameters[stay], parameters[go])] = coefficients
        kept += parameters[stay].tolist()
        if transfers.parents[i] != GROUND:
            left = transfers.given(i, bodies[:, go] - bodies[:, stay] @ coefficients)
            pools[transfers.parents[i]].append(Owned(parameters[go], left))
    return _collected(said, kept)


def _chosen(felt: Array, importance: Array, tolerance: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The most important columns (r, n) that are independent, and the others.

    A column is taken when more than `tolerance` of it is left beside those taken before, as long as there are such.
    """
    order = np.argsort(-importance)
    left, taken = felt[:, order], list[int]()
    for _ in range(min(felt.shape)):
        sizes = np.einsum("ij,ij->j", left, left)
        first = int(np.argmax(sizes > tolerance**2))
        best = first if sizes[first] > tolerance**2 else int(np.argmax(sizes))
        if sizes[best] <= NEGLIGIBLE**2:
            break
        direction = left[:, best] / np.sqrt(sizes[best])
        left = left - direction[:, None] * (direction @ left)
        taken.append(best)
    others = np.ones(len(order), dtype=bool)
    others[taken] = False
    return order[taken], order[others]


def _solved(kept: Array, others: Array) -> Array:
    """c (k, n) of kept @ c = others, which the columns of `kept` (r, k), k <= r, span."""
    if kept.shape[0] == kept.shape[1]:
        return np.asarray(np.linalg.solve(kept, others), dtype=np.float64)
    directions, triangle = np.linalg.qr(kept)
    return np.asarray(np.linalg.solve(triangle, directions.T @ others), dtype=np.float64)


def _collected(said: Array, kept: Sequence[int]) -> Regrouping:
    """The regrouping from what every parameter that is kept says of others as it is kept, in that order.

    One that came from a link above has by then been partly said by what is kept there, and means the rest of itself.
    So with S of the kept among themselves (strictly upper triangular) and R of the removed, C = (1 + S)^-1 R.
    """
    order = np.array(kept, dtype=np.int64)
    removed = np.setdiff1d(np.arange(len(said)), order)
    among = said[np.ix_(order, order)]
    late = np.flatnonzero(among.any(axis=0))
    coefficients = said[np.ix_(order, removed)]
    if late.size:
        rest = np.linalg.solve(among[np.ix_(late, late)] + np.eye(late.size), coefficients[late])
        coefficients = coefficients - among[:, late] @ rest
    rising = np.argsort(order)
    return Regrouping(tuple(order[rising].tolist()), tuple(removed.tolist()), coefficients[rising], len(kept))
