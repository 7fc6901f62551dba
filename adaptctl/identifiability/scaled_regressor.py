"""A sampled regressor with comparable columns, factored: where ranks are decided."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.numerical_rank import NumericalRank, singular_values, triangle
from adaptctl.identifiability.sampled_regressors import energetic_names, energies
from adaptctl.identifiability.sampling import States, characteristic_length
from adaptctl.identifiability.scaling import column_scales
from adaptctl.mechanism.pose import Array


@dataclass(frozen=True, eq=False)
class ScaledRegressor:
    """A regressor times `scales` (P,), as the triangle R (P, P) of its QR factors."""

    scales: Array
    triangle: Array

    @classmethod
    def of_energies(cls, mechanism: Mechanism, states: States) -> ScaledRegressor:
        """Energy differences at more states than there are parameters; scaled by the energies themselves."""
        E = energies(mechanism, states)
        return cls._factored(np.diff(E, axis=0), _scales(mechanism, E))

    @classmethod
    def of_torques(cls, mechanism: Mechanism, rows: Array) -> ScaledRegressor:
        """Rows of the torque regressor, more than there are parameters."""
        return cls._factored(rows, _scales(mechanism, rows))

    @classmethod
    def _factored(cls, regressor: Array, scales: Array) -> ScaledRegressor:
        return cls(scales, triangle(regressor * scales))

    @cached_property
    def singular_values(self) -> Array:
        """The singular values (P,), falling."""
        return singular_values(self.triangle)

    @cached_property
    def vectors(self) -> Array:
        """The right vectors (P, P), a vector a column."""
        return np.linalg.svd(self.triangle)[2].T

    @cached_property
    def decision(self) -> NumericalRank:
        """The rank, with its gap."""
        return NumericalRank.of(self.singular_values)

    @property
    def null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k) among the scaled parameters."""
        return self.vectors[:, self.decision.rank :]


def _scales(mechanism: Mechanism, regressor: Array) -> Array:
    return column_scales(regressor, energetic_names(mechanism), characteristic_length(mechanism))
