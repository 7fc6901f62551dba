"""The numerical rank of a sampled regressor, decided by a gap among singular values once columns are comparable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description.inertia import PARAMETERS
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.energy_matrix import EnergyFactor, energetic_names, energies
from adaptctl.identifiability.factorisation import right_vectors, triangle
from adaptctl.identifiability.regrouping import Regrouping, by_null_vectors
from adaptctl.identifiability.sampling import characteristic_length, random_states

LENGTH_POWERS = dict(zip((*PARAMETERS, "rotor_inertia"), (0, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2), strict=True))
"""Powers of a length: mass, first moment and inertia are kg times L^0, L^1 and L^2."""
SMALLEST_NORM = 1e-3
"""Floor under column norms, relative to the largest. Without it, columns of mere round-off are blown up."""
NOTHING = 1e-12
"""Largest singular value of a matrix that is zero but for round-off, where columns had a norm of one before energies
were subtracted from one another."""
FEW_STATES = 46
"""States that tell the size of energies, and, joint by joint, the ranks of their changes: twice eleven and two more,
doubled."""
FLOOR = 1e-15
"""Floor under singular values, relative to the largest: below, they are round-off, and their ratios say nothing."""


def length_scales(parameter_names: Sequence[str], length: float) -> Array:
    """Factors (P,) 1, L, L^2 of masses, first moments and inertias, for a length L in m."""
    powers = np.array([LENGTH_POWERS[name.rsplit(".", 1)[-1]] for name in parameter_names], dtype=np.float64)
    return np.asarray(length**powers)


def parameter_units(mechanism: Mechanism, length: float) -> Array:
    """Units (P,) 1, L, L^2 of the parameters that enter energies, in kg, kg m and kg m^2, for a length L in m."""
    slides = {f"{k.joint.name}.rotor_inertia" for k in mechanism.links if not k.joint.kind.turns}
    names = energetic_names(mechanism)
    return np.where([name in slides for name in names], 1.0, length_scales(names, length))


def column_scales(norms: Array, parameter_names: Sequence[str], length: float) -> Array:
    """Factors (P,) that make a regressor's columns comparable, whatever the units and the size of the mechanism.

    Columns of these norms (P,) are multiplied by (1, L, L^2) for mass, first moment and inertia, then divided by
    max(norm, floor). Norms must be those of energies before differencing: a column that is constant then keeps its
    size, and its round-off stays small.
    """
    sizes = length_scales(parameter_names, length)
    scaled = norms * sizes
    largest = scaled.max(initial=0.0)
    return sizes / np.maximum(scaled, SMALLEST_NORM * largest) if largest > 0.0 else sizes


def energy_scales(mechanism: Mechanism, seed: int) -> Array:
    """Scales (P,) that make the parameters D / scales comparable, by their energies at a few random states.

    Choices among parameters of different units are made on D / scales, whichever way the null space was found.
    """
    E = energies(mechanism, random_states(mechanism, FEW_STATES, np.random.default_rng(seed)))
    return column_scales(np.linalg.norm(E, axis=0), energetic_names(mechanism), characteristic_length(mechanism))


@dataclass(frozen=True)
class NumericalRank:
    """The numerical rank k of a matrix, where its singular values have their largest gap; 0 where all are round-off."""

    rank: int
    gap: float
    """sigma_k/sigma_k+1"""
    smallest: float
    """sigma_k/sigma_1"""

    @classmethod
    def of(cls, singular_values: ArrayLike) -> NumericalRank:
        """The rank at the largest ratio sigma_k/sigma_k+1 of singular values (n,), falling; full rank is possible too.

        Ratios to sigma_1 are floored at 1e-15. Nothing above 1e-12 is rank 0, by the largest gap there can be.
        """
        values = np.asarray(singular_values, dtype=np.float64)
        if values.max(initial=0.0) <= NOTHING:
            return cls(0, 1.0 / FLOOR, 1.0)
        relative = np.maximum(np.append(values / values[0], 0.0), FLOOR)
        ratios = relative[:-1] / relative[1:]
        k = int(np.argmax(ratios)) + 1
        return cls(k, float(ratios[k - 1]), float(relative[k - 1]))


@dataclass(frozen=True, eq=False)
class ScaledRegressor:
    """A sampled regressor with comparable columns, as the triangle of its QR factors."""

    scales: Array
    """Factors (P,) of the columns."""
    triangle: Array
    """R (P, P) of the scaled regressor."""

    @classmethod
    def of_energies(cls, mechanism: Mechanism, factor: EnergyFactor) -> ScaledRegressor:
        """The scaled regressor of energy differences of more states than there are parameters, scaled by the energies
        themselves."""
        return cls._scaled(mechanism, factor.triangle, factor.square_sums)

    @classmethod
    def of_torques(cls, mechanism: Mechanism, rows: Array) -> ScaledRegressor:
        """The scaled regressor of rows (n, P) of the torque regressor, more than there are parameters."""
        return cls._scaled(mechanism, triangle(rows), np.square(rows).sum(axis=0))

    @classmethod
    def _scaled(cls, mechanism: Mechanism, R: Array, square_sums: Array) -> ScaledRegressor:
        names, length = energetic_names(mechanism), characteristic_length(mechanism)
        scales = column_scales(np.sqrt(square_sums), names, length)
        return cls(scales, R * scales)

    @cached_property
    def singular_values(self) -> Array:
        """The singular values (P,), falling."""
        return np.asarray(np.linalg.svd(self.triangle, compute_uv=False), dtype=np.float64)

    @cached_property
    def vectors(self) -> Array:
        """The right singular vectors (P, P), a vector a column."""
        return right_vectors(self.triangle)

    @cached_property
    def decision(self) -> NumericalRank:
        """The numerical rank with its gap."""
        return NumericalRank.of(self.singular_values)

    @property
    def rank(self) -> int:
        """The rank k."""
        return self.decision.rank

    @property
    def null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k) among the scaled parameters D / scales."""
        return self.vectors[:, self.rank :]

    def rank_of(self, columns: Sequence[int]) -> int:
        """The rank of some columns of H = U S V'; without U, which changes no rank."""
        shares = (self.vectors * self.singular_values)[list(columns)]
        return NumericalRank.of(np.linalg.svd(shares, compute_uv=False)).rank


@dataclass(frozen=True, eq=False)
class DecomposedNullSpace:
    """The null space of a regressor by its decomposition, among parameters of other scales than its columns'."""

    regressor: ScaledRegressor
    scales: Array
    """Scales (P,) that make parameters comparable."""

    @property
    def rank(self) -> int:
        """The number of independent parameters k."""
        return self.regressor.rank

    @cached_property
    def null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k) among the scaled parameters D / scales."""
        vectors = self.regressor.null_basis * (self.regressor.scales / self.scales)[:, None]
        return np.asarray(np.linalg.qr(vectors)[0], dtype=np.float64)

    def regrouping(self, order: Sequence[int], tolerance: float) -> Regrouping:
        """The regrouping that removes parameters in an order, with the rank of the columns that are kept."""
        found = by_null_vectors(self.null_basis, order, tolerance)
        return replace(found, rank=self.regressor.rank_of(found.kept))
