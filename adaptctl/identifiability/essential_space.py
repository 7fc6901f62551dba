"""The essential parameter space: what a mechanism's motion depends on."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.constrained_mechanism import RelatedMechanism
from adaptctl.errors import InputError, RankError
from adaptctl.identifiability.certificate import Certificate
from adaptctl.identifiability.certified_null_space import CertifiedNullSpace, NullSpace, by_decomposition, by_transfers
from adaptctl.identifiability.energy_factor import EnergyFactor
from adaptctl.identifiability.null_space import unscaled_bases
from adaptctl.identifiability.numerical_rank import right_vectors, singular_values
from adaptctl.identifiability.sampled_regressors import energetic_names, energy_blocks
from adaptctl.identifiability.sampling import States

Method = Literal["automatic", "svd", "transfers"]
METHODS: tuple[str, ...] = get_args(Method)
LONG = 100
"""Parameters of a tree from which on its null space is found joint by joint."""


@dataclass(frozen=True, eq=False)
class EssentialSpace:
    """The parameters (P) that change energies and torques, and the complement that changes none.

    `singular_values` (P,) and `basis` V1 (P, k) belong to the energy differences H of `states`, unscaled, as
    the paper has them (Sheu and Walker 1991, section 3). `null_basis` V2 (P, P-k) is orthonormal and does not
    depend on the states. `scales` (P,) make parameters comparable: choices between parameters of different units
    are made on D / scales, whose null vectors are `scaled_null_basis` (P, P-k). Arrays are made when first asked for,
    and cannot be written.
    """

    mechanism: Mechanism
    null_space: NullSpace
    certificate: Certificate
    states: str
    """where the states behind `singular_values` and `basis` come from"""
    energies: Callable[[], Array]
    """The triangle R of these states' energy differences H = Q R."""

    @property
    def mechanism_name(self) -> str:
        """The mechanism's name."""
        return self.mechanism.name

    @property
    def sha256(self) -> str:
        """The hash of all that moves."""
        return self.mechanism.description.sha256

    @property
    def geometry_sha256(self) -> str:
        """The hash of what the space depends on."""
        return self.mechanism.geometry_sha256

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the P parameters that enter energies."""
        return energetic_names(self.mechanism)

    @property
    def rank(self) -> int:
        """How many parameters are independent, k."""
        return self.null_space.rank

    @cached_property
    def scales(self) -> Array:
        """(P,)"""
        return frozen_array(self.null_space.scales, (len(self.parameter_names),), "scales")

    @cached_property
    def scaled_null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k) among the scaled parameters D / scales."""
        return self._frozen(self.null_space.null_basis, "scaled null basis")

    @cached_property
    def null_basis(self) -> Array:
        """V2 (P, P-k)."""
        return self._frozen(self._bases[0], "null basis")

    @cached_property
    def singular_values(self) -> Array:
        """Of H (P,), falling."""
        return frozen_array(singular_values(self._triangle), (len(self.parameter_names),), "singular values")

    @cached_property
    def basis(self) -> Array:
        """V1 (P, k)."""
        complement = self._bases[1]
        return self._frozen(complement @ right_vectors(self._triangle @ complement), "basis")

    def project(self, parameters: ArrayLike) -> Array:
        """Essential parameters D_E = V1 V1' D (..., P) of inertial parameters D (..., P)."""
        D = np.asarray(parameters, dtype=np.float64)
        if D.ndim == 0 or D.shape[-1] != len(self.parameter_names):
            raise InputError(f"parameters: expected shape (..., {len(self.parameter_names)}), got {D.shape}")
        return (D @ self.basis) @ self.basis.T

    @cached_property
    def _triangle(self) -> Array:
        return self.energies()

    @cached_property
    def _bases(self) -> tuple[Array, Array]:
        return unscaled_bases(self.null_space.null_basis, self.null_space.scales)

    @staticmethod
    def _frozen(array: Array, what: str) -> Array:
        return frozen_array(array, array.shape, what)


def essential_space(
    mechanism: Mechanism,
    *,
    samples: int | None = None,
    seed: int = 0,
    states: States | None = None,
    method: Method = "automatic",
) -> EssentialSpace:
    """The essential parameter space of a mechanism.

    By the method "svd" it comes from energies at random states; `samples` is their number, at least (and by default
    about) twice as many as parameters. By "transfers", for trees alone, its null space comes from the geometry, joint
    by joint, in time that grows with the number of links, and energies hold it to account. "automatic" takes
    transfers for trees of a hundred parameters or more if their rank can be certified so, and else "svd".
    With `states`, the singular values and V1 are those of the given states' energies, so that model reduction holds
    for them; the rank and V2, which are the mechanism's own, do not depend on them.
    Raises `RankError`, with the spectrum, when the rank cannot be certified.
    """
    count = _sample_count(samples, mechanism.energetic)
    given = None if states is None else EnergyFactor.of(energy_blocks(mechanism, [states])).triangle
    found = _certified(mechanism, method, count, seed)
    if given is None or states is None:
        return EssentialSpace(mechanism, found.null_space, found.certificate, found.states, found.energies)
    return EssentialSpace(mechanism, found.null_space, found.certificate, states.origin, lambda: given)


def _certified(mechanism: Mechanism, method: str, samples: int, seed: int) -> CertifiedNullSpace:
    """By the method asked for. Where it is left to us, what transfers cannot certify may still have a clear gap."""
    if method not in METHODS:
        raise InputError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    hindrance = _no_tree(mechanism)
    if method == "transfers":
        if hindrance:
            raise InputError(f"method: transfers are for trees, but {mechanism.name} has {hindrance}; use svd")
        return by_transfers(mechanism, samples, seed)
    if method == "automatic" and not hindrance and mechanism.energetic >= LONG:
        with suppress(RankError):
            return by_transfers(mechanism, samples, seed)
    return by_decomposition(mechanism, samples, seed)


def _no_tree(mechanism: Mechanism) -> str:
    """What keeps a mechanism from being a tree with ten parameters a link; empty where nothing does."""
    if mechanism.description.loops is not None:
        return "loops"
    if mechanism.description.shafts:
        return "drives that turn with several joints"
    return "relations among its parameters" if isinstance(mechanism, RelatedMechanism) else ""


def _sample_count(asked: int | None, parameters: int) -> int:
    if asked is None:
        return 2 * parameters + 1
    if asked < 2 * parameters:
        raise InputError(f"samples: expected at least twice the {parameters} parameters, got {asked}")
    return asked
