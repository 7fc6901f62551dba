"""A tree's parameters regrouped from the leaves to the root, in time that grows with the number of links."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import GROUND
from adaptctl.identifiability.regrouping import Regrouping
from adaptctl.identifiability.selection import independent_columns
from adaptctl.identifiability.tree.unobservable_inertia import NEGLIGIBLE, InertialTransfers, LinkParameters

Indices = NDArray[np.int64]

FEW = 6
"""Up to six dependent parameters are passed to the parent unchanged; more are first reduced to independent
representatives."""


class _LinkSelection(NamedTuple):
    """The parameters that met at a link: kept there, or dependent on those."""

    kept: Indices
    dependent: Indices
    coefficients: Array
    """Coefficients (kept, dependent) of the dependent parameters' observable parts on the kept ones."""
    representatives: Indices
    """Dependent parameters whose remainders are passed to the parent."""
    represented: Indices
    """The other dependent parameters."""
    weights: Array
    """Weights (representatives, represented) of the represented remainders on those of the representatives."""


def tree_regrouping(transfers: InertialTransfers, order: Sequence[int], tolerance: float) -> Regrouping:
    """The regrouping that removes a tree's dependent inertial parameters in an `order` (P,), all zero-based indices,
    the first removed first, and adds them to the kept ones, the same as by all null vectors at once.

    `transfers` are the tree's inertial transfers; a column counts as independent at a link where its part orthogonal to
    those taken before is longer than `tolerance`, without a unit. Nothing is checked; `numpy.linalg.LinAlgError` may be
    raised where the tolerance is near round-off.

    At each link, from the leaves, the link's own parameters and those passed from its children are bodies d (11,), ten
    inertial parameters and a rotor inertia each. Energies depend only on F d, with the joint's observable functionals F
    (n, 11), n of 1 to 11, so as many parameters are kept as F d has independent columns, chosen from the end of the
    order. Each dependent one has F d = (F d_kept) c, and its remainder d - d_kept c, which is unobservable at the
    joint, is passed to the parent. Of more than six remainders only independent ones are passed on, chosen from the end
    of the order; they represent all. What reaches the ground changes no energy.

    What a subtree keeps is kept for good: a parameter stays when the null vectors' rows of those before it determine
    its own (Sheu and Walker 1991, theorem 4.1), and rows that do so within a subtree do so among all. In the same way
    no represented parameter will ever be kept.
    """
    importance = np.empty(len(order))
    importance[list(order)] = np.arange(len(order))
    selections: list[_LinkSelection] = []
    pools = [[own] for own in transfers.own]
    for i in reversed(range(len(pools))):
        pool = LinkParameters(np.concatenate([p for p, _ in pools[i]]), np.hstack([d for _, d in pools[i]]))
        observable, unobservable = transfers.observable[i], transfers.unobservable[i]
        selection, remainders = _selected(pool, observable, unobservable, importance, tolerance)
        selections.append(selection)
        if transfers.parents[i] != GROUND:
            passed = LinkParameters(selection.representatives, transfers.passed_to_parent(i, remainders))
            pools[transfers.parents[i]].append(passed)
    return _collected(selections, len(order))


def _selected(
    pool: LinkParameters, observable: Array, unobservable: Array, importance: Array, tolerance: float
) -> tuple[_LinkSelection, Array]:
    """The selection at a link, and the remainders (11, n) of its representatives."""
    indices, bodies = pool
    kept, others, coefficients = _chosen(observable @ bodies, importance[indices], tolerance)
    remainders = bodies[:, others] - bodies[:, kept] @ coefficients
    dependent = indices[others]
    if len(others) <= FEW:
        none, no_weights = dependent[:0], np.zeros((len(others), 0))
        return _LinkSelection(indices[kept], dependent, coefficients, dependent, none, no_weights), remainders
    lead, rest, weights = _chosen(unobservable @ remainders, importance[dependent], tolerance)
    selection = _LinkSelection(indices[kept], dependent, coefficients, dependent[lead], dependent[rest], weights)
    return selection, remainders[:, lead]


def _chosen(columns: Array, importance: Array, tolerance: float) -> tuple[Indices, Indices, Array]:
    """The most important independent columns of (r, n), the others, and c (chosen, others) in others = chosen @ c."""
    order = np.argsort(-importance)
    columns = columns[:, order]
    taken, directions = independent_columns(columns, tolerance, NEGLIGIBLE)
    rest = np.ones(len(order), dtype=bool)
    rest[taken] = False
    seen = directions @ columns
    return order[taken], order[rest], np.asarray(np.linalg.solve(seen[:, taken], seen[:, rest]), dtype=np.float64)


def _collected(selections: Sequence[_LinkSelection], parameters: int) -> Regrouping:
    """The regrouping from the selections at all links, leaves first, substituted from the root to the leaves.

    Kept parameters have a row each, in the order of keeping, which begins with the coefficients at their own links. A
    parameter that is kept nearer to the root stands for its remainder alone: its row, complete by then, is subtracted
    from the rows of those that its observable parts depended on. A represented parameter's coefficients nearer to the
    root are those of its representatives, weighted.
    """
    order = np.concatenate([selection.kept for selection in selections])
    row = np.full(parameters, -1)
    row[order] = np.arange(len(order))
    coefficients = np.zeros((len(order), parameters))
    coefficients[np.arange(len(order)), order] = 1.0
    end = len(order)
    for selection in reversed(selections):
        begin = end - len(selection.kept)
        coefficients[begin:end, selection.dependent] = selection.coefficients
        coefficients[end:, selection.represented] = coefficients[end:, selection.representatives] @ selection.weights
        later = selection.representatives[row[selection.representatives] >= 0]
        coefficients[begin:end] -= coefficients[begin:end, later] @ coefficients[row[later]]
        end = begin
    removed = np.flatnonzero(row < 0)
    rising = np.argsort(order)
    matrix = coefficients[np.ix_(rising, removed)]
    return Regrouping(tuple(order[rising].tolist()), tuple(removed.tolist()), matrix, len(order))
