"""A mechanism's dynamics on its fundamental parameters alone."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen_array
from adaptctl.caching import cached_property
from adaptctl.compilation.object_cache import kept
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.array_equations import ArrayEquation, ArrayEquations, OnArrays
from adaptctl.errors import InputError, printable, validate_kind
from adaptctl.identifiability.fundamental_basis import FundamentalBasis
from adaptctl.scalars import Column, Keyed, spread

if TYPE_CHECKING:
    from adaptctl.identifiability.sampling import States


SAMPLES, NEAR = 8, 0.02
"""States that are tried, and how far from its reference (rad or m) a mechanism with loops is moved to them."""
TOLERANCE, FLOOR = 1e-4, 1e-8
"""Of a column's energies: what may be missing. Of the greatest, in comparable units: what is round-off."""


@dataclass(frozen=True, eq=False)
class ReducedModel(Keyed):
    """A mechanism's equations of motion in its k fundamental (base) parameters, the inertial parameters that a
    fundamental basis keeps with the removed ones regrouped onto them, and all friction; in all P parameters where
    `basis` is None.

    For r primary (independent) joints, torques are tau = Y[:, columns] beta (r,), N m (N for a prismatic joint), with
    the torque regressor Y (r, P), the indices `columns` (k,) of the kept parameters and the fundamental ones beta (k,),
    SI units: columns of removed parameters are never computed. The `basis` may come from any mechanism of the same
    geometry, gravity and link names as `mechanism`. Raises `InputError` for a `basis` that is neither a
    `FundamentalBasis` nor None, for one of another geometry, gravity or link names, and for one whose regrouping
    changes energies by more than about 1e-4.
    """

    mechanism: Mechanism
    basis: FundamentalBasis | None

    def __post_init__(self) -> None:
        validate_kind(self.mechanism, Mechanism, "reduced model", "as load(...) gives one")
        if self.basis is None:
            return
        if not isinstance(self.basis, FundamentalBasis):
            raise InputError(f"basis: expected a FundamentalBasis or None, got {printable(repr(self.basis))}")
        geometry = self.mechanism.geometry_sha256
        if self.basis.geometry_sha256 != geometry:
            raise InputError(
                f"the basis was found for {self.basis.mechanism_name!r}, whose geometry, gravity, link names or "
                f"constraints are not those of {self.mechanism.name!r}: find the basis of {self.mechanism.name!r}"
            )
        _validate_energies(self.mechanism, self.basis)

    @classmethod
    def full(cls, mechanism: Mechanism) -> ReducedModel:
        """The reduced model that keeps all P inertial and friction parameters of a `mechanism`, for comparison: k = P,
        and the regrouping matrix (P, P) is the identity. Nothing is raised."""
        return cls(mechanism, None)

    @cached_property
    def columns(self) -> tuple[int, ...]:
        """Zero-based indices (k,), in ascending order, of the k kept parameters among the mechanism's P inertial and
        friction parameters: those of the fundamental (base) basis, and all friction, which energies cannot show."""
        everything = range(len(self.mechanism.parameter_names))
        if self.basis is None:
            return tuple(everything)
        return (*self.basis.columns, *everything[self.mechanism.num_energy_parameters :])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the k kept parameters, such as ``link2.mc_x``, in the order of the fundamental (base) parameters:
        inertial ones, then friction's."""
        return tuple(self.mechanism.parameter_names[j] for j in self.columns)

    @cached_property
    def regrouping(self) -> Array:
        """The regrouping matrix K (k, P), read-only, that maps the P inertial and friction parameters D (P,) to the k
        fundamental (base) ones beta = K D, in SI units."""
        P, energetic = len(self.mechanism.parameter_names), self.mechanism.num_energy_parameters
        K = np.eye(P)[list(self.columns)]
        if self.basis is not None:
            K[: len(self.basis.columns), :energetic] = self.basis.regrouping
        return frozen_array(K, (len(self.columns), P), "regrouping")

    @cached_property
    def fundamental_parameters(self) -> Array:
        """The mechanism's own k fundamental (base) parameters beta = K D (k,), read-only, in SI units and the order of
        this model's `names`: its P inertial and friction parameters D (P,), regrouped by the matrix `regrouping` K (k,
        P)."""
        return frozen_array(
            self.regrouping @ self.mechanism.inertial_parameters, (len(self.columns),), "fundamental parameters"
        )

    def torque_regressor(self, p: ArrayLike, v: ArrayLike, a: ArrayLike, out: Array | None = None) -> Array:
        """The torque regressor Y[:, columns] (..., r, k) of r primary (independent) joints and the k kept parameters:
        times the fundamental (base) parameters (k,) in SI units it gives torques in N m (N for a prismatic joint).

        It is at positions `p`, rad (m), velocities `v`, rad/s (m/s), and accelerations `a`, rad/s^2 (m/s^2), all (...,
        r). It is written to `out`, float64 (..., r, k), and returned; None makes a new array. Raises `InputError` on a
        wrong shape, `NonFiniteError` on NaN or infinity, `SingularityError` near a singularity of closed kinematic
        loops.
        """
        equation = self._torque_regressor
        return equation.call(p, v, a) if out is None else equation.into(out, p, v, a)

    def slotine_li_regressor(
        self, p: ArrayLike, v: ArrayLike, v_r: ArrayLike, a_r: ArrayLike, out: Array | None = None
    ) -> Array:
        """The Slotine-Li regressor Y_r[:, columns] (..., r, k) of r primary (independent) joints and the k kept
        parameters. Times the fundamental (base) parameters (k,) in SI units it gives the torques M(p) a_r + C(p, v) v_r
        + g(p) + friction at v_r, N m (N for a prismatic joint), with the mass matrix M, the Christoffel (Coriolis)
        matrix C and the gravity torques g.

        It is at positions `p`, rad (m), velocities `v` and Slotine and Li's reference velocities `v_r`, rad/s (m/s),
        and reference accelerations `a_r`, rad/s^2 (m/s^2), all (..., r). It is written to `out`, float64 (..., r, k),
        and returned; None makes a new array. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity,
        `SingularityError` near a singularity of closed kinematic loops.
        """
        equation = self._slotine_li_regressor
        return equation.call(p, v, v_r, a_r) if out is None else equation.into(out, p, v, v_r, a_r)

    def inverse_dynamics(
        self, p: ArrayLike, v: ArrayLike, a: ArrayLike, beta: ArrayLike | None = None, out: Array | None = None
    ) -> Array:
        """Torques (..., r) of r primary (independent) joints, N m (N for a prismatic joint), that give the
        accelerations `a`, rad/s^2 (m/s^2), at positions `p`, rad (m), and velocities `v`, rad/s (m/s), all (..., r),
        gravity and friction included. `beta` (..., k) are values of the k fundamental (base) parameters in SI units,
        None for the mechanism's own.

        They are written to `out`, float64 (..., r), and returned; None makes a new array. Raises `InputError` on a
        wrong shape, `NonFiniteError` on NaN or infinity, `SingularityError` near a singularity of closed kinematic
        loops.
        """
        equation, values = self._inverse_dynamics, self.fundamental_parameters if beta is None else beta
        return equation.call(p, v, a, values) if out is None else equation.into(out, p, v, a, values)

    @cached_property
    def _inverse_dynamics(self) -> ArrayEquation:
        equations, kept = self.mechanism.equations, self.columns

        def torque(q: Column, v: Column, a: Column, beta: Column) -> Column:
            return equations.inverse_dynamics(q, v, v, a, spread(beta, kept, equations.parameters))

        return ArrayEquations(self.mechanism).of(torque, "v", "a", "beta", sizes={"beta": len(kept)})

    @cached_property
    def _torque_regressor(self) -> OnArrays:
        return self.mechanism.column_regressor("torque_regressor", self.columns)

    @cached_property
    def _slotine_li_regressor(self) -> OnArrays:
        return self.mechanism.column_regressor("slotine_li_regressor", self.columns)

    def embed(self, beta: ArrayLike) -> Array:
        """Values (..., P) of all P inertial and friction parameters D_I = F1 beta with the same torques as k
        fundamental (base) ones `beta` (..., k): F1 (P, k) puts beta at the kept indices, zeros elsewhere; in SI units.
        Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity."""
        values = self._checked(beta)
        out = np.zeros((*values.shape[:-1], len(self.mechanism.parameter_names)))
        out[..., list(self.columns)] = values
        return out

    def _checked(self, beta: ArrayLike) -> Array:
        return checked(beta, len(self.columns), "fundamental parameters")


@lru_cache(maxsize=32)  # neither changes, and sweeps make many models of them
def _validate_energies(mechanism: Mechanism, basis: FundamentalBasis) -> None:
    """Raise `InputError` for a basis whose regrouping changes energies; tried once, also for later processes."""
    numbers = basis.regrouping.tobytes() + basis.scales.tobytes()
    content = [list(basis.columns), list(basis.parameter_names), hashlib.sha256(numbers).hexdigest()]
    inputs = [mechanism.description.sha256, mechanism.geometry_sha256, *content]
    kept("basis keeps energies", inputs, bool, lambda: _keeps_energies(mechanism, basis))


def _keeps_energies(mechanism: Mechanism, basis: FundamentalBasis) -> bool:
    validate_energies(mechanism, basis)
    return True


def validate_energies(mechanism: Mechanism, basis: FundamentalBasis) -> None:
    """Raise `InputError`, naming a parameter, unless a fundamental (base) `basis` reproduces the energies of a
    `mechanism`: H = H[:, columns] K must hold in each of the P columns, but for about 1e-4 of its entries' size.

    H (7, P), in J per SI unit of each parameter, are the differences of kinetic plus potential energy between 8
    successive random states, the same at every call, `columns` (k,) the indices of the basis's k kept parameters and K
    (k, P) its property `regrouping`. A saved basis is data from a file: with a wrong coefficient or a missing row, a
    controller would apply wrong torques. With loops, the states' positions are drawn uniformly within 0.02 rad (m if
    prismatic) of the reference configuration. That the basis has the mechanism's P parameters is not checked.
    """
    from adaptctl.identifiability.energy_matrix import energy_differences  # as no saved result needs it

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
    from adaptctl.identifiability.sampling import States, random_states

    generator = np.random.default_rng(0)
    if mechanism.description.loops is None:
        return random_states(mechanism, SAMPLES, generator)
    p: Array = mechanism.neutral_configuration + NEAR * generator.uniform(-1.0, 1.0, (SAMPLES, mechanism.dof))
    return States(p, generator.normal(size=p.shape), "about the reference")
