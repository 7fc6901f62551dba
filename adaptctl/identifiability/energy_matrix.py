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


def energetic_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the P parameters that enter the energy: all but friction, which energies can never find."""
    return mechanism.parameter_names[: mechanism.energetic]


def energies(mechanism: Mechanism, states: States) -> Array:
    """Kinetic plus potential energies (samples, P) per unit of each parameter, in J."""
    return mechanism.energy_regressor(states.p, states.v)[..., : mechanism.energetic]


def energy_blocks(mechanism: Mechanism, states: Iterable[States]) -> Iterator[Array]:
    """Energies (some, P) of many states, a block of them at a time, in J per unit of each parameter."""
    for some in states:
        for part in some.parts(max(BLOCK, 4 * mechanism.energetic)):
            yield energies(mechanism, part)


def energy_differences(mechanism: Mechanism, states: States) -> Array:
    """The matrix H (samples - 1, P) of energies at successive states, subtracted (Sheu and Walker 1991, equations 8 and
    13), in J per unit of each parameter.

    Subtracting matters: the energies themselves carry the constant potential, which changes no torque, and
    have one rank too many.
    """
    return np.diff(energies(mechanism, states), axis=0)


@dataclass(frozen=True, eq=False)
class EnergyFactor:
    """Triangular factor R of the energy differences H = Q R, which has H's singular values and right vectors.

    Blocks of rows are put under R and factored again (TSQR: Demmel, Grigori, Hoemmen and Langou 2012), so memory does
    not grow with the samples. Householder's R is right column by column: columns may as well be scaled afterwards.
    """

    triangle: Array
    """R (at most P, P)"""
    square_sums: Array
    """Sums of squares (P,) of the energies themselves, before differencing."""
    last: Array
    """Energies (1, P) of the last state, from which the next one's are subtracted."""

    @classmethod
    def of(cls, blocks: Iterable[Array], before: EnergyFactor | None = None) -> EnergyFactor:
        """The factor of energies (samples, P) of successive states in blocks, after those that `before` holds. Raises
        ValueError without a state."""
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
        """This factor with the energies (samples, P) of more states appended."""
        rows = np.diff(energies, axis=0, prepend=self.last)
        squares = self.square_sums + np.square(energies).sum(axis=0)
        return EnergyFactor(triangle(np.vstack([self.triangle, rows])), squares, energies[-1:])


def torque_rows(mechanism: Mechanism, generator: np.random.Generator) -> Array:
    """Torque regressors (at least 2 P, P) at random states, one above the other, in N m: forces times L."""
    columns = range(mechanism.energetic)
    samples = max(2, -(-2 * len(columns) // mechanism.dof))
    states = random_states(mechanism, samples, generator)
    a = random_accelerations(mechanism, samples, generator)
    Y = mechanism.torque_regressor(states.p, states.v, a, columns)
    length = characteristic_length(mechanism)
    arms = [1.0 if joint.kind.turns else length for joint in mechanism.primary_joints]
    return (Y * np.array(arms)[:, None]).reshape(samples * mechanism.dof, len(columns))
