"""Certified null spaces of a mechanism's energies: how they are found and checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import NamedTuple, get_args

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, RankError
from adaptctl.identifiability.certificate import (
    MAX_RESIDUAL_SINGULAR_VALUE,
    ROUND_OFF,
    Certificate,
    Method,
    Near,
    ResidualSingularValue,
    near_right_angles,
)
from adaptctl.identifiability.energy_matrix import (
    FEW_STATES,
    NOTHING,
    DecomposedNullSpace,
    EnergyFactor,
    ScaledRegressor,
    energy_blocks,
    energy_scales,
    torque_rows,
)
from adaptctl.identifiability.proof.exact_energies import ExactEnergies, proved
from adaptctl.identifiability.regrouping import NullSpace, null_residual, unscaled_bases
from adaptctl.identifiability.sampling import random_halves, random_states, whereabouts

LONG = 100
"""Number of a tree's parameters from which on its null space is found joint by joint."""


class CertifiedNullSpace(NamedTuple):
    """A certified null space: the directions of a mechanism's P inertial parameters (all but friction) that change no
    energy, with the evidence for their number.

    `null_space` is the `NullSpace`, `certificate` the `Certificate` of its rank, `proof` the energies on exact
    geometry, None where they were not computed. `energies()` returns the triangular factor R (n, P), n at most P, of
    the differences H = Q R, Q orthonormal, of kinetic plus potential energy between successive random states, in J per
    SI unit of each parameter; `states` says in words where these states come from. Nothing is checked at construction.
    """

    null_space: NullSpace
    certificate: Certificate
    energies: Callable[[], Array]
    """The triangle R of energy differences at random states."""
    states: str
    proof: ExactEnergies | None = None


def certified(
    mechanism: Mechanism, method: Method, near: Near, prove: bool | None, samples: int, seed: int
) -> CertifiedNullSpace:
    """The certified null space of a mechanism's energies, with its certificate: the directions of its P inertial
    parameters (all but friction) that change no energy, found by the `method` asked for.

    "svd" takes the singular value decomposition of energy differences at `samples` random states, drawn by `seed`;
    "transfers", for trees alone, takes the geometry, joint by joint; "automatic" takes transfers for trees of 100
    parameters or more, if their rank can be certified so, and else "svd". `near` is for angles within 1e-3 rad of a
    multiple of 90 degrees, or offsets within 1e-4 of the characteristic length of zero (in loops also of one another),
    that are not exact to 1e-11, and would make another rank if they were: "refuse" raises `RankError`, "as_is" takes
    them as they stand; with `prove` False it is not looked at. With `prove` the rank is also computed on exact
    geometry; None does so for trees, and for closed loops where there are such angles or lengths; False never.

    Raises `RankError` where the rank cannot be certified or is refused, `InputError` for a `method` or `near` that is
    unknown, and for transfers of a mechanism that is no tree, has constrained parameters, or drives that turn with
    several joints.
    """
    if method not in get_args(Method):
        raise InputError(f"method: expected one of {', '.join(get_args(Method))}, got {method!r}")
    proof = proved(mechanism, near, prove, seed)
    hindrance = _no_tree(mechanism)
    if method == "transfers":
        if hindrance:
            raise InputError(f"method: transfers are for trees, but {mechanism.name} has {hindrance}; use svd")
        return certified_by_transfers(mechanism, samples, seed, proof)
    if method == "automatic" and not hindrance and mechanism.num_energy_parameters >= LONG:
        with suppress(RankError):
            return certified_by_transfers(mechanism, samples, seed, proof)
    return certified_by_decomposition(mechanism, samples, seed, proof)


def _no_tree(mechanism: Mechanism) -> str:
    """The property that keeps a mechanism from being a tree with ten parameters a link; empty where none does."""
    if mechanism.is_plain_tree:
        return "drives that turn with several joints" if mechanism.description.drive_couplings else ""
    return "relations among its parameters" if mechanism.description.loops is None else "loops"


def certified_by_decomposition(
    mechanism: Mechanism, samples: int, seed: int, proof: ExactEnergies | None = None
) -> CertifiedNullSpace:
    """The certified null space of the energies of a `mechanism` of any kind, by singular value decomposition of the
    energy differences at `samples` random states, drawn by `seed`, at least twice as many as there are parameters.

    Its certificate compares the ranks of these energies, of those of twice as many states, of torques at random states,
    and, if a `proof` is given, of energies on exact geometry. Raises `RankError` unless all agree, with a ratio of at
    least 1e6 between the singular values that count and the rest; `InputError` for fewer than two samples.
    """
    generator = np.random.default_rng(seed)
    some, as_many = random_halves(mechanism, samples, generator)
    factor = EnergyFactor.of(energy_blocks(mechanism, some))
    doubled = EnergyFactor.of(energy_blocks(mechanism, as_many), before=factor)
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
    )
    _validate_accepted(mechanism, certificate, scaled.singular_values)
    found = DecomposedNullSpace(scaled, energy_scales(mechanism, seed))
    energies = partial(getattr, factor, "triangle")
    return CertifiedNullSpace(found, certificate, energies, _origin(mechanism, samples, seed), proof)


def _torque_rank(mechanism: Mechanism, rows: Array, energies: ScaledRegressor) -> int:
    """The rank of torque rows (n, P); 0 where energies are round-off and torques, scaled like them, are too."""
    if energies.rank == 0 and np.abs(rows * energies.scales).max(initial=0.0) <= NOTHING:
        return 0
    return ScaledRegressor.of_torques(mechanism, rows).rank


def certified_by_transfers(
    mechanism: Mechanism, samples: int, seed: int, proof: ExactEnergies | None = None
) -> CertifiedNullSpace:
    """The null space of a tree's energies (the directions of its inertial parameters that change no energy) with a
    certificate of its dimension, found joint by joint from the tree's geometry. It is checked at every joint against
    energies at 46 random states, drawn by `seed`.

    The mechanism must be a tree without constraints on its parameters, which is not checked here. `samples` (2 or more)
    is the number of random states of which the `energies` of the returned object are made when they are asked for.
    Raises `RankError` unless the rank by geometry equals, joint by joint, that of the sampled energies, with a ratio of
    at least 1e6 between the singular values that count and the rest, and that of energies on exact geometry, if a
    `proof` is given.
    """
    from adaptctl.identifiability.tree_null_space import TreeNullSpace, energy_changes, transfer_evidence

    found = TreeNullSpace.of(mechanism, seed)
    generator = np.random.default_rng(seed)
    few = FEW_STATES // 2
    changes = energy_changes(mechanism, found.transfers, random_states(mechanism, FEW_STATES, generator))
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
    )
    _validate_accepted(mechanism, certificate, once.weakest)

    def energies() -> Array:
        some, _ = random_halves(mechanism, samples, np.random.default_rng(seed))
        return EnergyFactor.of(energy_blocks(mechanism, some)).triangle

    return CertifiedNullSpace(found, certificate, energies, _origin(mechanism, samples, seed), proof)


def _origin(mechanism: Mechanism, samples: int, seed: int) -> str:
    return f"{samples} random states {whereabouts(mechanism)}, seed {seed}"


def _validate_accepted(mechanism: Mechanism, certificate: Certificate, spectrum: Array) -> None:
    # An angle that is taken as exact elsewhere may be what spoils a gap.
    suspects = near_right_angles(mechanism.description, exact=ROUND_OFF) if certificate.failures else ()
    certificate.validate_accepted(mechanism.name, spectrum, suspects)


def residual_singular_values(
    spectrum: Array, vectors: Array, rank: int, names: Sequence[str]
) -> tuple[ResidualSingularValue, ...]:
    """The singular values that a rank counts as zero though they are more than round-off, above 1e-14 of the largest: a
    `ResidualSingularValue` each, with the names of the parameters that dominate its right singular vector. These are
    its four largest entries in size, as far as they are above a tenth of the largest.

    `spectrum` (P,) has the singular values, in descending order, in any unit; `vectors` (P, P) a right singular vector
    in each column; the first `rank` are not looked at; `names` (P,) are the parameters'. Nothing is checked.
    """
    relative = spectrum / spectrum.max(initial=1e-300)
    beyond = [i for i in range(rank, len(spectrum)) if relative[i] > ROUND_OFF]
    return tuple(ResidualSingularValue(float(relative[i]), _dominant(vectors[:, i], names)) for i in beyond)


def _dominant(vector: Array, names: Sequence[str], most: int = 4) -> tuple[str, ...]:
    size = np.abs(vector)
    largest = [int(i) for i in np.argsort(-size, kind="stable")[:most]]
    return tuple(names[i] for i in largest if size[i] > 0.1 * size.max())
