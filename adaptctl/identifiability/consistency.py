"""The lift of fundamental parameters to full parameters that rigid bodies can have."""

from __future__ import annotations

import warnings
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.caching import cached_property
from adaptctl.description.inertia import UNIT_PSEUDO_INERTIAS, pseudo_inertia
from adaptctl.errors import AdaptctlError, InputError, MissingExtraError
from adaptctl.identifiability.reduced_model import ReducedModel

if TYPE_CHECKING:
    import cvxpy

REALISABLE = 1e-6
"""Relative distance below which fundamental parameters count as realisable: the solver's accuracy."""
SLACKS = (1e-3, 1e-2, 1e-1)
"""Fractions by which the distance may be exceeded to come nearer to the prior, where nothing is realisable: the next
one where the solver ends without a result."""

EDGE = 1e-9
"""Smallest eigenvalue of a body relative to the prior's, as a fraction of the largest one."""


@dataclass(frozen=True, eq=False)
class Lift:
    """A lift of k fundamental (base) parameters to P full (inertial and friction) ones of the same mechanism that rigid
    bodies can have, all in SI units.

    `parameters` (P,) are physically consistent, in the order of the mechanism's `parameter_names`; `fundamental` (k,)
    are their fundamental ones, in that of the reduced model's `names`, and `wanted` (k,), in the same order, those
    asked for. Nothing is checked at construction.
    """

    parameters: Array
    fundamental: Array
    target: Array

    @cached_property
    def distance(self) -> float:
        """The relative distance |fundamental - wanted| / |wanted|, no unit, of the lift's fundamental (base) parameters
        from those asked for: |.| is the root of the sum of squares of the values in SI units, whatever their units. It
        is |fundamental| where all asked for are zero."""
        return float(np.linalg.norm(self.fundamental - self.target)) / _size(self.target)

    @property
    def is_feasible(self) -> bool:
        """True if some rigid bodies have the fundamental (base) parameters asked for: if the lift's `distance` from
        them, relative to their size, no unit, is below 1e-6."""
        return self.distance < REALISABLE


def nearest_consistent(model: ReducedModel, beta: ArrayLike, prior: ArrayLike | None = None) -> Lift:
    """The lift of k fundamental (base) parameters `beta` (k,) to P full (inertial and friction) ones that are
    physically consistent (rigid bodies can have them), the nearest of these to a `prior` (P,), as a `Lift`. All are in
    SI units, beta in the order of the model's `names`, the prior in that of its mechanism's `parameter_names`.

    Fundamental parameters fix k of P values only; many sets of rigid bodies have the same, or none. The distance from
    the prior is the Bregman divergence sum_i tr(Q_i^-1 J_i) - log det(Q_i^-1 J_i) of the links' pseudo-inertias J_i (4,
    4) from the prior's Q_i, which depends on no units and no frames (Lee, Wensing and Park 2020). The prior must be
    consistent; None takes the mechanism's own parameters. Where no rigid bodies have beta, let d be the least distance
    from beta, the root of the sum of squares of the differences in SI units, of parameters that rigid bodies have: the
    result is the nearest to the prior of those within 1.001 d of beta (up to 1.1 d, where the solver needs it). The
    lift's `realisable` and `distance` say which it is. Rotor inertia and friction stay positive.

    It is found by a semidefinite programme of 10 unknowns a link. Raises `MissingExtraError` without cvxpy and Clarabel
    (the extra `consistency`), `InputError` for a mechanism whose constraints take parameters away, on wrong shapes, for
    values that are not finite and for a prior that no rigid bodies have, or with rotor inertia or friction that is not
    positive, `AdaptctlError` where the programme ends without a solution.
    """
    given, every = len(model.mechanism.parameter_names), len(model.mechanism.description.parameter_names)
    if given != every:
        raise InputError(
            f"{model.mechanism.name}: expected a mechanism without constraints, with ten parameters a link, got "
            f"{given} of {every} parameters: make the model of its `unconstrained`"
        )
    wanted = frozen_array(beta, (len(model.columns),), "fundamental parameters")
    own = model.mechanism.inertial_parameters
    known = frozen_array(own if prior is None else prior, own.shape, "prior")
    bodies = _Bodies(model, known)
    nearest = bodies.nearest(wanted)
    away = Lift(nearest, model.regrouping @ nearest, wanted)
    parameters = bodies.likeliest_near(wanted, away)
    return Lift(parameters, model.regrouping @ parameters, wanted)


class _Bodies:
    """The unknowns X of each link, whose pseudo-inertia is G X G' with the prior's G G': X is 1 at the prior."""

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
        """Parameters (P,) whose fundamental ones are nearest; at the cone's edge, where none are realisable."""
        away = self._cp.norm((self._regrouping @ self._parameters - wanted) / _size(wanted))
        return self._solved(away, [])

    def likeliest(self, wanted: Array, within: float | None) -> Array:
        """The consistent parameters nearest to the prior among those with these fundamental ones, exactly or to a
        relative distance of `within`."""
        cp = self._cp
        away = (self._regrouping @ self._parameters - wanted) / _size(wanted)
        divergence = sum(cp.trace(X) - cp.log_det(X) for X in self._relative)
        if self._share is not None:
            divergence = divergence + cp.sum(self._share - cp.log(self._share))
        return self._solved(divergence, [away == 0 if within is None else cp.norm(away) <= within])

    def likeliest_near(self, wanted: Array, nearest: Lift) -> Array:
        """The consistent parameters nearest to the prior among those almost as near to beta as any are: with the least
        slack that the solver can do, and keeps; the nearest to beta where it can do none."""
        least = max(nearest.distance, 0.5 * REALISABLE)
        for within in (*([None] if nearest.is_feasible else []), *(least * (1.0 + slack) for slack in SLACKS)):
            with suppress(AdaptctlError):
                found = self.likeliest(wanted, within)
                if Lift(found, self._regrouping @ found, wanted).distance < (within or REALISABLE):
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
            raise AdaptctlError(f"consistency: the semidefinite programme ended {ended}")
        self._move_inside()
        return np.asarray(self._parameters.value, dtype=np.float64)

    def _move_inside(self) -> None:
        """Bodies at the cone's edge, which an interior-point method may leave by its accuracy, are moved inside it."""
        for X in self._relative:
            values, vectors = np.linalg.eigh(X.value)
            X.value = (vectors * np.maximum(values, EDGE * values[-1])) @ vectors.T
        if self._share is not None:
            self._share.value = np.maximum(self._share.value, EDGE)


def _solver() -> Any:
    try:
        import clarabel  # noqa: F401  # the solver, through cvxpy
        import cvxpy
    except ImportError as error:
        raise MissingExtraError(
            "physical consistency is decided by a semidefinite programme, which needs cvxpy and Clarabel: "
            "pip install 'adaptctl[consistency]'"
        ) from error
    return cvxpy


def _size(beta: Array) -> float:
    """|beta|, and 1 where that is zero."""
    return float(np.linalg.norm(beta)) or 1.0


def _tens(model: ReducedModel) -> int:
    return 10 * len(model.mechanism.description.bodies)


def _roots(model: ReducedModel, prior: Array) -> list[Array]:
    """Cholesky factor G (4, 4) of each link's pseudo-inertia in the prior."""
    roots: list[Array] = []
    for i, body in enumerate(model.mechanism.description.bodies):
        matrix = pseudo_inertia(prior[10 * i : 10 * i + 10])
        smallest = float(np.linalg.eigvalsh(matrix)[0])
        if not smallest > 0.0:
            raise InputError(
                f"prior: no rigid body has the ten of {model.mechanism.links[body].name}: its pseudo-inertia has "
                f"the eigenvalue {smallest:.3g}; give consistent parameters, such as a rough guess of the links"
            )
        roots.append(np.asarray(np.linalg.cholesky(matrix), dtype=np.float64))
    for name, value in zip(model.mechanism.parameter_names[_tens(model) :], prior[_tens(model) :], strict=True):
        if not value > 0.0:
            raise InputError(f"prior: {name}: expected a positive number, got {value:g}")
    return roots


def _as_ten(root: Array) -> Array:
    """The matrix (10, 16) that takes X, column by column, to the ten of the pseudo-inertia G X G'."""
    to_ten = np.linalg.pinv(UNIT_PSEUDO_INERTIAS.reshape(10, 16).T)
    return np.asarray(to_ten @ np.kron(root, root))
