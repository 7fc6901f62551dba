"""Energy differences and torques at sampled states, as matrices on a mechanism's inertial parameters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.factorisation import triangle
from adaptctl.identifiability.sampling import States, characteristic_length, random_accelerations, random_states

BLOCK = 1024
"""States at once, or four times as many as there are parameters."""


def energies(mechanism: Mechanism, states: States) -> Array:
    """The energy regressor (samples, P) at sampled states: kinetic plus potential energy, in J per SI unit of each of a
    mechanism's P inertial parameters (all but friction). `states` are `samples` positions and velocities of the primary
    (independent) joints. Raises `InputError` for states of another number of joints, `SingularityError` near a
    singularity of closed loops."""
    return mechanism.energy_regressor(states.p, states.v)[..., : mechanism.energetic]


def energy_blocks(mechanism: Mechanism, states: Iterable[States]) -> Iterator[Array]:
    """Iterator over the energy regressors at many states, in blocks (m, P) of m states, at most max(1024, 4 P)
    successive ones or one more: kinetic plus potential energy, in J per SI unit of each of a mechanism's P inertial
    parameters (all but friction). `states` is an iterable of `States`. Raises, in the course of the iteration,
    `InputError` for states of another number of joints and `SingularityError` near a singularity of closed loops."""
    for some in states:
        for part in some.parts(max(BLOCK, 4 * mechanism.energetic)):
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
    """R (at most P, P)"""
    square_sums: Array
    """Sums of squares (P,) of the energies themselves, before differencing."""
    last: Array
    """Energies (1, P) of the last state, from which the next one's are subtracted."""

    @classmethod
    def of(cls, blocks: Iterable[Array], before: EnergyFactor | None = None) -> EnergyFactor:
        """The triangular factor R (n, P), n at most P, of the differences H = Q R, Q orthonormal, of energies between
        successive states, as an `EnergyFactor`. Energies (m, P) at m states, in J per SI unit of each of P parameters,
        come in `blocks`; the states follow those of the factor `before`, if one is given (None by default). Raises
        `ValueError` when there is no block and no factor before, and for blocks of different widths."""
        factor = before
        for block in blocks:
            factor = cls._begun(block) if factor is None else factor.followed_by(block)
        if factor is None:
            raise ValueError("no states")
        return factor

    @classmethod
    def _begun(cls, energies: Array) -> EnergyFactor:
        return cls(triangle(np.diff(energies, axis=0)), np.square(energies).sum(axis=0), energies[-1:])

    def followed_by(self, energies: Array) -> EnergyFactor:
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
    columns = range(mechanism.energetic)
    samples = max(2, -(-2 * len(columns) // mechanism.dof))
    states = random_states(mechanism, samples, generator)
    a = random_accelerations(mechanism, samples, generator)
    Y = mechanism.torque_regressor(states.p, states.v, a, columns)
    length = characteristic_length(mechanism)
    arms = [1.0 if joint.kind.turns else length for joint in mechanism.primary_joints]
    return (Y * np.array(arms)[:, None]).reshape(samples * mechanism.dof, len(columns))
