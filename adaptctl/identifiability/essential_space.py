"""The essential parameter space: the combinations of inertial parameters that a mechanism's motion depends on."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen_array
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, RankError
from adaptctl.identifiability.certificate import (
    Certificate,
    CertifiedNullSpace,
    certified_by_decomposition,
    certified_by_transfers,
)
from adaptctl.identifiability.energy_matrix import EnergyFactor, energetic_names, energy_blocks
from adaptctl.identifiability.factorisation import right_vectors, singular_values
from adaptctl.identifiability.null_space import NullSpace, unscaled_bases
from adaptctl.identifiability.proof.exact_energies import ExactEnergies
from adaptctl.identifiability.proof.proved import Near, proved
from adaptctl.identifiability.sampling import States
from adaptctl.markup import table, titled

Method = Literal["automatic", "svd", "transfers"]
METHODS: tuple[str, ...] = get_args(Method)
LONG = 100
"""Number of a tree's parameters from which on its null space is found joint by joint."""


CERTIFIED = ("rank_energy", "rank_doubled", "gap", "relative_smallest", "samples", "null_residual")
"""Entries of a certificate in a notebook's view."""


@dataclass(frozen=True, eq=False)
class EssentialSpace:
    """The essential space of inertial parameters (P,), which change energies and torques, and its complement, the null
    space, which changes none.

    `singular_values` (P,) and `basis` V1 (P, k) belong to the energy differences H of `states`, unscaled, as
    the paper has them (Sheu and Walker 1991, section 3). `null_basis` V2 (P, P-k) is orthonormal and does not
    depend on the states. `scales` (P,) make parameters comparable: choices between parameters of different units
    are made on D / scales, whose null vectors are `scaled_null_basis` (P, P-k). Arrays are computed when first asked
    for, and are read-only.
    """

    mechanism: Mechanism
    null_space: NullSpace
    certificate: Certificate
    states: str
    """Source of the states behind `singular_values` and `basis`, in words."""
    energies: Callable[[], Array]
    """The triangle R of these states' energy differences H = Q R."""
    proof: ExactEnergies | None = None
    """Energies on exact geometry, where they were computed."""

    @property
    def mechanism_name(self) -> str:
        """The mechanism's name."""
        return self.mechanism.name

    @property
    def sha256(self) -> str:
        """Hash of the mechanism's description, inertial values included."""
        return self.mechanism.description.sha256

    @property
    def geometry_sha256(self) -> str:
        """Hash of geometry, gravity and names, which is all that the space depends on."""
        return self.mechanism.geometry_sha256

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the P parameters that enter energies."""
        return energetic_names(self.mechanism)

    @property
    def rank(self) -> int:
        """The number of independent parameters k."""
        return self.null_space.rank

    @cached_property
    def scales(self) -> Array:
        """Scales (P,) that make parameters of different units comparable."""
        return frozen_array(self.null_space.scales, (len(self.parameter_names),), "scales")

    @cached_property
    def scaled_null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k) among the scaled parameters D / scales."""
        return self._null_vectors(self.null_space.null_basis, "scaled null basis")

    @cached_property
    def null_basis(self) -> Array:
        """Orthonormal null vectors V2 (P, P-k) among the parameters D in SI units."""
        return self._null_vectors(self._bases[0], "null basis")

    @cached_property
    def singular_values(self) -> Array:
        """Singular values (P,) of the energy differences H, falling."""
        return frozen_array(singular_values(self._triangle), (len(self.parameter_names),), "singular values")

    @cached_property
    def basis(self) -> Array:
        """The orthonormal right singular vectors V1 (P, k) of H that belong to its k singular values."""
        complement = self._bases[1]
        V1 = complement @ right_vectors(self._triangle @ complement)
        return frozen_array(V1, (len(self.parameter_names), self.rank), "basis")

    def _repr_html_(self) -> str:
        """Notebook's view of the space: its rank, and its certificate."""
        rows = [(name.replace("_", " "), f"{getattr(self.certificate, name):.4g}") for name in CERTIFIED]
        text = f"rank {self.rank} of {len(self.parameter_names)} parameters of {self.mechanism_name}"
        return titled("EssentialSpace", text) + table(("certificate", ""), rows)

    def project(self, parameters: ArrayLike) -> Array:
        """Essential parameters D_E = V1 V1' D (..., P) of inertial parameters D (..., P). Raises `InputError` on a
        wrong shape."""
        return (checked(parameters, len(self.parameter_names), "parameters") @ self.basis) @ self.basis.T

    @cached_property
    def _triangle(self) -> Array:
        return self.energies()

    @cached_property
    def _bases(self) -> tuple[Array, Array]:
        return unscaled_bases(self.null_space.null_basis, self.null_space.scales)

    def _null_vectors(self, vectors: Array, what: str) -> Array:
        P = len(self.parameter_names)
        return frozen_array(vectors, (P, P - self.rank), what)


def essential_space(
    mechanism: Mechanism,
    *,
    samples: int | None = None,
    seed: int = 0,
    states: States | None = None,
    method: Method = "automatic",
    near: Near = "refuse",
    prove: bool | None = None,
) -> EssentialSpace:
    """The essential parameter space of a mechanism.

    By the method "svd" it comes from energies at random states; `samples` is their number, at least (and by default
    about) twice as many as parameters. By "transfers", for trees alone, its null space follows from the geometry, joint
    by joint, in time that grows with the number of links, and it is checked against sampled energies. "automatic"
    takes transfers for trees of a hundred parameters or more if their rank can be certified so, and else "svd".
    With `states`, the singular values and V1 are those of the given states' energies, so that model reduction holds
    for them; the rank and V2, which are the mechanism's own, do not depend on them.
    With `prove` the rank is also computed on exact geometry; by default where that takes milliseconds, that is, unless
    loops are closed. Where angles or lengths are nearly, but not exactly, special, and the rank is another one if they
    are meant to be, it is refused, unless `near` is "as_is": it is then that of the geometry as it stands.
    Raises `RankError`, with the spectrum, when the rank cannot be certified, and `InputError` for a method that is
    unknown or not for this mechanism, and for too few samples.
    """
    count = _sample_count(samples, mechanism.energetic)
    given = None if states is None else EnergyFactor.of(energy_blocks(mechanism, [states])).triangle
    proof = proved(mechanism, near, prove, seed)
    found = _certified(mechanism, method, count, seed, proof)
    if given is None or states is None:
        return EssentialSpace(mechanism, found.null_space, found.certificate, found.states, found.energies, proof)
    return EssentialSpace(mechanism, found.null_space, found.certificate, states.origin, partial(_same, given), proof)


def _certified(
    mechanism: Mechanism, method: str, samples: int, seed: int, proof: ExactEnergies | None
) -> CertifiedNullSpace:
    """The null space by the method asked for; by "automatic", what transfers cannot certify is left to svd."""
    if method not in METHODS:
        raise InputError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    hindrance = _no_tree(mechanism)
    if method == "transfers":
        if hindrance:
            raise InputError(f"method: transfers are for trees, but {mechanism.name} has {hindrance}; use svd")
        return certified_by_transfers(mechanism, samples, seed, proof)
    if method == "automatic" and not hindrance and mechanism.energetic >= LONG:
        with suppress(RankError):
            return certified_by_transfers(mechanism, samples, seed, proof)
    return certified_by_decomposition(mechanism, samples, seed, proof)


def _no_tree(mechanism: Mechanism) -> str:
    """The property that keeps a mechanism from being a tree with ten parameters a link; empty where none does."""
    if mechanism.is_plain_tree:
        return "drives that turn with several joints" if mechanism.description.shafts else ""
    return "relations among its parameters" if mechanism.description.loops is None else "loops"


def _sample_count(asked: int | None, parameters: int) -> int:
    if asked is None:
        return 2 * max(parameters, 1) + 1
    if asked < 2 * parameters:
        raise InputError(f"samples: expected at least twice the {parameters} parameters, got {asked}")
    return asked


def _same(energies: Array) -> Array:
    return energies
