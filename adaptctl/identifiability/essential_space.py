"""The essential parameter space: what a mechanism's motion depends on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability.certificate import ROUND_OFF, Certificate, leftovers
from adaptctl.identifiability.null_space import null_residual, unscaled_bases
from adaptctl.identifiability.numerical_rank import singular_values, triangle
from adaptctl.identifiability.right_angles import near_right_angles
from adaptctl.identifiability.sampled_regressors import energetic_names, energy_differences, torque_rows
from adaptctl.identifiability.sampling import States, random_states
from adaptctl.identifiability.scaled_regressor import ScaledRegressor
from adaptctl.mechanism.pose import Array, frozen_array


@dataclass(frozen=True, eq=False)
class EssentialSpace:
    """The parameters (P) that change energies and torques, and the complement that changes none.

    `singular_values` (P,) and `basis` V1 (P, k) belong to the energy differences H of `states`, unscaled, as
    the paper has them (Sheu and Walker 1991, section 3). `null_basis` V2 (P, P-k) is orthonormal and does not
    depend on the states. The rank is certified on energy differences at random states with scaled columns:
    `scales` (P,) are the factors, `scaled_singular_values` (P,) and `scaled_vectors` (P, P), a vector a column,
    factor that matrix. Choices between parameters of different units are made on these.
    """

    mechanism_name: str
    sha256: str
    geometry_sha256: str
    parameter_names: tuple[str, ...]
    rank: int
    singular_values: Array
    basis: Array
    null_basis: Array
    scales: Array
    scaled_singular_values: Array
    scaled_vectors: Array
    certificate: Certificate
    states: str
    """where the states behind `singular_values` and `basis` come from"""

    def __post_init__(self) -> None:
        P, k = len(self.parameter_names), self.rank
        shapes = {
            "singular_values": (P,),
            "basis": (P, k),
            "null_basis": (P, P - k),
            "scales": (P,),
            "scaled_singular_values": (P,),
            "scaled_vectors": (P, P),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen_array(getattr(self, name), shape, name))

    @property
    def scaled_null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k) among the scaled parameters D / scales."""
        return self.scaled_vectors[:, self.rank :]

    def project(self, parameters: ArrayLike) -> Array:
        """Essential parameters D_E = V1 V1' D (..., P) of inertial parameters D (..., P)."""
        D = np.asarray(parameters, dtype=np.float64)
        if D.ndim == 0 or D.shape[-1] != len(self.parameter_names):
            raise InputError(f"parameters: expected shape (..., {len(self.parameter_names)}), got {D.shape}")
        return (D @ self.basis) @ self.basis.T


def essential_space(
    mechanism: Mechanism, *, samples: int | None = None, seed: int = 0, states: States | None = None
) -> EssentialSpace:
    """The essential parameter space of a mechanism, from energies at random states.

    `samples` is the number of states, at least (and by default about) twice as many as parameters. With
    `states`, the singular values and V1 are those of the given states' energies, so that model reduction holds
    for them; the rank and V2, which are the mechanism's own, still come from random ones.
    Raises `RankError`, with the spectrum, when the rank cannot be certified.
    """
    count = _sample_count(samples, len(energetic_names(mechanism)))
    generator = np.random.default_rng(seed)
    doubled = random_states(mechanism, 2 * count, generator)
    generic = States(doubled.p[:count], doubled.v[:count], f"{count} {doubled.origin}, seed {seed}")
    scaled = ScaledRegressor.of_energies(mechanism, generic)
    null_basis, complement = unscaled_bases(scaled.null_basis, scaled.scales)
    rows = torque_rows(mechanism, generator)
    certificate = Certificate(
        rank_energy=scaled.decision.rank,
        rank_torque=ScaledRegressor.of_torques(mechanism, rows).decision.rank,
        rank_doubled=ScaledRegressor.of_energies(mechanism, doubled).decision.rank,
        gap=scaled.decision.gap,
        relative_smallest=scaled.decision.smallest,
        samples=count,
        seed=seed,
        null_residual=null_residual(rows, null_basis, scaled.scales),
        leftovers=leftovers(scaled.singular_values, scaled.vectors, scaled.decision.rank, energetic_names(mechanism)),
        near_right_angles=near_right_angles(mechanism.description),
    )
    # An angle that is taken as exact elsewhere may be what spoils a gap.
    suspects = near_right_angles(mechanism.description, exact=ROUND_OFF)
    certificate.require_accepted(mechanism.name, scaled.singular_values, suspects)
    return _space(mechanism, states or generic, certificate, scaled, null_basis, complement)


def _sample_count(asked: int | None, parameters: int) -> int:
    if asked is None:
        return 2 * parameters + 1
    if asked < 2 * parameters:
        raise InputError(f"samples: expected at least twice the {parameters} parameters, got {asked}")
    return asked


def _space(
    mechanism: Mechanism,
    states: States,
    certificate: Certificate,
    scaled: ScaledRegressor,
    null_basis: Array,
    complement: Array,
) -> EssentialSpace:
    H = energy_differences(mechanism, states)
    return EssentialSpace(
        mechanism_name=mechanism.name,
        sha256=mechanism.description.sha256,
        geometry_sha256=mechanism.geometry_sha256,
        parameter_names=energetic_names(mechanism),
        rank=certificate.rank,
        singular_values=singular_values(H),
        basis=complement @ _right_vectors(H @ complement),
        null_basis=null_basis,
        scales=scaled.scales,
        scaled_singular_values=scaled.singular_values,
        scaled_vectors=scaled.vectors,
        certificate=certificate,
        states=states.origin,
    )


def _right_vectors(matrix: Array) -> Array:
    """All right singular vectors, a vector a column, however few the rows."""
    return np.linalg.svd(triangle(matrix))[2].T
