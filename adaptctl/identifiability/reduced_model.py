"""Dynamics of a mechanism in its base parameters alone."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, frozen_array
from adaptctl.caching import cached_property
from adaptctl.compilation.object_cache import kept
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.array_equations import ArrayEquation, ArrayEquations, OnArrays
from adaptctl.errors import InputError, printable, validate_kind
from adaptctl.identifiability.essential_space import essential_space
from adaptctl.identifiability.fundamental_basis import FundamentalBasis, fundamental_basis
from adaptctl.scalars import Column, Keyed, spread

if TYPE_CHECKING:
    from adaptctl.identifiability.sampling import States


# States that are tried, and how far from its reference (rad or m) a mechanism with loops is moved to them.
CHECKED_STATES, MAX_LOOP_OFFSET = 8, 0.02
# Share of a column's energies that may be missing, and share of the greatest that is round-off.
ENERGY_TOLERANCE, ROUND_OFF_FLOOR = 1e-4, 1e-8


class _Computed:
    """Default of `basis`: computed from the mechanism, as None stands for no basis."""

    def __repr__(self) -> str:
        return "fundamental_basis(essential_space(mechanism))"


_COMPUTED = cast(FundamentalBasis, _Computed())


@dataclass(frozen=True, eq=False)
class ReducedModel(Keyed):
    r"""
    Equations of motion of a mechanism in its k base parameters, friction included.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r primary (independent) joints.
    basis : FundamentalBasis or None, optional
        Basis of any mechanism of the same geometry, gravity and link names; None keeps all P parameters. By default
        `fundamental_basis` of the mechanism's `essential_space`.

    Raises
    ------
    InputError
        If the basis belongs to another geometry, gravity or other link names, or changes energies by more than about
        1e-4 of their size.
    RankError
        If the number of base parameters cannot be certified.

    Notes
    -----
    Torques are :math:`\tau = Y_c(p, v, a) \beta`; columns of removed parameters are never computed.

    Examples
    --------
    >>> model = adaptctl.ReducedModel(arm)
    >>> model.torque_regressor(p, v, np.zeros(2)).shape
    (2, 6)
    >>> torque = model.inverse_dynamics(p, v, np.zeros(2))
    >>> bool(np.allclose(torque, arm.inverse_dynamics(p, v, np.zeros(2))))
    True
    """

    mechanism: Mechanism
    basis: FundamentalBasis | None = _COMPUTED

    def __post_init__(self) -> None:
        validate_kind(self.mechanism, Mechanism, "reduced model", "as load(...) gives one")
        if self.basis is _COMPUTED:
            object.__setattr__(self, "basis", fundamental_basis(essential_space(self.mechanism)))
            return
        if self.basis is None:
            return
        if not isinstance(self.basis, FundamentalBasis):
            raise InputError(f"basis: expected a FundamentalBasis or None, got {printable(repr(self.basis))}")
        geometry = self.mechanism.geometry_sha256
        if self.basis.geometry_sha256 != geometry:
            raise InputError(
                f"the basis is that of {self.basis.mechanism_name!r}, whose geometry, gravity, link names or "
                f"constraints differ from those of {self.mechanism.name!r}; compute the basis of "
                f"{self.mechanism.name!r}"
            )
        _validate_energies(self.mechanism, self.basis)

    def __repr__(self) -> str:
        kept = f"{len(self.names)} of {len(self.mechanism.parameter_names)} parameters"
        return f"<ReducedModel of {self.mechanism.name!r}: {kept}>"

    @classmethod
    def full(cls, mechanism: Mechanism) -> ReducedModel:
        """
        Return the model that keeps all parameters, for comparison.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with P inertial and friction parameters.

        Returns
        -------
        ReducedModel
            Model with k = P.

        Examples
        --------
        >>> len(adaptctl.ReducedModel.full(arm).names)
        20
        """
        return cls(mechanism, None)

    @cached_property
    def columns(self) -> tuple[int, ...]:
        """Indices of the k kept parameters among all P, ascending."""
        everything = range(len(self.mechanism.parameter_names))
        if self.basis is None:
            return tuple(everything)
        return (*self.basis.columns, *everything[self.mechanism.num_energy_parameters :])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the k kept parameters, inertial ones first."""
        return tuple(self.mechanism.parameter_names[j] for j in self.columns)

    @cached_property
    def regrouping(self) -> Array:
        """Regrouping matrix (k, P) from all parameters to base parameters, in SI units."""
        P, energetic = len(self.mechanism.parameter_names), self.mechanism.num_energy_parameters
        K = np.eye(P)[list(self.columns)]
        if self.basis is not None:
            K[: len(self.basis.columns), :energetic] = self.basis.regrouping
        return frozen_array(K, (len(self.columns), P), "regrouping")

    @cached_property
    def fundamental_parameters(self) -> Array:
        """The mechanism's own base parameters (k,) in SI units."""
        return frozen_array(
            self.regrouping @ self.mechanism.inertial_parameters, (len(self.columns),), "base parameters"
        )

    def torque_regressor(self, p: ArrayLike, v: ArrayLike, a: ArrayLike, out: Array | None = None) -> Array:
        """
        Compute the torque regressor of the base parameters.

        Parameters
        ----------
        p : array_like
            Positions (..., r) in rad, or m for a prismatic joint.
        v : array_like
            Velocities (..., r) in rad/s or m/s.
        a : array_like
            Accelerations (..., r) in rad/s^2 or m/s^2.
        out : numpy.ndarray, optional
            Array (..., r, k) of float64 that the result in N m (N) per unit of each parameter is written to. Default: a
            new one.

        Returns
        -------
        numpy.ndarray
            Regressor (..., r, k) in N m (N for a prismatic joint) per SI unit of each parameter.

        Raises
        ------
        InputError
            If a shape is wrong (`NonFiniteError` for NaN and infinity).
        SingularityError
            If closed loops are near a singularity.

        Examples
        --------
        >>> torque = model.torque_regressor(p, v, v) @ model.fundamental_parameters
        >>> bool(np.allclose(torque, arm.inverse_dynamics(p, v, v)))
        True
        """
        equation = self._torque_regressor
        return equation.call(p, v, a) if out is None else equation.into(out, p, v, a)

    def slotine_li_regressor(
        self, p: ArrayLike, v: ArrayLike, v_r: ArrayLike, a_r: ArrayLike, out: Array | None = None
    ) -> Array:
        """
        Compute the regressor of Slotine and Li's control law.

        Parameters
        ----------
        p : array_like
            Positions (..., r) in rad, or m for a prismatic joint.
        v : array_like
            Velocities (..., r) in rad/s or m/s.
        v_r : array_like
            Reference velocities (..., r) in rad/s or m/s.
        a_r : array_like
            Reference accelerations (..., r) in rad/s^2 or m/s^2.
        out : numpy.ndarray, optional
            Array (..., r, k) of float64 that the result in N m (N) per unit of each parameter is written to. Default: a
            new one.

        Returns
        -------
        numpy.ndarray
            Regressor (..., r, k) in N m (N for a prismatic joint) per SI unit of each parameter.

        Raises
        ------
        InputError
            If a shape is wrong (`NonFiniteError` for NaN and infinity).
        SingularityError
            If closed loops are near a singularity.

        Notes
        -----
        The product with the base parameters is :math:`M(p) a_r + C(p, v) v_r + g(p)` plus friction at :math:`v_r`, with
        the Coriolis matrix :math:`C` by Christoffel symbols.

        Examples
        --------
        >>> model.slotine_li_regressor(p, v, v, np.zeros(2)).shape
        (2, 6)
        """
        equation = self._slotine_li_regressor
        return equation.call(p, v, v_r, a_r) if out is None else equation.into(out, p, v, v_r, a_r)

    def inverse_dynamics(
        self, p: ArrayLike, v: ArrayLike, a: ArrayLike, beta: ArrayLike | None = None, out: Array | None = None
    ) -> Array:
        """
        Compute the torques of a motion, with gravity and friction.

        Parameters
        ----------
        p : array_like
            Positions (..., r) in rad, or m for a prismatic joint.
        v : array_like
            Velocities (..., r) in rad/s or m/s.
        a : array_like
            Accelerations (..., r) in rad/s^2 or m/s^2.
        beta : array_like, optional
            Base parameters (..., k) in SI units; the mechanism's own by default.
        out : numpy.ndarray, optional
            Array (..., r) of float64 that the torque in N m (N) is written to. Default: a new one.

        Returns
        -------
        numpy.ndarray
            Torques (..., r) in N m, or forces in N for a prismatic joint.

        Raises
        ------
        InputError
            If a shape is wrong (`NonFiniteError` for NaN and infinity).
        SingularityError
            If closed loops are near a singularity.

        Examples
        --------
        >>> bool(np.allclose(model.inverse_dynamics(p, v, v, beta=2.0 * model.fundamental_parameters),
        ...                  2.0 * model.inverse_dynamics(p, v, v)))
        True
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
        """
        Return full parameters with the same torques as base parameters.

        Parameters
        ----------
        beta : array_like
            Base parameters (..., k) in SI units.

        Returns
        -------
        numpy.ndarray
            Parameters (..., P) in SI units: `beta` at the kept indices, zeros elsewhere.

        Raises
        ------
        InputError
            If the shape is wrong (`NonFiniteError` for NaN and infinity).

        Examples
        --------
        >>> model.embed(model.fundamental_parameters).shape
        (20,)
        """
        values = self._checked(beta)
        out = np.zeros((*values.shape[:-1], len(self.mechanism.parameter_names)))
        out[..., list(self.columns)] = values
        return out

    def _checked(self, beta: ArrayLike) -> Array:
        return checked(beta, len(self.columns), "base parameters")


@lru_cache(maxsize=32)  # neither changes, and sweeps make many models of them
def _validate_energies(mechanism: Mechanism, basis: FundamentalBasis) -> None:
    numbers = basis.regrouping.tobytes() + basis.scales.tobytes()
    content = [list(basis.columns), list(basis.parameter_names), hashlib.sha256(numbers).hexdigest()]
    inputs = [mechanism.description.sha256, mechanism.geometry_sha256, *content]
    kept("basis keeps energies", inputs, bool, lambda: _keeps_energies(mechanism, basis))


def _keeps_energies(mechanism: Mechanism, basis: FundamentalBasis) -> bool:
    validate_energies(mechanism, basis)
    return True


def validate_energies(mechanism: Mechanism, basis: FundamentalBasis) -> None:
    """Raise `InputError` if a basis does not reproduce the mechanism's energies to 1e-4."""
    # A saved basis is data from a file: with a wrong coefficient, a controller would apply wrong torques.
    from adaptctl.identifiability.energy_matrix import energy_differences  # as no saved result needs it

    H = energy_differences(mechanism, _few_states(mechanism))
    kept, K, scales = H[:, basis.columns], basis.regrouping, basis.scales
    size = np.abs(H).max(axis=0)
    allowed = (
        ENERGY_TOLERANCE * (size + np.abs(kept).max(axis=0) @ np.abs(K))
        + ROUND_OFF_FLOOR * (size * scales).max() / scales
    )
    missing = np.abs(H - kept @ K).max(axis=0)
    worst = int(np.argmax(missing / np.maximum(allowed, np.finfo(float).tiny)))
    if missing[worst] > allowed[worst]:
        raise InputError(
            f"the basis of {basis.mechanism_name!r} is wrong or damaged: without {basis.parameter_names[worst]} the "
            f"energies of {mechanism.name!r} change; compute the basis again"
        )


def _few_states(mechanism: Mechanism) -> States:
    from adaptctl.identifiability.sampling import States, random_states

    generator = np.random.default_rng(0)
    if mechanism.description.loops is None:
        return random_states(mechanism, CHECKED_STATES, generator)
    p: Array = mechanism.neutral_configuration + MAX_LOOP_OFFSET * generator.uniform(
        -1.0, 1.0, (CHECKED_STATES, mechanism.dof)
    )
    return States(p, generator.normal(size=p.shape), "near the reference")
