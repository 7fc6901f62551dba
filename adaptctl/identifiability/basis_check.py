"""A basis against the energies of a mechanism: what its regrouping says of them is tried at a few states."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability.energy_matrix import energy_differences
from adaptctl.identifiability.fundamental_basis import FundamentalBasis
from adaptctl.identifiability.sampling import States, random_states

SAMPLES, NEAR = 8, 0.02
"""States that are tried, and how far from its reference (rad or m) a mechanism with loops is moved to them."""
TOLERANCE, FLOOR = 1e-4, 1e-8
"""Of a column's energies: what may be missing. Of the greatest, in comparable units: what is round-off."""


def require_energies(mechanism: Mechanism, basis: FundamentalBasis) -> None:
    """Raise `InputError`, naming a parameter, unless a fundamental (base) `basis` reproduces the energies of a
    `mechanism`: H = H[:, columns] K must hold in each of the P columns, but for about 1e-4 of its entries' size.

    H (7, P), in J per SI unit of each parameter, are the differences of kinetic plus potential energy between 8
    successive random states, the same at every call, `columns` (k,) the indices of the basis's k kept parameters and K
    (k, P) its property `regrouping`. A saved basis is data from a file: with a wrong coefficient or a missing row, a
    controller would apply wrong torques. With loops, the states' positions are drawn uniformly within 0.02 rad (m if
    prismatic) of the reference configuration. That the basis has the mechanism's P parameters is not checked.
    """
    H = energy_differences(mechanism, _few_states(mechanism))
    kept, K, scales = H[:, basis.columns], basis.regrouping, basis.scales
    size = np.abs(H).max(axis=0)
    allowed = TOLERANCE * (size + np.abs(kept).max(axis=0) @ np.abs(K)) + FLOOR * (size * scales).max() / scales
    missing = np.abs(H - kept @ K).max(axis=0)
    worst = int(np.argmax(missing / np.maximum(allowed, np.finfo(float).tiny)))
    if missing[worst] > allowed[worst]:
        raise InputError(
            f"the basis of {basis.mechanism_name!r} is wrong or damaged: without {basis.parameter_names[worst]} it "
            f"changes energies of {mechanism.name!r}; find the basis anew"
        )


def _few_states(mechanism: Mechanism) -> States:
    generator = np.random.default_rng(0)
    if mechanism.description.loops is None:
        return random_states(mechanism, SAMPLES, generator)
    p: Array = mechanism.home + NEAR * generator.uniform(-1.0, 1.0, (SAMPLES, mechanism.dof))
    return States(p, generator.normal(size=p.shape), "about the reference")
