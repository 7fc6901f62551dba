"""Certified null spaces of a mechanism's energies: how they are found, and why their rank can be trusted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import RankError
from adaptctl.identifiability.energy_matrix import EnergyFactor, energetic_names, energy_blocks, torque_rows
from adaptctl.identifiability.null_space import NullSpace, null_residual, unscaled_bases
from adaptctl.identifiability.proof.exact_energies import ExactEnergies
from adaptctl.identifiability.right_angles import NearRightAngle, near_right_angles
from adaptctl.identifiability.sampling import random_halves, random_states, whereabouts
from adaptctl.identifiability.scaled_rank import (
    FEW_STATES,
    NOTHING,
    DecomposedNullSpace,
    ScaledRegressor,
    energy_scales,
)
from adaptctl.identifiability.tree.null_space import TreeNullSpace
from adaptctl.identifiability.tree.verification import TransferEvidence, energy_changes, transfer_evidence

SMALLEST_GAP = 1e6
SMALLEST_SINGULAR_VALUE = 1e-9
"""Least sigma_k/sigma_1 of the scaled energy differences."""
ROUND_OFF = 1e-14
"""Values beyond the gap above this, relative to sigma_1, are named: they are more than round-off."""
LARGEST_LEFTOVER = 1e-8
"""Values beyond the gap above this, relative to sigma_1, are far more than round-off, and refuse the rank: 1e-11 of an
angle, times a thousand where a small column is scaled up."""
LISTED = 80
"""Most singular values in a message."""


@dataclass(frozen=True)
class Leftover:
    """A singular value beyond the gap that is more than round-off, and the parameters it is made of."""

    value: float
    """The singular value, relative to sigma_1."""
    parameters: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.value:.1e} ({', '.join(self.parameters)})"


@dataclass(frozen=True)
class Certificate:
    """Certificate of a rank k: the ranks found in independent ways, three from scaled matrices and one in exact
    arithmetic, and numbers that say how clear-cut they are.

    `gap` is sigma_k/sigma_k+1 of the energy differences, `relative_smallest` sigma_k/sigma_1, both floored at
    1e-15 of sigma_1. `null_residual` is the largest torque that any null vector makes on other samples,
    relative to the largest that a vector of its size can make.
    By transfers, `rank_geometry`, which follows from a tree's geometry, takes the place of `rank_torque`. Gap and
    smallest value are then those of the worst joint's energy changes, as bodies are moved from its link to the parent
    link, and `null_residual` is the largest relative change by a body that is unobservable at its joint.
    `rank_exact` is that of exact geometry, computed in what `exact_by` says; None where it was not asked for.
    """

    rank_energy: int
    rank_doubled: int
    gap: float
    relative_smallest: float
    samples: int
    seed: int
    null_residual: float
    leftovers: tuple[Leftover, ...] = ()
    near_right_angles: tuple[NearRightAngle, ...] = ()
    rank_torque: int | None = None
    rank_geometry: int | None = None
    rank_exact: int | None = None
    exact_by: str = ""

    @property
    def rank(self) -> int:
        """The certified rank k, the number of identifiable parameters."""
        return self.rank_energy

    @property
    def faults(self) -> tuple[str, ...]:
        """Reasons for which the rank cannot be accepted; empty when it can."""
        other, what = self._other
        ranks = (self.rank_energy, other, self.rank_doubled)
        largest = max((leftover.value for leftover in self.leftovers), default=0.0)
        wrong = {
            f"the gap at {self.rank} is {self.gap:.1e}, at least {SMALLEST_GAP:.0e} is needed": (
                self.gap < SMALLEST_GAP
            ),
            f"sigma_k/sigma_1 is {self.relative_smallest:.1e}, at least {SMALLEST_SINGULAR_VALUE:.0e} is needed": (
                self.relative_smallest < SMALLEST_SINGULAR_VALUE
            ),
            f"energies say {ranks[0]}, {what} {ranks[1]}, energies of twice as many samples {ranks[2]}": (
                len(set(ranks)) > 1
            ),
            f"beyond the gap there is {largest:.1e} of sigma_1, far more than round-off": largest > LARGEST_LEFTOVER,
            f"energies say {self.rank_energy}, exact geometry over {self.exact_by} says {self.rank_exact}": (
                self.rank_exact not in (None, self.rank_energy)
            ),
        }
        return tuple(text for text, holds in wrong.items() if holds)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on what is no fault but worth a look: values beyond the gap, and axes near right angles."""
        leftovers = [f"beyond the gap, {leftover} is more than round-off" for leftover in self.leftovers]
        return (*leftovers, *map(str, self.near_right_angles))

    def __str__(self) -> str:
        return (
            f"rank {self.rank} by the energies of {self.samples} and of {2 * self.samples} states and by "
            f"{self._other[1]}; "
            f"gap {self.gap:.1e}, sigma_k/sigma_1 {self.relative_smallest:.1e}"
            + (f"; the same exactly, over {self.exact_by}" if self.rank_exact is not None else "")
        )

    @property
    def _other(self) -> tuple[int | None, str]:
        """The rank that is not found from energies, and where from."""
        if self.rank_geometry is not None:
            return self.rank_geometry, "geometry"
        return self.rank_torque, "torques"

    def require_accepted(self, mechanism: str, spectrum: Array, suspects: Sequence[object] = ()) -> None:
        """Raise `RankError`, with the spectrum (n,) and the suspects, unless the rank can be accepted."""
        if not self.faults:
            return
        hints = "".join(f"; {suspect}" for suspect in suspects)
        raise RankError(
            f"{mechanism}: the rank cannot be certified: {'; '.join(self.faults)}{hints}. "
            f"Scaled singular values over the largest: {_listing(spectrum / spectrum.max(initial=1e-300), self.rank)}",
            tuple(spectrum.tolist()),
        )


class CertifiedNullSpace(NamedTuple):
    """A null space, its certificate, and the energies that it was found or checked with."""

    null_space: NullSpace
    certificate: Certificate
    energies: Callable[[], Array]
    """The triangle R of energy differences at random states."""
    states: str
    """Source of these states, in words."""


def certified_by_decomposition(
    mechanism: Mechanism, samples: int, seed: int, proof: ExactEnergies | None = None
) -> CertifiedNullSpace:
    """The null space by singular value decomposition of energy differences at random states; of any mechanism.

    Raises `RankError` unless the energies of `samples` states, of twice as many, and torques agree on a clear rank.
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
        leftovers=leftovers(scaled.singular_values, scaled.vectors, scaled.rank, energetic_names(mechanism)),
        near_right_angles=near_right_angles(mechanism.description),
        rank_exact=None if proof is None else proof.rank,
        exact_by="" if proof is None else proof.method,
    )
    _require_accepted(mechanism, certificate, scaled.singular_values)
    found = DecomposedNullSpace(scaled, energy_scales(mechanism, seed))
    energies = partial(getattr, factor, "triangle")
    return CertifiedNullSpace(found, certificate, energies, _origin(mechanism, samples, seed))


def _torque_rank(mechanism: Mechanism, rows: Array, energies: ScaledRegressor) -> int:
    """The rank of torque rows (n, P); 0 where energies are round-off and torques, scaled like them, are too."""
    if energies.rank == 0 and np.abs(rows * energies.scales).max(initial=0.0) <= NOTHING:
        return 0
    return ScaledRegressor.of_torques(mechanism, rows).rank


def certified_by_transfers(
    mechanism: Mechanism, samples: int, seed: int, proof: ExactEnergies | None = None
) -> CertifiedNullSpace:
    """The null space of a tree from its geometry, joint by joint, checked at every joint against sampled energies.

    Raises `RankError` unless energies agree, joint by joint, with the rank by geometry. `samples` is the number of
    states whose energy differences are computed when they are asked for.
    """
    found = TreeNullSpace.of(mechanism, seed)
    generator = np.random.default_rng(seed)
    few = FEW_STATES // 2
    changes = energy_changes(mechanism, found.transfers, random_states(mechanism, FEW_STATES, generator))
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
        leftovers=_far_from_round_off(mechanism, twice),
        near_right_angles=near_right_angles(mechanism.description),
        rank_exact=None if proof is None else proof.rank,
        exact_by="" if proof is None else proof.method,
    )
    _require_accepted(mechanism, certificate, once.weakest)

    def energies() -> Array:
        some, _ = random_halves(mechanism, samples, np.random.default_rng(seed))
        return EnergyFactor.of(energy_blocks(mechanism, some)).triangle

    return CertifiedNullSpace(found, certificate, energies, _origin(mechanism, samples, seed))


def _far_from_round_off(mechanism: Mechanism, evidence: TransferEvidence) -> tuple[Leftover, ...]:
    """The largest relative energy change by an unobservable body and the link it is on, where that refuses the rank."""
    if evidence.leftover <= LARGEST_LEFTOVER:
        return ()
    return (Leftover(evidence.leftover, (f"bodies on {mechanism.links[evidence.worst].name}",)),)


def _origin(mechanism: Mechanism, samples: int, seed: int) -> str:
    return f"{samples} random states {whereabouts(mechanism)}, seed {seed}"


def _require_accepted(mechanism: Mechanism, certificate: Certificate, spectrum: Array) -> None:
    # An angle that is taken as exact elsewhere may be what spoils a gap.
    suspects = near_right_angles(mechanism.description, exact=ROUND_OFF) if certificate.faults else ()
    certificate.require_accepted(mechanism.name, spectrum, suspects)


def leftovers(spectrum: Array, vectors: Array, rank: int, names: Sequence[str]) -> tuple[Leftover, ...]:
    """The singular values beyond the gap that are more than round-off, with the parameters that dominate their vectors.

    The spectrum (P,) falls; `vectors` (P, P) holds a right singular vector a column.
    """
    relative = spectrum / spectrum.max(initial=1e-300)
    beyond = [i for i in range(rank, len(spectrum)) if relative[i] > ROUND_OFF]
    return tuple(Leftover(float(relative[i]), _dominant(vectors[:, i], names)) for i in beyond)


def _dominant(vector: Array, names: Sequence[str], most: int = 4) -> tuple[str, ...]:
    size = np.abs(vector)
    largest = [int(i) for i in np.argsort(-size, kind="stable")[:most]]
    return tuple(names[i] for i in largest if size[i] > 0.1 * size.max())


def _listing(relative: Array, rank: int) -> str:
    """Text of all values, or of those about the gap where there are very many."""
    if len(relative) <= LISTED:
        return " ".join(f"{x:.1e}" for x in relative)
    first = max(0, rank - LISTED // 2)
    shown = relative[first : first + LISTED]
    return f"(from the {first + 1}th) " + " ".join(f"{x:.1e}" for x in shown)
