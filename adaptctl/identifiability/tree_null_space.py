"""Null space of a tree's energies from its inertial transfers."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array, stacked
from adaptctl.caching import cached_property
from adaptctl.description import GROUND
from adaptctl.description.inertia import parameter_names
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion import energy
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.identifiability.energy_matrix import (
    MIN_NORM_RATIO,
    SINGULAR_VALUE_FLOOR,
    energy_scales,
    length_scales,
    parameter_units,
)
from adaptctl.identifiability.inertial_transfers import (
    BODY_PARAMETERS,
    RANK_TOLERANCE,
    InertialTransfers,
    LinkParameters,
    frame_changes,
    inertial_transfers,
)
from adaptctl.identifiability.regrouping import (
    CERTAIN_INDEPENDENCE,
    TOLERANCE,
    Regrouping,
    by_null_vectors,
    independent_columns,
    validate_tolerance,
)
from adaptctl.identifiability.sampling import States
from adaptctl.scalars import column

Indices = NDArray[np.int64]

# Up to six dependent parameters are passed to the parent unchanged; more are first reduced to independent
# representatives.
MAX_PASSED_UNCHANGED = 6


class _LinkSelection(NamedTuple):
    kept: Indices
    dependent: Indices
    # Coefficients (kept, dependent) of the dependent parameters' observable parts on the kept ones.
    coefficients: Array
    # Dependent parameters whose remainders are passed to the parent.
    representatives: Indices
    # The other dependent parameters.
    represented: Indices
    # Weights (representatives, represented) of the represented remainders on those of the representatives.
    weights: Array


def tree_regrouping(transfers: InertialTransfers, order: Sequence[int], tolerance: float) -> Regrouping:
    """Regrouping of a tree in an order (P,), from the leaves."""
    # At each link, its own parameters and those passed from its children are bodies d (11,). Energies depend on F d,
    # so as many stay as F d has independent columns, from the end of the order; the remainder of each other one,
    # unobservable here, is passed to the parent. What a subtree keeps is kept for good: rows that determine a parameter
    # within a subtree do so among all (Sheu and Walker 1991, theorem 4.1).
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
    indices, bodies = pool
    kept, others, coefficients = _chosen(observable @ bodies, importance[indices], tolerance)
    remainders = bodies[:, others] - bodies[:, kept] @ coefficients
    dependent = indices[others]
    if len(others) <= MAX_PASSED_UNCHANGED:
        none, no_weights = dependent[:0], np.zeros((len(others), 0))
        return _LinkSelection(indices[kept], dependent, coefficients, dependent, none, no_weights), remainders
    lead, rest, weights = _chosen(unobservable @ remainders, importance[dependent], tolerance)
    selection = _LinkSelection(indices[kept], dependent, coefficients, dependent[lead], dependent[rest], weights)
    return selection, remainders[:, lead]


def _chosen(columns: Array, importance: Array, tolerance: float) -> tuple[Indices, Indices, Array]:
    order = (-importance).argsort()
    columns = columns.take(order, axis=1)
    found, directions = independent_columns(columns, tolerance, RANK_TOLERANCE)
    taken, others = np.array(found, dtype=np.int64), np.ones(len(order), dtype=bool)
    others[taken] = False
    rest, seen = others.nonzero()[0], directions @ columns
    coefficients = np.linalg.solve(seen.take(taken, axis=1), seen.take(rest, axis=1))
    return order[taken], order[rest], np.asarray(coefficients, dtype=np.float64)


def _collected(selections: Sequence[_LinkSelection], parameters: int) -> Regrouping:
    order = np.concatenate([selection.kept for selection in selections])
    row, column = np.full(parameters, -1), np.full(parameters, -1)
    row[order] = np.arange(len(order))
    removed = np.flatnonzero(row < 0)
    column[removed] = np.arange(len(removed))
    coefficients = np.zeros((len(order), len(removed)))
    end = len(order)
    for own in reversed(selections):
        begin, gone = end - len(own.kept), row[own.dependent] < 0
        coefficients[begin:end, column[own.dependent[gone]]] = own.coefficients[:, gone]
        if len(own.represented):
            passed = row[own.representatives] < 0
            of_them = coefficients[end:, column[own.representatives[passed]]] @ own.weights[passed]
            of_them[row[own.representatives[~passed]] - end] += own.weights[~passed]
            coefficients[end:, column[own.represented]] = of_them
        coefficients[begin:end] -= own.coefficients[:, ~gone] @ coefficients[row[own.dependent[~gone]]]
        end = begin
    rising = np.argsort(order)
    return Regrouping(tuple(order[rising].tolist()), tuple(removed.tolist()), coefficients[rising], len(order))


@dataclass(frozen=True, eq=False)
class TreeNullSpace:
    """Null space of a tree's energies, found joint by joint in linear time."""

    mechanism: Mechanism
    transfers: InertialTransfers
    seed: int

    @classmethod
    def of(cls, mechanism: Mechanism, seed: int = 0) -> TreeNullSpace:
        """Null space of a tree."""
        return cls(mechanism, inertial_transfers(mechanism), seed)

    @cached_property
    def rank(self) -> int:
        """Rank k, the number of directions that change energies."""
        return self.mechanism.num_energy_parameters - self.transfers.nullity

    @cached_property
    def scales(self) -> Array:
        """Scales (P,) in SI units per J."""
        return energy_scales(self.mechanism, self.seed)

    @cached_property
    def null_basis(self) -> Array:
        """Orthonormal basis (P, P-k) of changes of scaled parameters that change no energy."""
        found = self._by_links(range(self.mechanism.num_energy_parameters), TOLERANCE)
        vectors = np.zeros((self.mechanism.num_energy_parameters, len(found.removed)))
        vectors[list(found.removed), range(len(found.removed))] = 1.0
        vectors[list(found.kept)] = -found.coefficients
        return np.linalg.qr(vectors)[0]

    def regrouping(self, order: Sequence[int], tolerance: float) -> Regrouping:
        """Regrouping in an order, link by link."""
        validate_tolerance(tolerance, self.mechanism.num_energy_parameters)
        with suppress(np.linalg.LinAlgError):  # Of what is hardly independent, round-off may leave nothing.
            found = self._by_links(order, CERTAIN_INDEPENDENCE)
            if found.leaves_more_than(tolerance, order):
                return found
        return by_null_vectors(self.null_basis, order, tolerance)

    def _by_links(self, order: Sequence[int], tolerance: float) -> Regrouping:
        found = tree_regrouping(self.transfers, order, tolerance)
        own = parameter_units(self.mechanism, self.transfers.frames.length) / self.scales
        kept, removed = list(found.kept), list(found.removed)
        coefficients = found.coefficients * own[kept, None]
        coefficients /= own[removed]
        return replace(found, coefficients=coefficients)


@dataclass(frozen=True, eq=False)
class TransferEvidence:
    """Sampled singular values of energy changes at each joint, with the ranks by geometry."""

    surplus: int
    gap: float
    smallest: float
    residual: float
    singular_values: Array
    leftover: float
    worst: int


def energy_changes(mechanism: Mechanism, found: InertialTransfers, states: States) -> Array:
    """Energy changes (N, samples, 11) in J per kg of bodies moved from each joint's link to its parent."""
    energies = _energies(mechanism, found.frames.length, states) @ frame_changes(
        np.asarray(np.linalg.inv(found.frames.far), dtype=np.float64)
    )
    before = np.zeros((len(energies) + 1, *energies.shape[1:]))
    before[:-1] = energies
    before[GROUND, :, 1:4] = -mechanism.description.gravity * found.frames.length
    out = np.zeros((*energies.shape[:2], BODY_PARAMETERS))
    out[..., :10] = energies - before[list(found.parents)] @ found.to_parent
    rotors = np.array([own.bodies[10].any() for own in found.own]) * found.frames.rotor_scales
    out[..., 10] = 0.5 * rotors[:, None] * states.v.T**2
    return out


def transfer_evidence(found: InertialTransfers, changes: Array) -> TransferEvidence:
    """Evidence for a tree's rank, by energy changes (N, samples, 11)."""
    norms = np.linalg.norm(changes, axis=1, keepdims=True)
    scales = 1.0 / np.maximum(norms, MIN_NORM_RATIO * norms.max(axis=2, keepdims=True))
    values = np.linalg.svd(changes * scales, compute_uv=False)
    relative = np.maximum(values / values[:, :1], SINGULAR_VALUE_FLOOR)
    ratios = relative[:, :-1] / relative[:, 1:]
    ranks = np.array([len(functionals) for functionals in found.observable])
    last, beyond = (np.arange(len(ranks)), ranks - 1), (np.arange(len(ranks)), ranks)
    return TransferEvidence(
        surplus=int((ratios.argmax(axis=1) + 1 - ranks).sum()),
        gap=float(ratios[last].min()),
        smallest=float(relative[last].min()),
        residual=_residual(found, changes),
        singular_values=values[ratios[last].argmin()],
        leftover=float(relative[beyond].max()),
        worst=int(relative[beyond].argmax()),
    )


def _energies(mechanism: Mechanism, length: float, states: States) -> Array:
    tree, places, rates = TreeEquations.of(mechanism.description), column(states.p), column(states.v)
    row = energy.energy_regressor(tree.links, places, rates, tree.gravity)
    energies = stacked(row.of, (len(states),)).reshape(len(states), -1, 10)
    return energies.transpose(1, 0, 2) * length_scales(parameter_names(["link"]), length)


def _residual(found: InertialTransfers, changes: Array) -> float:
    pairs = zip(found.observable, found.unobservable, strict=True)
    bodies = np.stack([np.vstack([0.0 * functionals, bodies]) for functionals, bodies in pairs])
    sizes = np.abs(changes).max(axis=(1, 2))[:, None] * np.abs(bodies).max(axis=2)
    largest = np.abs(changes @ bodies.mT).max(axis=1)
    return float(np.divide(largest, sizes, out=np.zeros_like(sizes), where=sizes > 0.0).max())
