"""A sampled regressor with comparable columns, factored: where ranks are decided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.energy_factor import EnergyFactor
from adaptctl.identifiability.numerical_rank import NumericalRank, right_vectors, triangle
from adaptctl.identifiability.regrouping import Regrouping, by_null_vectors
from adaptctl.identifiability.sampled_regressors import energetic_names
from adaptctl.identifiability.sampling import characteristic_length
from adaptctl.identifiability.scaling import comparable


@dataclass(frozen=True, eq=False)
class ScaledRegressor:
    """A regressor times `scales` (P,), as the triangle R (P, P) of its QR factors."""

    scales: Array
    triangle: Array

    @classmethod
    def of_energies(cls, mechanism: Mechanism, factor: EnergyFactor) -> ScaledRegressor:
        """Differences of more energies than there are parameters; scaled by the energies themselves."""
        return cls._scaled(mechanism, factor.triangle, factor.square_sums)

    @classmethod
    def of_torques(cls, mechanism: Mechanism, rows: Array) -> ScaledRegressor:
        """Rows of the torque regressor, more than there are parameters."""
        return cls._scaled(mechanism, triangle(rows), np.square(rows).sum(axis=0))

    @classmethod
    def _scaled(cls, mechanism: Mechanism, R: Array, square_sums: Array) -> ScaledRegressor:
        names, length = energetic_names(mechanism), characteristic_length(mechanism)
        scales = comparable(np.sqrt(square_sums), names, length)
        return cls(scales, R * scales)

    @cached_property
    def singular_values(self) -> Array:
        """The singular values (P,), falling."""
        return np.asarray(np.linalg.svd(self.triangle, compute_uv=False), dtype=np.float64)

    @cached_property
    def vectors(self) -> Array:
        """The right vectors (P, P), a vector a column."""
        return right_vectors(self.triangle)

    @cached_property
    def decision(self) -> NumericalRank:
        """The rank, with its gap."""
        return NumericalRank.of(self.singular_values)

    @property
    def rank(self) -> int:
        """The rank k."""
        return self.decision.rank

    @property
    def null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k) among the scaled parameters D / scales."""
        return self.vectors[:, self.rank :]

    def regrouping(self, order: Sequence[int], tolerance: float) -> Regrouping:
        """Parameters removed in an order, and the rank of the columns that are kept."""
        found = by_null_vectors(self.null_basis, order, tolerance)
        return replace(found, rank=self._rank_of(found.kept))

    def _rank_of(self, columns: Sequence[int]) -> int:
        """The rank of some columns of H = U S V'; without U, which changes no rank."""
        shares = (self.vectors * self.singular_values)[list(columns)]
        return NumericalRank.of(np.linalg.svd(shares, compute_uv=False)).rank
