"""The null space of a tree's energies from its geometry, as inertial transfers, with bases where they are asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.energy_matrix import energetic_names
from adaptctl.identifiability.regrouping import Regrouping, by_null_vectors
from adaptctl.identifiability.scaled_rank import length_scales
from adaptctl.identifiability.selection import TOLERANCE, require_tolerance
from adaptctl.identifiability.tree.regrouping import tree_regrouping
from adaptctl.identifiability.tree.unobservable_inertia import InertialTransfers, inertial_transfers


@dataclass(frozen=True, eq=False)
class TreeNullSpace:
    """The null space of a tree's energies, found joint by joint in time linear in the number of links."""

    transfers: InertialTransfers
    scales: Array
    """Scales (P,) 1, L, L^2 of parameters in kg, kg m and kg m^2."""
    rank: int
    """The number of independent parameters k."""

    @classmethod
    def of(cls, mechanism: Mechanism) -> TreeNullSpace:
        """The null space of a tree, from its geometry and the direction of gravity; nothing is sampled."""
        found = inertial_transfers(mechanism)
        scales = length_scales(energetic_names(mechanism), found.frames.length)
        for own, rotor in zip(found.own, found.frames.rotor_scales, strict=True):
            scales[own.indices[own.bodies[10] != 0.0]] = rotor
        return cls(found, scales, len(scales) - found.nullity)

    @cached_property
    def null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k) among the scaled parameters D / scales."""
        found = tree_regrouping(self.transfers, range(len(self.scales)), TOLERANCE)
        vectors = np.zeros((len(self.scales), len(found.removed)))
        vectors[list(found.removed), range(len(found.removed))] = 1.0
        vectors[list(found.kept)] = -found.coefficients
        return np.linalg.qr(vectors)[0]

    def regrouping(self, order: Sequence[int], tolerance: float) -> Regrouping:
        """The regrouping that removes parameters in an order (P,), made from the leaves to the root.

        Near special positions of joints, parameters that nearly depend on each other may count as independent at one
        link. If the result is then ill-conditioned, all null vectors are looked at together, which takes longer.
        Raises `InputError` for a tolerance that is not between 0 and 1/sqrt(P).
        """
        require_tolerance(tolerance, len(self.scales))
        found = tree_regrouping(self.transfers, order, tolerance)
        return found if found.determined else by_null_vectors(self.null_basis, order, tolerance)
