"""Physically consistent parameters with given base parameters."""

from __future__ import annotations

import warnings
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.caching import cached_property
from adaptctl.description.inertia import TEN_OF_PSEUDO_INERTIA, pseudo_inertia
from adaptctl.errors import AdaptctlError, InputError, MissingExtraError
from adaptctl.identifiability.reduced_model import ReducedModel

if TYPE_CHECKING:
    import cvxpy

# Relative distance below which base parameters count as realisable: the solver's accuracy.
FEASIBLE_DISTANCE = 1e-6
# Fractions by which the distance may be exceeded to come nearer to the prior, where nothing is realisable: the next one
# where the solver ends without a result.
SLACKS = (1e-3, 1e-2, 1e-1)

# Smallest eigenvalue of a body relative to the prior's, as a fraction of the largest one.
MIN_EIGENVALUE_RATIO = 1e-9


@dataclass(frozen=True, eq=False)
class ConsistentParameters:
    """
    Physically consistent parameters of a mechanism for given base parameters, in SI units.

    Nothing is checked at construction.

    Parameters
    ----------
    parameters : numpy.ndarray
        Physically consistent inertial and friction parameters (P,) in SI units.
    fundamental : numpy.ndarray
        Their base parameters (k,) in SI units, in the order of the reduced model's `names`.
    target : numpy.ndarray
        Base parameters (k,) in SI units that were asked for, in the same order.

    Examples
    --------
    >>> from adaptctl.identifiability import ConsistentParameters
    >>> lift = ConsistentParameters(arm.inertial_parameters, model.fundamental_parameters, model.fundamental_parameters)
    >>> lift.distance, lift.is_feasible
    (0.0, True)
    """

    parameters: Array
    fundamental: Array
    target: Array

    def __repr__(self) -> str:
        return f"<ConsistentParameters: {len(self.parameters)}, distance {self.distance:.3g}>"

    @cached_property
    def distance(self) -> float:
        """Distance of `fundamental` from `target` divided by the norm of `target`, without a unit."""
        return float(np.linalg.norm(self.fundamental - self.target)) / _size(self.target)

    @property
    def is_feasible(self) -> bool:
        """True if rigid bodies can have the target: `distance` is below 1e-6."""
        return self.distance < FEASIBLE_DISTANCE


def nearest_consistent(model: ReducedModel, beta: ArrayLike, prior: ArrayLike | None = None) -> ConsistentParameters:
    r"""
    Compute the physically consistent parameters for given base parameters, as close as possible to a prior.

    Parameters
    ----------
    model : ReducedModel
        Model of a mechanism without constraints on its parameters.
    beta : array_like
        Base parameters (k,) in SI units, in the order of the model's `names`.
    prior : array_like, optional
        Consistent parameters (P,) in SI units; the mechanism's own by default.

    Returns
    -------
    ConsistentParameters
        Parameters, and the distance of their base parameters from `beta`.

    Raises
    ------
    MissingExtraError
        If cvxpy or Clarabel (the extra `consistency`) is not installed.
    InputError
        If the mechanism has linear constraints, a shape is wrong, a number is not finite, or no rigid bodies can have
        the prior.
    AdaptctlError
        If the semidefinite programme ends without a solution.

    Notes
    -----
    The distance between pseudo-inertias :math:`J_i` and the prior's :math:`Q_i` is the Bregman divergence [1]_

    .. math:: \sum_i \mathrm{tr}(Q_i^{-1} J_i) - \log\det(Q_i^{-1} J_i),

    which depends on no units and frames. Where no rigid bodies have `beta`, the base parameters may differ from it by
    1.001 times the least possible distance (1.1 times where the solver needs it).

    References
    ----------
    .. [1] T. Lee, P. M. Wensing and F. C. Park, 2020. Geometric robot dynamic identification: a convex programming
       approach. IEEE Transactions on Robotics.

    Examples
    --------
    >>> from adaptctl.identifiability import nearest_consistent
    >>> nearest_consistent(model, [0.5, 0.1])
    Traceback (most recent call last):
    adaptctl.errors.InputError: base parameters: expected shape (6,), got (2,)
    """
    given, every = len(model.mechanism.parameter_names), len(model.mechanism.description.parameter_names)
    if given != every:
        raise InputError(
            f"{model.mechanism.name}: expected a mechanism without constraints, with ten parameters per link, got "
            f"{given} of {every} parameters; use the model of its `unconstrained`"
        )
    wanted = frozen_array(beta, (len(model.columns),), "base parameters")
    own = model.mechanism.inertial_parameters
    known = frozen_array(own if prior is None else prior, own.shape, "prior")
    bodies = _Bodies(model, known)
    nearest = bodies.nearest(wanted)
    away = ConsistentParameters(nearest, model.regrouping @ nearest, wanted)
    parameters = bodies.likeliest_near(wanted, away)
    return ConsistentParameters(parameters, model.regrouping @ parameters, wanted)


class _Bodies:
    def __init__(self, model: ReducedModel, prior: Array) -> None:
        self._cp = _solver()
        self._regrouping, self._drives = model.regrouping, prior[_tens(model) :]
        self._prior_roots = _roots(model, prior)
        self._relative = [self._cp.Variable((4, 4), PSD=True) for _ in self._prior_roots]
        self._share = self._cp.Variable(len(self._drives), nonneg=True) if len(self._drives) else None

    @property
    def _parameters(self) -> cvxpy.Expression:
        cp, parts = self._cp, []
        for X, root in zip(self._relative, self._prior_roots, strict=True):
            parts.append(_as_ten(root) @ cp.vec(X, order="F"))
        if self._share is not None:
            parts.append(cp.multiply(self._drives, self._share))
        return cp.hstack(parts)

    def nearest(self, wanted: Array) -> Array:
        """Parameters (P,) whose fundamental ones are nearest."""
        away = self._cp.norm((self._regrouping @ self._parameters - wanted) / _size(wanted))
        return self._solved(away, [])

    def likeliest(self, wanted: Array, within: float | None) -> Array:
        """Consistent parameters closest to the prior, with given base parameters."""
        cp = self._cp
        away = (self._regrouping @ self._parameters - wanted) / _size(wanted)
        divergence = sum(cp.trace(X) - cp.log_det(X) for X in self._relative)
        if self._share is not None:
            divergence = divergence + cp.sum(self._share - cp.log(self._share))
        return self._solved(divergence, [away == 0 if within is None else cp.norm(away) <= within])

    def likeliest_near(self, wanted: Array, nearest: ConsistentParameters) -> Array:
        """Consistent parameters closest to the prior, almost as close to beta as possible."""
        least = max(nearest.distance, 0.5 * FEASIBLE_DISTANCE)
        for within in (*([None] if nearest.is_feasible else []), *(least * (1.0 + slack) for slack in SLACKS)):
            with suppress(AdaptctlError):
                found = self.likeliest(wanted, within)
                if ConsistentParameters(found, self._regrouping @ found, wanted).distance < (
                    within or FEASIBLE_DISTANCE
                ):
                    return found
        return nearest.parameters

    def _solved(self, goal: Any, constraints: list[Any]) -> Array:
        cp = self._cp
        problem = cp.Problem(cp.Minimize(goal), constraints)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of lower accuracy: the lift tells its distance itself
            with suppress(cp.SolverError):  # then there is no status
                problem.solve(solver=cp.CLARABEL)
        if problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
            ended = "without a solution" if problem.status is None else f"as {problem.status!r}"
            raise AdaptctlError(f"consistency: the semidefinite program ended {ended}")
        self._move_inside()
        return np.asarray(self._parameters.value, dtype=np.float64)

    def _move_inside(self) -> None:
        for X in self._relative:
            values, vectors = np.linalg.eigh(X.value)
            X.value = (vectors * np.maximum(values, MIN_EIGENVALUE_RATIO * values[-1])) @ vectors.T
        if self._share is not None:
            self._share.value = np.maximum(self._share.value, MIN_EIGENVALUE_RATIO)


def _solver() -> Any:
    try:
        import clarabel  # noqa: F401  # the solver, through cvxpy
        import cvxpy
    except ImportError as error:
        raise MissingExtraError(
            "nearest_consistent solves a semidefinite program, which needs cvxpy and Clarabel: "
            "pip install 'adaptctl[consistency]'"
        ) from error
    return cvxpy


def _size(beta: Array) -> float:
    return float(np.linalg.norm(beta)) or 1.0


def _tens(model: ReducedModel) -> int:
    return 10 * len(model.mechanism.description.bodies)


def _roots(model: ReducedModel, prior: Array) -> list[Array]:
    roots: list[Array] = []
    for i, body in enumerate(model.mechanism.description.bodies):
        matrix = pseudo_inertia(prior[10 * i : 10 * i + 10])
        smallest = float(np.linalg.eigvalsh(matrix)[0])
        if not smallest > 0.0:
            raise InputError(
                f"prior: the parameters of {model.mechanism.links[body].name} are not physically consistent: its "
                f"pseudo-inertia has the eigenvalue {smallest:.3g}; give consistent parameters, for example rough "
                "values of the links"
            )
        roots.append(np.asarray(np.linalg.cholesky(matrix), dtype=np.float64))
    for name, value in zip(model.mechanism.parameter_names[_tens(model) :], prior[_tens(model) :], strict=True):
        if not value > 0.0:
            raise InputError(f"prior: {name}: expected a positive number, got {value:g}")
    return roots


def _as_ten(root: Array) -> Array:
    return np.asarray(TEN_OF_PSEUDO_INERTIA.T @ np.kron(root, root))
