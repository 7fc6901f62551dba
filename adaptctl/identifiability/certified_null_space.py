"""The parameters that change no energy, in two ways, each with its certificate."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.certificate import ROUND_OFF, Certificate, leftovers
from adaptctl.identifiability.energy_factor import EnergyFactor
from adaptctl.identifiability.null_space import null_residual, unscaled_bases
from adaptctl.identifiability.right_angles import near_right_angles
from adaptctl.identifiability.sampled_regressors import energetic_names, energy_blocks, torque_rows
from adaptctl.identifiability.sampling import random_halves, random_states, whereabouts
from adaptctl.identifiability.scaled_regressor import ScaledRegressor
from adaptctl.identifiability.tree.null_space import TransferredNullSpace
from adaptctl.identifiability.tree.unobservable_inertia import FELT
from adaptctl.identifiability.tree.verification import energy_changes, transfer_evidence

NullSpace: TypeAlias = ScaledRegressor | TransferredNullSpace


class CertifiedNullSpace(NamedTuple):
    """A null space, why it can be trusted, and energies."""

    null_space: NullSpace
    certificate: Certificate
    energies: Callable[[], Array]
    """the triangle of energy differences at random states"""
    states: str
    """where these come from"""


def by_decomposition(mechanism: Mechanism, samples: int, seed: int) -> CertifiedNullSpace:
    """From the singular value decomposition of energy differences; of any mechanism."""
    generator = np.random.default_rng(seed)
    some, as_many = random_halves(mechanism, samples, generator)
    factor = EnergyFactor.of(energy_blocks(mechanism, some))
    doubled = EnergyFactor.of(energy_blocks(mechanism, as_many), before=factor)
    scaled = ScaledRegressor.of_energies(mechanism, factor)
    rows = torque_rows(mechanism, generator)
    certificate = Certificate(
        rank_energy=scaled.rank,
        rank_torque=ScaledRegressor.of_torques(mechanism, rows).rank,
        rank_doubled=ScaledRegressor.of_energies(mechanism, doubled).rank,
        gap=scaled.decision.gap,
        relative_smallest=scaled.decision.smallest,
        samples=samples,
        seed=seed,
        null_residual=null_residual(rows, unscaled_bases(scaled.null_basis, scaled.scales)[0], scaled.scales),
        leftovers=leftovers(scaled.singular_values, scaled.vectors, scaled.rank, energetic_names(mechanism)),
        near_right_angles=near_right_angles(mechanism.description),
    )
    _require_accepted(mechanism, certificate, scaled.singular_values)
    return CertifiedNullSpace(scaled, certificate, lambda: factor.triangle, _origin(mechanism, samples, seed))


def by_transfers(mechanism: Mechanism, samples: int, seed: int) -> CertifiedNullSpace:
    """From the geometry of a tree, joint by joint, with energies as evidence for each joint."""
    found = TransferredNullSpace.of(mechanism)
    generator = np.random.default_rng(seed)
    few = 2 * FELT + 1
    changes = energy_changes(mechanism, found.transfers, random_states(mechanism, 2 * few, generator))
    once, twice = (transfer_evidence(found.transfers, changes[:, :count]) for count in (few, 2 * few))
    certificate = Certificate(
        rank_energy=found.rank + once.surplus,
        rank_geometry=found.rank,
        rank_doubled=found.rank + twice.surplus,
        gap=once.gap,
        relative_smallest=once.smallest,
        samples=few,
        seed=seed,
        null_residual=twice.residual,
        near_right_angles=near_right_angles(mechanism.description),
    )
    _require_accepted(mechanism, certificate, once.weakest)

    def energies() -> Array:
        some, _ = random_halves(mechanism, samples, np.random.default_rng(seed))
        return EnergyFactor.of(energy_blocks(mechanism, some)).triangle

    return CertifiedNullSpace(found, certificate, energies, _origin(mechanism, samples, seed))


def _origin(mechanism: Mechanism, samples: int, seed: int) -> str:
    return f"{samples} random states {whereabouts(mechanism)}, seed {seed}"


def _require_accepted(mechanism: Mechanism, certificate: Certificate, spectrum: Array) -> None:
    # An angle that is taken as exact elsewhere may be what spoils a gap.
    suspects = near_right_angles(mechanism.description, exact=ROUND_OFF) if certificate.faults else ()
    certificate.require_accepted(mechanism.name, spectrum, suspects)
