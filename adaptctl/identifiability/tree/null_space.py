"""The null space of a tree's energies from its geometry, as inertial transfers, with bases where they are asked for."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.regrouping import Regrouping, by_null_vectors
from adaptctl.identifiability.scaled_rank import energy_scales, parameter_units
from adaptctl.identifiability.selection import CLEAR, TOLERANCE, require_tolerance
from adaptctl.identifiability.tree.regrouping import tree_regrouping
from adaptctl.identifiability.tree.unobservable_inertia import InertialTransfers, inertial_transfers


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
    """The seed of the states whose energies tell the scales."""

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
        return self.mechanism.energetic - self.transfers.nullity

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
        found = self._by_links(range(self.mechanism.energetic), TOLERANCE)
        vectors = np.zeros((self.mechanism.energetic, len(found.removed)))
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
        require_tolerance(tolerance, self.mechanism.energetic)
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
