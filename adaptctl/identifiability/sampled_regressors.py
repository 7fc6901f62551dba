"""Sampled energies and torques of a mechanism, as matrices on its inertial parameters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.sampling import (
    States,
    characteristic_length,
    random_accelerations,
    random_states,
)

BLOCK = 1024
"""states at once, or four times as many as there are parameters"""


def energetic_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the P parameters that enter the energy: all but friction, which energies can never find."""
    return mechanism.parameter_names[: mechanism.energetic]


def energies(mechanism: Mechanism, states: States) -> Array:
    """Kinetic plus potential energies (samples, P) per unit of each parameter, in J."""
    return mechanism.energy_regressor(states.p, states.v)[..., : mechanism.energetic]


def energy_blocks(mechanism: Mechanism, states: Iterable[States]) -> Iterator[Array]:
    """The same of many states, a part of them at a time."""
    for some in states:
        for part in some.parts(max(BLOCK, 4 * mechanism.energetic)):
            yield energies(mechanism, part)


def energy_differences(mechanism: Mechanism, states: States) -> Array:
    """H (samples - 1, P): energies at successive states, subtracted (Sheu and Walker 1991, equations 8 and 13).

    Subtracting matters: the energies themselves carry the constant potential, which changes no torque, and
    have one rank too many.
    """
    return np.diff(energies(mechanism, states), axis=0)


def torque_rows(mechanism: Mechanism, generator: np.random.Generator) -> Array:
    """Torque regressors (at least 2 P, P) at random states, one above the other, in N m: forces times L."""
    columns = range(mechanism.energetic)
    samples = max(2, -(-2 * len(columns) // mechanism.dof))
    states = random_states(mechanism, samples, generator)
    a = random_accelerations(mechanism, samples, generator)
    Y = mechanism.torque_regressor(states.p, states.v, a, columns)
    length = characteristic_length(mechanism)
    arms = [1.0 if joint.kind.turns else length for joint in mechanism.primary_joints]
    return (Y * np.array(arms)[:, None]).reshape(-1, Y.shape[-1])
