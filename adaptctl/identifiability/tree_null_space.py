"""The null space of a tree's energies from its inertial transfers, regrouped from the leaves and verified."""

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
from adaptctl.identifiability.energy_matrix import FLOOR, SMALLEST_NORM, energy_scales, length_scales, parameter_units
from adaptctl.identifiability.inertial_transfers import (
    BODY,
    NEGLIGIBLE,
    InertialTransfers,
    LinkParameters,
    frame_changes,
    inertial_transfers,
)
from adaptctl.identifiability.regrouping import (
    CLEAR,
    TOLERANCE,
    Regrouping,
    by_null_vectors,
    independent_columns,
    validate_tolerance,
)
from adaptctl.identifiability.sampling import States
from adaptctl.scalars import column

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


@dataclass(frozen=True, eq=False)
class TreeNullSpace:
    """The null space of a tree's energies, found joint by joint in time that grows with the number of links: the
    directions of the `mechanism`'s P inertial parameters (all but friction) that change no energy.

    `transfers` are the inertial transfers at its joints, changes of a link's and its parent's parameters that together
    change no energy; `seed` draws the 46 states whose energies make `scales`, by which parameters of different units
    become comparable. Made by `of`; nothing is checked at construction.
    """

    mechanism: Mechanism
    transfers: InertialTransfers
    seed: int

    @classmethod
    def of(cls, mechanism: Mechanism, seed: int = 0) -> TreeNullSpace:
        """The null space of a tree's energies, from its geometry and the direction of gravity. States, drawn by `seed`,
        0 by default, are sampled only for its property `scales`, which makes parameters of different units comparable.
        The mechanism must be a tree whose parameters are not constrained; this is not checked."""
        return cls(mechanism, inertial_transfers(mechanism), seed)

    @cached_property
    def rank(self) -> int:
        """The rank k: the number of independent directions of the tree's P inertial parameters (all but friction) that
        change energies and torques."""
        return self.mechanism.num_energy_parameters - self.transfers.nullity

    @cached_property
    def scales(self) -> Array:
        """The scales (P,), positive, in SI units per J, that make the tree's P inertial parameters D (all but friction)
        comparable: D / scales are all in J. Each is 1/e, where e is the root of the summed squares of the kinetic plus
        potential energies that a unit of the parameter has at 46 random states, drawn by this object's `seed`. Where e
        is below 1e-3 of the largest (units counted in the mechanism's characteristic length), that floor replaces it.
        """
        return energy_scales(self.mechanism, self.seed)

    @cached_property
    def null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k), without a unit, k the rank: directions of the tree's P inertial parameters
        D, divided by this object's `scales` (P,), D / scales in J, that change no energy."""
        found = self._by_links(range(self.mechanism.num_energy_parameters), TOLERANCE)
        vectors = np.zeros((self.mechanism.num_energy_parameters, len(found.removed)))
        vectors[list(found.removed), range(len(found.removed))] = 1.0
        vectors[list(found.kept)] = -found.coefficients
        return np.linalg.qr(vectors)[0]

    def regrouping(self, order: Sequence[int], tolerance: float) -> Regrouping:
        """The regrouping that removes P-k of the tree's P scaled parameters in an `order`, k the rank, and adds them to
        the k kept ones, made link by link from the leaves to the root.

        `order` (P,) has all zero-based indices, the first removed first. At each link any independence counts that is
        more than round-off (1e-8). `tolerance`, without a unit, is for choices from all null vectors (P, P-k) at once:
        a parameter is removed where its row of them, less its projection on the rows of those removed before, is
        longer. Where that would remove other parameters, the regrouping is made in this way, which takes longer. Raises
        `InputError` for a tolerance that is not between 0 and 1/sqrt(P).
        """
        validate_tolerance(tolerance, self.mechanism.num_energy_parameters)
        with suppress(np.linalg.LinAlgError):  # Of what is hardly independent, round-off may leave nothing.
            found = self._by_links(order, CLEAR)
            if found.leaves_more_than(tolerance, order):
                return found
        return by_null_vectors(self.null_basis, order, tolerance)

    def _by_links(self, order: Sequence[int], tolerance: float) -> Regrouping:
        """The regrouping by choices made link by link alone, with coefficients among parameters over their scales."""
        found = tree_regrouping(self.transfers, order, tolerance)
        own = parameter_units(self.mechanism, self.transfers.frames.length) / self.scales
        kept, removed = list(found.kept), list(found.removed)
        return replace(found, coefficients=found.coefficients * own[kept, None] / own[removed])


@dataclass(frozen=True, eq=False)
class TransferEvidence:
    """The evidence for the rank of a tree's energies: at each joint, the rank of the energy changes, at sampled states,
    when inertial parameters are moved from its link to the parent link, against that by geometry. Ratios have no unit;
    sigma_1 >= sigma_2 >= ... are a joint's singular values, k its rank by geometry.

    `surplus` is the sum over the joints of ranks by energies less those by geometry, 0 if all agree; `gap` the smallest
    sigma_k/sigma_k+1 of all joints, `smallest` the smallest sigma_k/sigma_1; `residual` the largest energy change by a
    combination of parameters that by geometry makes none, over the largest that one of its size could make; `weakest`
    (11,) the singular values of the joint with the smallest gap; `leftover` the largest sigma_k+1/sigma_1, round-off if
    the ranks agree, and `worst` the zero-based index of the joint that has that `leftover`. Nothing is checked at
    construction.
    """

    surplus: int
    gap: float
    smallest: float
    residual: float
    weakest: Array
    leftover: float
    worst: int


def energy_changes(mechanism: Mechanism, found: InertialTransfers, states: States) -> Array:
    """Energy changes (N, samples, 11), in J per kg, as a body is moved from the link of each of a tree's N joints to
    the parent link, at `samples` given `states`. They are the kinetic plus potential energy of the body on the joint's
    link, less its energy on the parent link (on the ground for a joint there), in the pose that it has there at joint
    position zero.

    They are per unit of each of a body's parameters: the ten (m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz)
    in the joint's frame, with lengths in units of the tree's characteristic length, and the joint's rotor inertia, 0
    where it has none. `mechanism` is the tree, `found` are its inertial transfers, whose joint frames are used. A
    combination of the eleven is unobservable at a joint exactly when the energy changes in no state. Nothing is
    checked.
    """
    energies = _energies(mechanism, found.frames.length, states) @ frame_changes(
        np.asarray(np.linalg.inv(found.frames.far), dtype=np.float64)
    )
    before = np.zeros((len(energies) + 1, *energies.shape[1:]))
    before[:-1] = energies
    before[GROUND, :, 1:4] = -mechanism.description.gravity * found.frames.length
    out = np.zeros((*energies.shape[:2], BODY))
    out[..., :10] = energies - before[list(found.parents)] @ found.to_parent
    rotors = np.array([own.bodies[10].any() for own in found.own]) * found.frames.rotor_scales
    out[..., 10] = 0.5 * rotors[:, None] * states.v.T**2
    return out


def transfer_evidence(found: InertialTransfers, changes: Array) -> TransferEvidence:
    """The evidence for a tree's rank: at each of N joints, the singular values of the energy `changes` (N, samples,
    11), in J per kg, against the rank by geometry in `found`, the tree's inertial transfers.

    The changes, of `energy_changes` at `samples` states, 11 or more, are per unit of each of 11 inertial parameters
    that is moved from a link to its parent; columns are divided by their norms, or by 1e-3 of the joint's largest norm
    where that is more. Raises `numpy.linalg.LinAlgError` for NaN.
    """
    norms = np.linalg.norm(changes, axis=1, keepdims=True)
    scales = 1.0 / np.maximum(norms, SMALLEST_NORM * norms.max(axis=2, keepdims=True))
    values = np.linalg.svd(changes * scales, compute_uv=False)
    relative = np.maximum(values / values[:, :1], FLOOR)
    ratios = relative[:, :-1] / relative[:, 1:]
    ranks = np.array([len(functionals) for functionals in found.observable])
    last, beyond = (np.arange(len(ranks)), ranks - 1), (np.arange(len(ranks)), ranks)
    return TransferEvidence(
        surplus=int((ratios.argmax(axis=1) + 1 - ranks).sum()),
        gap=float(ratios[last].min()),
        smallest=float(relative[last].min()),
        residual=_residual(found, changes),
        weakest=values[ratios[last].argmin()],
        leftover=float(relative[beyond].max()),
        worst=int(relative[beyond].argmax()),
    )


def _energies(mechanism: Mechanism, length: float, states: States) -> Array:
    """Energies (N, samples, 10) of the ten of every link, massless ones too, with lengths in units of `length`."""
    tree, places, rates = TreeEquations.of(mechanism.description), column(states.p), column(states.v)
    row = energy.energy_regressor(tree.links, places, rates, tree.gravity)
    energies = stacked(row.of, (len(states),)).reshape(len(states), -1, 10)
    return energies.transpose(1, 0, 2) * length_scales(parameter_names(["link"]), length)


def _residual(found: InertialTransfers, changes: Array) -> float:
    """Largest relative energy change by an unobservable body, over all joints."""
    pairs = zip(found.observable, found.unobservable, strict=True)
    bodies = np.stack([np.vstack([0.0 * functionals, bodies]) for functionals, bodies in pairs])
    sizes = np.abs(changes).max(axis=(1, 2))[:, None] * np.abs(bodies).max(axis=2)
    largest = np.abs(changes @ bodies.mT).max(axis=1)
    return float(np.divide(largest, sizes, out=np.zeros_like(sizes), where=sizes > 0.0).max())
