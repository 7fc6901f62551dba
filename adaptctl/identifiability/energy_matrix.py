"""Energy differences and torques at sampled states, and their rank, decided by a gap among singular values."""

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

BLOCK = 1024
"""States at once, or four times as many as there are parameters."""


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


def energies(mechanism: Mechanism, states: States) -> Array:
    """The energy regressor (samples, P) at sampled states: kinetic plus potential energy, in J per SI unit of each of a
    mechanism's P inertial parameters (all but friction). `states` are `samples` positions and velocities of the primary
    (independent) joints. Raises `InputError` for states of another number of joints, `SingularityError` near a
    singularity of closed loops."""
    return mechanism.energy_regressor(states.p, states.v)[..., : mechanism.num_energy_parameters]


def energy_blocks(mechanism: Mechanism, states: Iterable[States]) -> Iterator[Array]:
    """Iterator over the energy regressors at many states, in blocks (m, P) of m states, at most max(1024, 4 P)
    successive ones or one more: kinetic plus potential energy, in J per SI unit of each of a mechanism's P inertial
    parameters (all but friction). `states` is an iterable of `States`. Raises, in the course of the iteration,
    `InputError` for states of another number of joints and `SingularityError` near a singularity of closed loops."""
    for some in states:
        for part in some.parts(max(BLOCK, 4 * mechanism.num_energy_parameters)):
            yield energies(mechanism, part)


def energy_differences(mechanism: Mechanism, states: States) -> Array:
    """The matrix H (samples - 1, P) of energy differences between successive `states`, `samples` positions and
    velocities of the primary (independent) joints: row i is the energy in state i + 1 less that in state i, kinetic
    plus potential. It is in J per SI unit of each of a mechanism's P inertial parameters, all but friction (Sheu and
    Walker 1991, equations 8 and 13).

    The energies themselves hold the potential's constant, which changes no torque; with it, the rank may be one too
    many. Raises `InputError` for states of another number of joints, `SingularityError` near a singularity of closed
    loops.
    """
    return np.diff(energies(mechanism, states), axis=0)


@dataclass(frozen=True, eq=False)
class EnergyFactor:
    """Triangular factor R of the differences H = Q R, Q orthonormal, of kinetic plus potential energy between
    successive states: it has H's singular values and right singular vectors, and is updated as states come.

    `triangle` is R (n, P), n at most P, in J per SI unit of each of P inertial parameters, or H itself while it has at
    most P rows; `square_sums` (P,) are the sums, over the states, of squares of the energies themselves, in the square
    of that unit, and `last` (1, P) the energies of the last state, from which the next one's are subtracted. Made by
    `of`; nothing is checked at construction.

    Blocks of rows are put under R and factored again (TSQR: Demmel, Grigori, Hoemmen and Langou 2012), so that the
    storage does not grow with the samples. Columns may be scaled afterwards, without loss of accuracy, since
    Householder's R is accurate column by column.
    """

    triangle: Array
    square_sums: Array
    last: Array

    @classmethod
    def of(cls, blocks: Iterable[Array], before: EnergyFactor | None = None) -> EnergyFactor:
        """The triangular factor R (n, P), n at most P, of the differences H = Q R, Q orthonormal, of energies between
        successive states, as an `EnergyFactor`. Energies (m, P) at m states, in J per SI unit of each of P parameters,
        come in `blocks`; the states follow those of the factor `before`, if one is given (None by default). Raises
        `ValueError` when there is no block and no factor before, and for blocks of different widths."""
        factor = before
        for block in blocks:
            factor = cls._started(block) if factor is None else factor.then(block)
        if factor is None:
            raise ValueError("no states")
        return factor

    @classmethod
    def _started(cls, energies: Array) -> EnergyFactor:
        return cls(triangle(np.diff(energies, axis=0)), np.square(energies).sum(axis=0), energies[-1:])

    def then(self, energies: Array) -> EnergyFactor:
        """The triangular factor R (n, P), n at most P, of the differences H = Q R, Q orthonormal, of energies between
        the states of this factor and m more after them, as a new `EnergyFactor`. `energies` (m, P) are those of the m
        states, in J per SI unit of each of P parameters. Raises `ValueError` for another number of parameters."""
        rows = np.diff(energies, axis=0, prepend=self.last)
        squares = self.square_sums + np.square(energies).sum(axis=0)
        return EnergyFactor(triangle(np.vstack([self.triangle, rows])), squares, energies[-1:])


def torque_rows(mechanism: Mechanism, generator: np.random.Generator) -> Array:
    """Rows (n, P), n at least 2 P, of a mechanism's torque regressors at random states and accelerations, drawn with
    NumPy's `generator` by `random_states` and `random_accelerations`. They come state after state, a row for each
    primary (independent) joint, in N m per SI unit of each of P inertial parameters (all but friction).

    Forces of prismatic joints are multiplied by the mechanism's characteristic length in m. Raises `InputError` for a
    reference configuration that breaks the mechanism's conditions (bounds on its positions).
    """
    columns = range(mechanism.num_energy_parameters)
    samples = max(2, -(-2 * len(columns) // mechanism.dof))
    states = random_states(mechanism, samples, generator)
    a = random_accelerations(mechanism, samples, generator)
    Y = mechanism.torque_regressor(states.p, states.v, a, columns)
    length = characteristic_length(mechanism)
    arms = [1.0 if joint.kind.is_revolute else length for joint in mechanism.primary_joints]
    return (Y * np.array(arms)[:, None]).reshape(samples * mechanism.dof, len(columns))


def length_scales(parameter_names: Sequence[str], length: float) -> Array:
    """Scale factors (P,) of inertial parameters: 1, L and L^2 for masses, first moments, and moments of inertia (rotor
    inertias among them), with a `length` L in m. Parameters divided by their factors are comparable. `parameter_names`
    are P, such as ``link1.mc_x``, of which the part after the last dot counts. Raises `KeyError` for friction and other
    names."""
    powers = np.array([LENGTH_POWERS[name.rsplit(".", 1)[-1]] for name in parameter_names], dtype=np.float64)
    return np.asarray(length**powers)


def parameter_units(mechanism: Mechanism, length: float) -> Array:
    """Units (P,) of a mechanism's P inertial parameters (all but friction) when lengths are counted in a `length` L
    (m): 1, L and L^2 for masses (kg), first moments (kg m) and moments of inertia (kg m^2). Rotor inertias count as
    masses at prismatic joints, as moments of inertia at others. Nothing is checked."""
    slides = {f"{k.joint.name}.rotor_inertia" for k in mechanism.links if not k.joint.kind.is_revolute}
    names = mechanism.parameter_names[: mechanism.num_energy_parameters]
    return np.where([name in slides for name in names], 1.0, length_scales(names, length))


def column_scales(norms: Array, parameter_names: Sequence[str], length: float) -> Array:
    """Scale factors (P,), SI units per J, by which the columns of a regressor of P parameters are multiplied so that
    they are comparable, whatever the units and the size of the mechanism.

    The factor of a column i of norm n_i is L_i / max(L_i n_i, 1e-3 max_j L_j n_j), where L_i is 1, L or L^2 for a mass,
    a first moment or a moment of inertia, and L the `length` in m; it is L_i where all norms are 0. The `norms` (P,),
    in J per SI unit of each parameter, must be those of the energies themselves, not of their differences: a column
    that is constant then keeps its size, and its round-off stays small. `parameter_names` are P, such as
    ``link1.mc_x``. Raises `KeyError` for friction and other names.
    """
    sizes = length_scales(parameter_names, length)
    scaled = norms * sizes
    largest = scaled.max(initial=0.0)
    return sizes / np.maximum(scaled, SMALLEST_NORM * largest) if largest > 0.0 else sizes


def energy_scales(mechanism: Mechanism, seed: int) -> Array:
    """The scales (P,), SI units per J, that make a mechanism's P inertial parameters D (all but friction) comparable: D
    / scales are all in J.

    A parameter's scale is 1/e, where e is the root of the summed squares of the energies that a unit of it has at 46
    random states, drawn by `seed`. Where e is below 1e-3 of the largest (units counted in the characteristic length),
    that floor replaces it. Choices among parameters of different units are made on D / scales, whichever way the null
    space was found. Raises `InputError` for a reference configuration that breaks the mechanism's conditions (bounds on
    its positions), `LoopError` where loops cannot be closed.
    """
    E = energies(mechanism, random_states(mechanism, FEW_STATES, np.random.default_rng(seed)))
    return column_scales(
        np.linalg.norm(E, axis=0),
        mechanism.parameter_names[: mechanism.num_energy_parameters],
        characteristic_length(mechanism),
    )


@dataclass(frozen=True)
class NumericalRank:
    """The numerical rank k of a matrix with singular values sigma_1 >= sigma_2 >= ..., and the ratios by which it was
    found. `rank` is k, where the values have their largest gap, 0 where all are round-off; `gap` is sigma_k/sigma_k+1
    and `smallest` sigma_k/sigma_1, both without a unit (1e15 and 1 for a rank of 0). Made by `of`; nothing is checked
    at construction."""

    rank: int
    gap: float
    smallest: float

    @classmethod
    def from_singular_values(cls, singular_values: ArrayLike) -> NumericalRank:
        """The numerical rank k of a matrix from its `singular_values` sigma_1, ..., sigma_n, an array (n,), in
        descending order: the k, from 1 to n, at which sigma_k/sigma_k+1 is largest, as a `NumericalRank`.

        Values below 1e-15 sigma_1, and sigma_n+1, count as 1e-15 sigma_1. The rank is 0, with a gap of 1e15, where
        there are no values, or none above 1e-12: the matrix's columns are taken to have been scaled to norms of about
        1. Raises `ValueError` for values that are no numbers.
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
    """A regressor of P inertial parameters, of energies or torques at sampled states, with columns scaled to be
    comparable.

    `scales` (P,), SI units per J (N m for torques), are the factors of the columns, and `triangle` R (P, P) is the
    triangular factor of the scaled regressor, which has its singular values and right singular vectors. Made by
    `of_energies` and `of_torques`; nothing is checked at construction.
    """

    scales: Array
    triangle: Array

    @classmethod
    def of_energies(cls, mechanism: Mechanism, factor: EnergyFactor) -> ScaledRegressor:
        """The scaled regressor of a mechanism's energy differences at random states, given by their triangular `factor`
        R, of more states than the P inertial parameters: each column is divided by the norm of the energies themselves.
        Raises `ValueError` for a factor of another number of parameters."""
        return cls._scaled(mechanism, factor.triangle, factor.square_sums)

    @classmethod
    def of_torques(cls, mechanism: Mechanism, rows: Array) -> ScaledRegressor:
        """The scaled regressor of a mechanism's torques, made of `rows` (m, P) of its torque regressor, in N m per SI
        unit of each of P inertial parameters, m at least P; each column is divided by its own norm. Raises `ValueError`
        for another number of columns."""
        return cls._scaled(mechanism, triangle(rows), np.square(rows).sum(axis=0))

    @classmethod
    def _scaled(cls, mechanism: Mechanism, R: Array, square_sums: Array) -> ScaledRegressor:
        names, length = mechanism.parameter_names[: mechanism.num_energy_parameters], characteristic_length(mechanism)
        scales = column_scales(np.sqrt(square_sums), names, length)
        return cls(scales, R * scales)

    @cached_property
    def singular_values(self) -> Array:
        """The singular values (P,), in descending order, without a unit, of the regressor (energies or torques at
        sampled states) with its P columns, one for each inertial parameter, scaled to be comparable. Raises
        `numpy.linalg.LinAlgError` for NaN."""
        return np.asarray(np.linalg.svd(self.triangle, compute_uv=False), dtype=np.float64)

    @cached_property
    def vectors(self) -> Array:
        """The orthonormal right singular vectors (P, P), one in each column, in descending order of singular value, of
        the regressor (energies or torques at sampled states) with its P columns, one for each inertial parameter,
        scaled to be comparable. Raises `numpy.linalg.LinAlgError` for NaN."""
        return right_vectors(self.triangle)

    @cached_property
    def decision(self) -> NumericalRank:
        """The numerical rank k of the regressor (energies or torques at sampled states) with its P columns scaled to be
        comparable, as a `NumericalRank`: with k come the gap sigma_k/sigma_k+1 between its singular values there, and
        sigma_k/sigma_1, the smallest that counts over the largest. Raises `numpy.linalg.LinAlgError` for NaN."""
        return NumericalRank.from_singular_values(self.singular_values)

    @property
    def rank(self) -> int:
        """The rank k of the regressor (energies or torques at sampled states): the number of independent columns among
        its P, one for each inertial parameter, scaled to be comparable. It is at the largest ratio sigma_k/sigma_k+1 of
        successive singular values, those below 1e-15 of the largest counting as that; 0 where none is above 1e-12.
        Raises `numpy.linalg.LinAlgError` for NaN."""
        return self.decision.rank

    @property
    def null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k), without a unit, of the scaled regressor of rank k: directions of P
        inertial parameters, divided by this object's `scales` (P,), that change none of the regressor's energies or
        torques. Raises `numpy.linalg.LinAlgError` for NaN."""
        return self.vectors[:, self.rank :]

    def rank_of(self, columns: Sequence[int]) -> int:
        """The numerical rank of those of the scaled regressor's P columns, one for each inertial parameter, whose
        zero-based indices are `columns`. It is the k at which sigma_k/sigma_k+1 is largest among their singular values
        sigma, those below 1e-15 of the largest counting as that; 0 where none is above 1e-12. Raises `IndexError` for
        an index of P or more, `numpy.linalg.LinAlgError` for NaN.

        It is found from the whole regressor's singular values and right vectors alone: the left factor U of U S V'
        changes no rank.
        """
        shares = (self.vectors * self.singular_values)[list(columns)]
        return NumericalRank.from_singular_values(np.linalg.svd(shares, compute_uv=False)).rank


@dataclass(frozen=True, eq=False)
class DecomposedNullSpace:
    """A null space of energies by singular value decomposition of a `ScaledRegressor`, the `regressor`: the directions
    of P inertial parameters that change no energy. They are directions of the parameters divided by `scales` (P,),
    positive, in SI units per J, which need not be those of the regressor's columns. Nothing is checked at
    construction."""

    regressor: ScaledRegressor
    scales: Array

    @property
    def rank(self) -> int:
        """The rank k: the number of independent directions of P inertial parameters that change energies and
        torques."""
        return self.regressor.rank

    @cached_property
    def null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k), without a unit, k the rank: directions of P inertial parameters D, divided
        by this object's `scales` (P,), D / scales in J, that change no energy."""
        vectors = self.regressor.null_basis * (self.regressor.scales / self.scales)[:, None]
        return np.asarray(np.linalg.qr(vectors)[0], dtype=np.float64)

    def regrouping(self, order: Sequence[int], tolerance: float) -> Regrouping:
        """The regrouping that removes P-k of P scaled parameters in an `order`, k the rank, and adds them to the k kept
        ones; its `rank` is that of the regressor's kept columns.

        `order` (P,) has all zero-based indices, the first removed first. A parameter is removed where its row of the
        null vectors (P, P-k), less its projection on the rows of those removed before, is longer than `tolerance`,
        without a unit. Raises `InputError` for a tolerance that is not between 0 and 1/sqrt(P).
        """
        found = by_null_vectors(self.null_basis, order, tolerance)
        return replace(found, rank=self.regressor.rank_of(found.kept))
