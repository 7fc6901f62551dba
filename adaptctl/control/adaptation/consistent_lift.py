"""Adaptation of fundamental parameters that rigid bodies have at every tick: natural adaptation of a lift of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.control.adaptation.composite import residual
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.control.adaptation.natural import (
    checked_rate,
    each_rate,
    moved_bodies,
    raised_slope,
    require_consistent,
    require_rates,
)
from adaptctl.control.adaptation.prediction import TorqueFilter, require_cutoff, require_positive
from adaptctl.control.gains.gains import positive_per_joint
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, each
from adaptctl.scalars.column import combined

NEAR = 1e-9
"""of the largest fundamental parameter: the first estimate is the lift's, to round-off"""


class LiftMemory(NamedTuple):
    """The memory of a lifted estimate: the lift (P,), and the torque filters."""

    lift: Any
    """(P,) parameters of rigid bodies whose fundamental ones are the estimate"""
    filtered: Any
    """the torque filters', where torques are predicted"""

    @property
    def recorded(self) -> Any:
        """Part of the memory that a run keeps: the lift (P,)."""
        return self.lift


@dataclass(frozen=True, eq=False)
class ConsistentLift(AdaptationLaw[LiftMemory]):
    """Natural adaptation of a physically consistent lift D of the estimate (Lee, Kwon and Park 2018).

    estimate = K D, where D are parameters (P,) of rigid bodies that move by natural adaptation along the slope K'(Y's +
    W'R (W estimate - F[tau])), Y and W (r, k) on the k fundamental parameters alone, K (k, P) the model's `regrouping`,
    s (r,) the sliding variable in rad/s (m/s).

    All P parameters have the slope K'Y's, for their regressor is Y K: what removed columns would add is never computed.
    `lift` (P,) is the first D, physically consistent; the first estimate is K lift. `rate` is that of `Natural`, one
    number in 1/J or one for each link with a body and then for each drive's parameter. With a `weight` R (1/(N m s),
    one number or (r,)) torques are predicted as in `Composite`, behind a filter F of `cutoff` (1/s); with None, the
    default, they are not, and W and F have no part. Raises `InputError` for a rate or a weight that is not positive and
    a lift that is not finite.

    Guarantees, without disturbance: V = s'Ms/2 + sum_i D(P_i true, P_i)/rate_i falls as -s'Ks - eps'R eps, with
    eps = W error, as with `Natural`, whose controller on all parameters this is, tick for tick, without a weight. And
    whatever disturbs: the estimate is K D of bodies with positive definite pseudo-inertias, so that the estimate's mass
    matrix is positive definite everywhere. Sampled, the prediction error is solved implicitly in the metric of the
    moment.

    Gives up: convergence of D itself, of which only K D is seen: the bodies that are found are those nearest the first
    ones, in the natural divergence, of all that have the estimate. What else `Natural` does: it starts from consistent
    parameters, and hardly finds a moment that it starts without.
    """

    tunable = ("rate", "lift", "weight", "cutoff")

    rate: float | Array
    lift: Array
    weight: Array | float | None = None
    cutoff: float = 20.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self.cutoff)
        object.__setattr__(self, "rate", checked_rate(self.rate))
        object.__setattr__(self, "lift", frozen_array(self.lift, (np.size(self.lift),), "consistent lift: lift"))
        if self.weight is not None:
            positive_per_joint(self.weight, np.size(self.weight), "consistent lift: weight")

    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """Raise `InputError` unless the lift (P,) is physically consistent and K lift is the first estimate, to 1e-9 of
        its largest entry, and rates, weight, and cutoff times period of at most 1 fit the model.

        `initial` is the first estimate (k,), `period` the control period T_c in s.
        """
        P = len(model.mechanism.parameter_names)
        if len(self.lift) != P:
            raise InputError(f"consistent lift: lift: expected all {P} parameters, got {len(self.lift)}")
        require_rates(self.rate, model)
        require_consistent(model, self.lift, "consistent lift", "the lift")
        self._require_first(model, initial)
        if self.weight is not None:
            positive_per_joint(self.weight, model.mechanism.dof, "consistent lift: weight")
            require_cutoff(self.cutoff, period)

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> LiftMemory:
        """The memory before the first tick: the first lift (P,), and the filters at rest where torques are predicted.

        `initial` is the first estimate (k,), q (n,) the configuration of the tree's joints in rad (m), v (r,) the
        velocities in rad/s (m/s), `period` T_c in s.
        """
        filtered = NoMemory() if self.weight is None else TorqueFilter(self.cutoff, period).start(model, q, v)
        return LiftMemory(np.array(self.lift), filtered)

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: LiftMemory
    ) -> tuple[Column, LiftMemory]:
        """The estimate (k,), K D of a lift D after a step for the tracking error, then one for the prediction error,
        along geodesics; and the memory with D (P,).

        `estimate` (k,), in the parameters' SI units, and `memory` are those before the control period `period`.
        """
        rates, bodies = each_rate(self.rate, model), len(model.mechanism.description.bodies)

        def stepped(lift: Column, slope: Column) -> Column:
            return moved_bodies(lift, rates * _lifted(model, slope), bodies)

        lift, filtered = stepped(memory.lift, period.gradient(period.integral)), memory.filtered
        if self.weight is not None:
            rows, torque, filtered = TorqueFilter(self.cutoff, period.length).predicted(model, period, memory.filtered)
            loaded = [_lowered(model, raised_slope(lift, rates * _lifted(model, row), bodies)) for row in rows]
            firm = [1.0 / (weight * period.length) for weight in each(self.weight, model.mechanism.dof)]
            products = [[row @ other for other in loaded] for row in rows]
            for i, variance in enumerate(firm):
                products[i][i] = products[i][i] + variance
            force = solve_symmetric(products, residual(rows, _lowered(model, lift), torque))
            lift = stepped(lift, period.share * combined(rows, force))
        return _lowered(model, lift), LiftMemory(lift, filtered)

    def _require_first(self, model: ReducedModel, initial: Array) -> None:
        first = model.regrouping @ self.lift
        wrong = np.flatnonzero(~(np.abs(first - initial) <= NEAR * np.abs(first).max()))
        if wrong.size:
            j = int(wrong[0])
            raise InputError(
                f"consistent lift: the first estimate is not the lift's: {model.names[j]} is {initial[j]:g}, and "
                f"{first[j]:g} with the lift: start from initial=model.regrouping @ lift; "
                "adaptctl.identifiability.nearest_consistent finds the lift nearest to an estimate"
            )


def _lifted(model: ReducedModel, slope: Column) -> Column:
    """Slope (P,) on the lift of a slope (k,): K' slope."""
    return _product(model.regrouping.T, slope)


def _lowered(model: ReducedModel, lift: Column) -> Column:
    """Fundamental parameters (k,) of a lift: K lift."""
    return _product(model.regrouping, lift)


def _product(matrix: ArrayLike, column: Column) -> Column:
    """A constant matrix times a column, its zeros left out."""
    entries = []
    for row in np.asarray(matrix):
        kept = np.flatnonzero(row).tolist()
        parts = [column[j] if row[j] == 1.0 else float(row[j]) * column[j] for j in kept]
        entries.append(sum(parts[1:], parts[0]) if parts else 0.0)
    return Column(entries)
