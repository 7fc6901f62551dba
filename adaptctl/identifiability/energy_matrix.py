"""Energy differences and torques at sampled states, and their rank."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description.inertia import PARAMETERS
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.factorisation import right_vectors, triangle
from adaptctl.identifiability.regrouping import Regrouping, by_null_vectors
from adaptctl.identifiability.sampling import States, characteristic_length, random_accelerations, random_states

# States at once, or four times as many as there are parameters.
BLOCK_STATES = 1024


# Powers of a length: mass, first moment and inertia are kg times L^0, L^1 and L^2.
LENGTH_POWERS = dict(zip((*PARAMETERS, "rotor_inertia"), (0, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2), strict=True))
# Floor under column norms, relative to the largest. Without it, columns of mere round-off are blown up.
MIN_NORM_RATIO = 1e-3
# Largest singular value of a matrix that is zero but for round-off, where columns had a norm of one before energies
# were subtracted from one another.
ZERO_MATRIX_TOLERANCE = 1e-12
# States that tell the size of energies, and, joint by joint, the ranks of their changes: twice eleven and two more,
# doubled.
SCALING_STATES = 46
# Floor under singular values, relative to the largest: below, they are round-off, and their ratios say nothing.
SINGULAR_VALUE_FLOOR = 1e-15


def energies(mechanism: Mechanism, states: States) -> Array:
    """Energy regressor (samples, P) in J per SI unit of each parameter."""
    # Plus zero, since factors may follow the sign of a zero, which is Python's or native code's.
    return mechanism.energy_regressor(states.p, states.v)[..., : mechanism.num_energy_parameters] + 0.0


def energies_of_sets(mechanism: Mechanism, *sets: Iterable[States]) -> list[Iterable[Array]]:
    """Energy regressors at sets of states, in blocks; where each is a list of one, by one call for all."""
    if not all(isinstance(each, list) for each in sets):
        return [energy_blocks(mechanism, each) for each in sets]
    states = [state for (state,) in sets]
    p, v = (np.concatenate([getattr(each, what) for each in states]) for what in "pv")
    together = energies(mechanism, States(p, v, ""))
    return [[rows] for rows in np.split(together, np.cumsum([len(each) for each in states[:-1]]))]


def energy_blocks(mechanism: Mechanism, states: Iterable[States]) -> Iterator[Array]:
    """Energy regressors in blocks of at most max(1024, 4 P) states."""
    for some in states:
        for part in some.split(max(BLOCK_STATES, 4 * mechanism.num_energy_parameters)):
            yield energies(mechanism, part)


def energy_differences(mechanism: Mechanism, states: States) -> Array:
    """Energy differences H (samples - 1, P) of successive states (Sheu and Walker 1991, equation 8)."""
    # Energies themselves hold the potential's constant, which changes no torque: the rank may be one too many.
    return np.diff(energies(mechanism, states), axis=0)


@dataclass(frozen=True, eq=False)
class EnergyFactor:
    """Triangular factor of energy differences, by blocks (TSQR: Demmel et al. 2012)."""

    triangle: Array
    square_sums: Array
    last: Array

    @classmethod
    def of(cls, blocks: Iterable[Array], before: EnergyFactor | None = None) -> EnergyFactor:
        """Factor of blocks of energies (m, P), after those of `before`."""
        factor = before
        for block in blocks:
            factor = cls._started(block) if factor is None else factor.then(block)
        if factor is None:
            raise ValueError("expected at least one state")
        return factor

    @classmethod
    def _started(cls, energies: Array) -> EnergyFactor:
        return cls(triangle(np.diff(energies, axis=0)), np.square(energies).sum(axis=0), energies[-1:])

    def then(self, energies: Array) -> EnergyFactor:
        """Factor with the energies (m, P) of more states."""
        rows = np.diff(energies, axis=0, prepend=self.last)
        squares = self.square_sums + np.square(energies).sum(axis=0)
        return EnergyFactor(triangle(np.vstack([self.triangle, rows])), squares, energies[-1:])


def torque_rows(mechanism: Mechanism, generator: np.random.Generator) -> Array:
    """Rows (n, P) of the torque regressor at random states, forces times the characteristic length."""
    columns = range(mechanism.num_energy_parameters)
    samples = max(2, -(-2 * len(columns) // mechanism.dof))
    states = random_states(mechanism, samples, generator)
    a = random_accelerations(mechanism, samples, generator)
    Y = mechanism.torque_regressor(states.p, states.v, a, columns)
    length = characteristic_length(mechanism)
    arms = [1.0 if joint.kind.is_revolute else length for joint in mechanism.primary_joints]
    return (Y * np.array(arms)[:, None]).reshape(samples * mechanism.dof, len(columns))


def length_scales(parameter_names: Sequence[str], length: float) -> Array:
    """Scale factors (P,): 1, L and L^2 for masses, first moments and inertias, L the characteristic length."""
    powers = np.array([LENGTH_POWERS[name.rsplit(".", 1)[-1]] for name in parameter_names], dtype=np.float64)
    return np.asarray(length**powers)


def parameter_units(mechanism: Mechanism, length: float) -> Array:
    """Units (P,) of the parameters for lengths in `length` (m)."""
    slides = {f"{k.joint.name}.rotor_inertia" for k in mechanism.links if not k.joint.kind.is_revolute}
    names = mechanism.parameter_names[: mechanism.num_energy_parameters]
    return np.where([name in slides for name in names], 1.0, length_scales(names, length))


def column_scales(norms: Array, parameter_names: Sequence[str], length: float) -> Array:
    """Scales (P,) of columns: inverse norms, floored at 1e-3 of the largest."""
    sizes = length_scales(parameter_names, length)
    scaled = norms * sizes
    largest = scaled.max(initial=0.0)
    return sizes / np.maximum(scaled, MIN_NORM_RATIO * largest) if largest > 0.0 else sizes


def energy_scales(mechanism: Mechanism, seed: int) -> Array:
    """Scales (P,) in SI units per J: inverse energies at 46 random states, floored."""
    return scales_of(mechanism, energies(mechanism, scaling_states(mechanism, seed)))


def scaling_states(mechanism: Mechanism, seed: int) -> States:
    """Random states whose energies are the scales."""
    return random_states(mechanism, SCALING_STATES, np.random.default_rng(seed))


def scales_of(mechanism: Mechanism, E: Array) -> Array:
    """Scales (P,) in SI units per J: inverse norms of energies (m, P), floored."""
    return column_scales(
        np.linalg.norm(E, axis=0),
        mechanism.parameter_names[: mechanism.num_energy_parameters],
        characteristic_length(mechanism),
    )


@dataclass(frozen=True)
class NumericalRank:
    """Rank k, the gap sigma_k/sigma_k+1, and sigma_k/sigma_1."""

    rank: int
    gap: float
    smallest: float

    @classmethod
    def from_singular_values(cls, singular_values: ArrayLike) -> NumericalRank:
        """Rank at the largest gap of singular values (n,), floored at 1e-15 of the first."""
        values = np.asarray(singular_values, dtype=np.float64)
        if values.max(initial=0.0) <= ZERO_MATRIX_TOLERANCE:
            return cls(0, 1.0 / SINGULAR_VALUE_FLOOR, 1.0)
        relative = np.maximum(np.append(values / values[0], 0.0), SINGULAR_VALUE_FLOOR)
        ratios = relative[:-1] / relative[1:]
        k = int(np.argmax(ratios)) + 1
        return cls(k, float(ratios[k - 1]), float(relative[k - 1]))


@dataclass(frozen=True, eq=False)
class ScaledRegressor:
    """Regressor of energies or torques with scaled columns, kept as its triangular factor."""

    scales: Array
    triangle: Array

    @classmethod
    def of_energies(cls, mechanism: Mechanism, factor: EnergyFactor) -> ScaledRegressor:
        """Scaled regressor of a mechanism's energy differences."""
        return cls._scaled(mechanism, factor.triangle, factor.square_sums)

    @classmethod
    def of_torques(cls, mechanism: Mechanism, rows: Array) -> ScaledRegressor:
        """Scaled regressor of torque rows (m, P)."""
        return cls._scaled(mechanism, triangle(rows), np.square(rows).sum(axis=0))

    @classmethod
    def _scaled(cls, mechanism: Mechanism, R: Array, square_sums: Array) -> ScaledRegressor:
        names, length = mechanism.parameter_names[: mechanism.num_energy_parameters], characteristic_length(mechanism)
        scales = column_scales(np.sqrt(square_sums), names, length)
        return cls(scales, R * scales)

    @cached_property
    def singular_values(self) -> Array:
        """Singular values (P,) in descending order."""
        return np.asarray(np.linalg.svd(self.triangle, compute_uv=False), dtype=np.float64)

    @cached_property
    def vectors(self) -> Array:
        """Orthonormal right singular vectors (P, P) in columns."""
        return right_vectors(self.triangle)

    @cached_property
    def decision(self) -> NumericalRank:
        """Numerical rank of the scaled columns."""
        return NumericalRank.from_singular_values(self.singular_values)

    @property
    def rank(self) -> int:
        """Number of independent columns."""
        return self.decision.rank

    @property
    def null_basis(self) -> Array:
        """Orthonormal basis (P, P-k) of the null space of the scaled columns."""
        return self.vectors[:, self.rank :]

    def rank_of(self, columns: Sequence[int]) -> int:
        """Numerical rank of some columns alone."""
        shares = (self.vectors * self.singular_values)[list(columns)]
        return NumericalRank.from_singular_values(np.linalg.svd(shares, compute_uv=False)).rank


@dataclass(frozen=True, eq=False)
class DecomposedNullSpace:
    """Null space by singular value decomposition of a regressor."""

    regressor: ScaledRegressor
    scales: Array

    @property
    def rank(self) -> int:
        """Rank k of the regressor."""
        return self.regressor.rank

    @cached_property
    def null_basis(self) -> Array:
        """Orthonormal basis (P, P-k) of changes of scaled parameters that change no energy."""
        vectors = self.regressor.null_basis * (self.regressor.scales / self.scales)[:, None]
        return np.asarray(np.linalg.qr(vectors)[0], dtype=np.float64)

    def regrouping(self, order: Sequence[int], tolerance: float) -> Regrouping:
        """Regrouping that removes P-k parameters in an order."""
        found = by_null_vectors(self.null_basis, order, tolerance)
        return replace(found, rank=self.regressor.rank_of(found.kept))
