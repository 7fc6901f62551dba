"""Certified null spaces of a mechanism's energies."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple, get_args

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.right_angles import near_right_angles
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, RankError
from adaptctl.identifiability.certificate import (
    MAX_RESIDUAL_SINGULAR_VALUE,
    ROUND_OFF_RATIO,
    Certificate,
    Method,
    ResidualSingularValue,
)
from adaptctl.identifiability.energy_matrix import (
    SCALING_STATES,
    ZERO_MATRIX_TOLERANCE,
    DecomposedNullSpace,
    EnergyFactor,
    ScaledRegressor,
    energies_of_sets,
    scales_of,
    scaling_states,
    torque_rows,
)
from adaptctl.identifiability.proof.exact_energies import ExactEnergies, proved
from adaptctl.identifiability.proof.exact_geometry import taken_as_exact
from adaptctl.identifiability.proof.joint_frames import AS_GIVEN
from adaptctl.identifiability.regrouping import NullSpace, null_residual, unscaled_bases
from adaptctl.identifiability.sampling import random_halves, random_states, whereabouts

# Number of a tree's parameters from which on its null space is found joint by joint.
MIN_PARAMETERS_FOR_TRANSFERS = 100
# Range in rad below which a joint in loops is named where a rank is refused, and most joints that are.
NARROW, MAX_NAMED_JOINTS = 1.0, 3


class CertifiedNullSpace(NamedTuple):
    """Null space of a mechanism's energies, with its certificate and proof."""

    null_space: NullSpace
    certificate: Certificate
    states: str
    proof: ExactEnergies | None = None


def certified(
    mechanism: Mechanism, method: Method, as_written: bool, prove: bool | None, samples: int, seed: int
) -> CertifiedNullSpace:
    """Certified null space by the method asked for."""
    if method not in get_args(Method):
        raise InputError(f"method: expected one of {', '.join(get_args(Method))}, got {method!r}")
    proof = proved(mechanism, as_written, prove, seed)
    hindrance = _no_tree(mechanism)
    if method == "transfers":
        if hindrance:
            raise InputError(f"method: transfers are for trees, but {mechanism.name} has {hindrance}; use method='svd'")
        return certified_by_transfers(mechanism, samples, seed, proof)
    if method == "automatic" and not hindrance and mechanism.num_energy_parameters >= MIN_PARAMETERS_FOR_TRANSFERS:
        with suppress(RankError):
            return certified_by_transfers(mechanism, samples, seed, proof)
    return certified_by_decomposition(mechanism, samples, seed, proof)


def _no_tree(mechanism: Mechanism) -> str:
    if mechanism.is_plain_tree:
        return "drives coupled to several joints" if mechanism.description.drive_couplings else ""
    return "constraints on its parameters" if mechanism.description.loops is None else "loops"


def certified_by_decomposition(
    mechanism: Mechanism, samples: int, seed: int, proof: ExactEnergies | None = None
) -> CertifiedNullSpace:
    """Certified null space by singular value decomposition of sampled energy differences."""
    generator = np.random.default_rng(seed)
    halves = random_halves(mechanism, samples, generator)
    some, as_many, (sizes,) = energies_of_sets(mechanism, *halves, [scaling_states(mechanism, seed)])
    factor = EnergyFactor.of(some)
    doubled = EnergyFactor.of(as_many, before=factor)
    scaled = ScaledRegressor.of_energies(mechanism, factor)
    rows = torque_rows(mechanism, generator)
    certificate = Certificate(
        rank_energy=scaled.rank,
        rank_torque=_torque_rank(mechanism, rows, scaled),
        rank_doubled=ScaledRegressor.of_energies(mechanism, doubled).rank,
        gap=scaled.decision.gap,
        relative_smallest=scaled.decision.smallest,
        samples=samples,
        seed=seed,
        null_residual=null_residual(rows, unscaled_bases(scaled.null_basis, scaled.scales)[0], scaled.scales),
        residual_singular_values=residual_singular_values(
            scaled.singular_values,
            scaled.vectors,
            scaled.rank,
            mechanism.parameter_names[: mechanism.num_energy_parameters],
        ),
        near_right_angles=near_right_angles(mechanism.description),
        rank_exact=None if proof is None else proof.rank,
        proof_method="" if proof is None else proof.method,
        taken_as_exact=_taken_as_exact(mechanism, proof),
    )
    _validate_accepted(mechanism, certificate, scaled.singular_values)
    found = DecomposedNullSpace(scaled, scales_of(mechanism, sizes))
    return CertifiedNullSpace(found, certificate, _origin(mechanism, samples, seed), proof)


def _torque_rank(mechanism: Mechanism, rows: Array, energies: ScaledRegressor) -> int:
    if energies.rank == 0 and np.abs(rows * energies.scales).max(initial=0.0) <= ZERO_MATRIX_TOLERANCE:
        return 0
    return ScaledRegressor.of_torques(mechanism, rows).rank


def certified_by_transfers(
    mechanism: Mechanism, samples: int, seed: int, proof: ExactEnergies | None = None
) -> CertifiedNullSpace:
    """Certified null space of a tree, from geometry, checked by sampled energies."""
    from adaptctl.identifiability.tree_null_space import TreeNullSpace, energy_changes, transfer_evidence

    found = TreeNullSpace.of(mechanism, seed)
    generator = np.random.default_rng(seed)
    few = SCALING_STATES // 2
    changes = energy_changes(mechanism, found.transfers, random_states(mechanism, SCALING_STATES, generator))
    once, twice = (transfer_evidence(found.transfers, changes[:, :count]) for count in (few, 2 * few))
    far = (ResidualSingularValue(twice.leftover, (f"bodies on {mechanism.links[twice.worst].name}",)),)
    certificate = Certificate(
        rank_energy=found.rank + once.surplus,
        rank_geometry=found.rank,
        rank_doubled=found.rank + twice.surplus,
        gap=once.gap,
        relative_smallest=once.smallest,
        samples=few,
        seed=seed,
        null_residual=twice.residual,
        residual_singular_values=far if twice.leftover > MAX_RESIDUAL_SINGULAR_VALUE else (),
        near_right_angles=near_right_angles(mechanism.description),
        rank_exact=None if proof is None else proof.rank,
        proof_method="" if proof is None else proof.method,
        taken_as_exact=_taken_as_exact(mechanism, proof),
    )
    _validate_accepted(mechanism, certificate, once.singular_values)

    return CertifiedNullSpace(found, certificate, _origin(mechanism, samples, seed), proof)


def _taken_as_exact(mechanism: Mechanism, proof: ExactEnergies | None) -> tuple[str, ...]:
    given = proof if proof is not None and proof.precision is AS_GIVEN else ExactEnergies(mechanism)
    return taken_as_exact(mechanism.description, given.frames)


def _origin(mechanism: Mechanism, samples: int, seed: int) -> str:
    return f"{samples} random states {whereabouts(mechanism)}, seed {seed}"


def _validate_accepted(mechanism: Mechanism, certificate: Certificate, spectrum: Array) -> None:
    # An angle that is taken as exact elsewhere may be what spoils a gap.
    near = near_right_angles(mechanism.description, exact=ROUND_OFF_RATIO) if certificate.failures else ()
    narrow = _narrow_joints(mechanism, certificate.seed) if certificate.failures else ()
    certificate.validate_accepted(mechanism.name, spectrum, (*near, *narrow))


def _narrow_joints(mechanism: Mechanism, seed: int) -> tuple[str, ...]:
    """Sentence on joints that loops let turn so little that parameters nearly depend on each other, if any."""
    if mechanism.continuation is None:
        return ()
    q = mechanism.configuration(random_states(mechanism, SCALING_STATES, np.random.default_rng(seed)).p)
    reach = {link.joint.name: float(r) for link, r in zip(mechanism.links, np.ptp(q, axis=0), strict=True)}
    turns = [link.joint.name for link in mechanism.links if link.joint.kind.is_revolute]
    least = sorted((name for name in turns if reach[name] < NARROW), key=reach.__getitem__)[:MAX_NAMED_JOINTS]
    if not least:
        return ()
    each = ", ".join(f"{name} by {reach[name]:.2g} rad" for name in least)
    return (
        f"the loops turn {each} at most, in which parameters nearly depend on each other: give a reference from which "
        "they turn further",
    )


def residual_singular_values(
    spectrum: Array, vectors: Array, rank: int, names: Sequence[str]
) -> tuple[ResidualSingularValue, ...]:
    """Singular values beyond the rank above round-off, with their dominant parameters."""
    relative = spectrum / spectrum.max(initial=1e-300)
    beyond = [i for i in range(rank, len(spectrum)) if relative[i] > ROUND_OFF_RATIO]
    return tuple(ResidualSingularValue(float(relative[i]), _dominant(vectors[:, i], names)) for i in beyond)


def _dominant(vector: Array, names: Sequence[str], most: int = 4) -> tuple[str, ...]:
    size = np.abs(vector)
    largest = [int(i) for i in np.argsort(-size, kind="stable")[:most]]
    return tuple(names[i] for i in largest if size[i] > 0.1 * size.max())
