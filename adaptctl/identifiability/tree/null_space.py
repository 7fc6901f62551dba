"""The null space of a tree as inertial transfers, and bases of it where they are asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.regrouping import Regrouping, by_null_vectors
from adaptctl.identifiability.sampled_regressors import energetic_names
from adaptctl.identifiability.scaling import length_scales
from adaptctl.identifiability.selection import TOLERANCE, require_tolerance
from adaptctl.identifiability.tree.regrouping import tree_regrouping
from adaptctl.identifiability.tree.unobservable_inertia import InertialTransfers, inertial_transfers


@dataclass(frozen=True, eq=False)
class TransferredNullSpace:
    """The parameters of a tree that change no energy, found joint by joint."""

    transfers: InertialTransfers
    scales: Array
    """(P,): 1, L, L^2 for kg, kg m and kg m^2"""
    rank: int

    @classmethod
    def of(cls, mechanism: Mechanism) -> TransferredNullSpace:
        """From a tree's geometry and the direction of gravity."""
        found = inertial_transfers(mechanism)
        scales = length_scales(energetic_names(mechanism), found.frames.length)
        for owned, rotor in zip(found.owned, found.frames.rotor_scales, strict=True):
            scales[owned.parameters[owned.bodies[10] != 0.0]] = rotor
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
        """Parameters removed in an order, regrouped from the leaves to the root.

        Where joints are close to special places, what nearly depends on each other may be taken for independent at a
        link, and is not when all null vectors are looked at together; that takes longer.
        """
        require_tolerance(tolerance, len(self.scales))
        found = tree_regrouping(self.transfers, order, tolerance)
        return found if found.determined else by_null_vectors(self.null_basis, order, tolerance)
