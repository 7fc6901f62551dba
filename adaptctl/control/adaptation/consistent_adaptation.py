"""Adaptation of fundamental parameters that rigid bodies have at every tick: natural adaptation of a lift of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.control.adaptation.composite import TorqueFilter, residual, validate_filter, validate_predicted
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.control.adaptation.natural import (
    checked_rate,
    each_rate,
    moved_bodies,
    raised_slope,
    validate_consistent,
    validate_rates,
    validate_whole_links,
)
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, each
from adaptctl.scalars.column import combined

NEAR = 1e-9
"""of the largest fundamental parameter: the initial estimate is the lift's, to round-off"""


class ConsistentState(NamedTuple):
    """Internal state, between control periods, of an adaptation law that moves a lift: `lift` (P,) are all P parameters
    of rigid bodies and drives, in SI units and the order of `Mechanism.parameter_names`, whose fundamental (base)
    parameters are the estimate; `filtered` is the torque filters' internal state, empty where no torques are predicted.
    Nothing is checked."""

    lift: Any
    filtered: Any

    @property
    def logged_state(self) -> Any:
        """The lift (P,): all P parameters of rigid bodies and drives, in SI units and the order of
        `Mechanism.parameter_names`, whose fundamental (base) parameters are the estimate. It is the field `lift`, the
        part of this internal state that is stored with each sample of a recorded run."""
        return self.lift


@dataclass(frozen=True, eq=False)
class ConsistentAdaptation(AdaptationLaw[ConsistentState]):
    """Natural adaptation of a physically consistent adaptation D (P,) of the estimate (k,) (Lee, Kwon and Park 2018): D
    are all P parameters of rigid bodies and drives, and the estimate their k fundamental (base) parameters.

    estimate = K D, where D moves by natural adaptation, the gradient in the affine-invariant metric of pseudo-inertias,
    along the slope K'(Y' s + W'R (W estimate - F[tau])). K (k, P) is the model's attribute `regrouping`, Y (r, k) the
    torque regressor on the k fundamental parameters alone, W (r, k) that behind the filter F = cutoff/(d/dt + cutoff),
    s (r,) the sliding variable of r joints in rad/s (m/s for a prismatic joint), tau (r,) the torque in N m (N). A
    prime is the transpose.

    `lift` (P,) is the initial D, physically consistent, in SI units (kg, kg m, kg m^2); the initial estimate is K lift.
    `rate` is the rate of adaptation in 1/J: one number, or one for each link with a body and then one for each drive's
    parameter. With a `weight` R in 1/(N m s) (m/(N s)), one number or (r,), the estimate also follows the prediction
    error of the filtered torques, with the filter's `cutoff` in rad/s, 20 by default; with None, the default, it does
    not, and W and F have no part. Raises `InputError` at construction for a rate, weight or cutoff that is not positive
    and finite (`NonFiniteError` for a weight of NaN), a lift that is not finite and wrong shapes, and, with a
    controller, for sizes that do not fit the model, linear constraints on parameters that leave some of a body's ten
    not free, a lift that is not consistent or not the initial estimate's, and, with a weight, constraints that fix
    drives' parameters at values other than zero and a cutoff above 1/T_c, T_c the control period.

    Guarantees, without disturbance: V = s'Ms/2 + sum_i d(P_i true, P_i)/rate_i has the time derivative -s'K_d s - eps'R
    eps, M the mass matrix, K_d (r,) the control law's damping, P_i a link's pseudo-inertia (4, 4) or a drive's
    parameter, d(A, B) = log(det B/det A) + tr(B^-1 A) - 4 (- 1 for a drive's parameter), eps = W error, error the
    estimate less the truth. Without a weight it is, in every control period, the controller of `Natural` on all P
    parameters, with only k columns of the regressor computed. And whatever disturbs: the estimate is K D of bodies with
    positive definite pseudo-inertias, so that the estimate's mass matrix is positive definite everywhere. Sampled, the
    step for the prediction error is solved implicitly in the metric at the D before it.

    Gives up: convergence of D itself, of which only K D is seen: of all D with K D equal to the estimate it finds the
    one nearest to the initial D, by the divergence d. It starts from consistent parameters, and a link that starts
    almost without some moment hardly finds it.
    """

    tunable = ("gain", "lift", "prediction_weight", "cutoff")

    gain: float | Array
    lift: Array
    prediction_weight: Array | float | None = None
    cutoff: float = 20.0

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "gain", checked_rate(self.gain))
        object.__setattr__(self, "lift", frozen_array(self.lift, (np.size(self.lift),), "consistent adaptation: lift"))
        validate_filter(
            "consistent adaptation", 1.0 if self.prediction_weight is None else self.prediction_weight, self.cutoff
        )

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` unless the adaptation law fits the `model`, of k fundamental (base) parameters and r
        joints, the initial estimate `initial` (k,), in SI units, and the control `period` T_c (s). Required are:

        a physically consistent initial lift, the law's attribute `lift` (P,) of all P parameters of bodies and drives,
        whose fundamental parameters are `initial`, to 1e-9 of the largest of them; one rate, or one for each link with
        a body and each drive's parameter; and linear constraints on parameters, if any, that leave all ten of each body
        free. With a weight of prediction errors, also one such weight or one for each joint, a cutoff of the torque
        filter (rad/s) of at most 1/T_c, and no constraint that fixes a drive's parameter at a value other than zero.
        The controller, not this method, checks that T_c is positive.
        """
        validate_whole_links(model, "consistent adaptation")
        P = len(model.mechanism.parameter_names)
        if len(self.lift) != P:
            raise InputError(f"consistent adaptation: lift: expected all {P} parameters, got {len(self.lift)}")
        validate_rates(self.gain, model)
        validate_consistent(model, self.lift, "consistent adaptation", "the lift")
        self._validate_first(model, initial)
        if self.prediction_weight is not None:
            validate_predicted("consistent adaptation", model, self.prediction_weight, self.cutoff, control_period)

    def initial_state(
        self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float
    ) -> ConsistentState:
        """The internal state before the first control period: the initial lift (P,), a copy of the law's attribute
        `lift`, and the torque filters. The lift are all P parameters of rigid bodies and drives, in SI units, whose k
        fundamental (base) parameters are the estimate. With a weight of prediction errors the torque filters' output is
        zero; without one there are no filters.

        `initial`, the initial estimate (k,), is not looked at; q (..., n) are the positions of the spanning tree's n
        joints in rad (m for a prismatic joint), v (..., r) the velocities of the r primary (independent) joints in
        rad/s (m/s), `period` the control period in s. Leading axes are arms: the filters' field `regressor` then has
        them too, all else is the same for all arms. With a weight, raises `InputError` for a `model` whose linear
        constraints fix parameters at values other than zero; nothing else is checked.
        """
        filtered = (
            NoMemory()
            if self.prediction_weight is None
            else TorqueFilter(self.cutoff, control_period).start(model, q, v)
        )
        return ConsistentState(np.array(self.lift), filtered)

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: ConsistentState
    ) -> tuple[Column, ConsistentState]:
        """The estimate (k,) of the model's k fundamental (base) parameters, in their SI units, and the internal state
        after a control period. The estimate is regrouped from the lift (P,), all P parameters of bodies and drives,
        which is moved: a step along geodesics of pseudo-inertias for the tracking error and, with a weight, then one
        for the prediction error.

        `estimate` (k,), which is not looked at, and `memory`, the lift (P,) in SI units and the torque filters, are
        those before the control period that `period` describes. Nothing is checked here.
        """
        rates, bodies = each_rate(self.gain, model), len(model.mechanism.description.bodies)

        def stepped(lift: Column, slope: Column) -> Column:
            return moved_bodies(lift, rates * _lifted(model, slope), bodies)

        lift, filtered = stepped(memory.lift, period.gradient(period.integral)), memory.filtered
        if self.prediction_weight is not None:
            rows, torque, filtered = TorqueFilter(self.cutoff, period.period).predicted(model, period, memory.filtered)
            loaded = [_lowered(model, raised_slope(lift, rates * _lifted(model, row), bodies)) for row in rows]
            firm = [1.0 / (weight * period.period) for weight in each(self.prediction_weight, model.mechanism.dof)]
            products = [[row @ other for other in loaded] for row in rows]
            for i, variance in enumerate(firm):
                products[i][i] = products[i][i] + variance
            force = solve_symmetric(products, residual(rows, _lowered(model, lift), torque))
            lift = stepped(lift, period.dt_ratio * combined(rows, force))
        return _lowered(model, lift), ConsistentState(lift, filtered)

    def _validate_first(self, model: ReducedModel, initial: Array) -> None:
        first = model.regrouping @ self.lift
        wrong = np.flatnonzero(~(np.abs(first - initial) <= NEAR * np.abs(first).max()))
        if wrong.size:
            j = int(wrong[0])
            raise InputError(
                f"consistent adaptation: the first estimate is not the lift's: {model.names[j]} is {initial[j]:g}, and "
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
