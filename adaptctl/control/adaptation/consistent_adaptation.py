"""Physically consistent adaptation of fundamental parameters."""

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

LIFT_TOLERANCE = 1e-9  # of the largest fundamental parameter: round-off of the regrouping


class ConsistentState(NamedTuple):
    """Lift (P,) and torque filters, empty without prediction."""

    lift: Any
    filtered: Any

    @property
    def logged_state(self) -> Any:
        """Lift (P,)."""
        return self.lift


@dataclass(frozen=True, eq=False)
class ConsistentAdaptation(AdaptationLaw[ConsistentState]):
    r"""
    Adaptation of base parameters that stays physically consistent (natural adaptation of all bodies).

    Parameters
    ----------
    gain : array_like
        Rate of adaptation in 1/J, one number, or one for each link with inertia and then one for each drive parameter.
    lift : array_like
        Initial values (P,) of all inertial and drive parameters in SI units, physically consistent. The initial
        estimate of the k base parameters is `model.regrouping @ lift`.
    prediction_weight : array_like, optional
        Weight R of the torque prediction error in 1/(N m s) (m/(N s)), one number or (r,). Default: None, the
        prediction error is not used.
    cutoff : float, default 20.0
        Corner frequency in rad/s of the low-pass filter of torques and regressor. 20 is about as fast as an arm moves;
        a higher one lets more noise in.

    Raises
    ------
    InputError
        If a number is not positive, a shape is wrong, `lift` is not physically consistent or does not give the initial
        estimate, or linear constraints eliminate parameters of bodies.
    NonFiniteError
        If a weight is NaN.

    Notes
    -----
    The parameters D of all bodies move by `Natural` [1]_ along :math:`K^\top(Y^\top s+W^\top R(W\hat\beta-F[\tau]))`, K
    the regrouping matrix. The mass matrix of KD is always positive definite.

    References
    ----------
    .. [1] Lee, Kwon and Park, IROS, 2018.

    Examples
    --------
    >>> lift = np.tile([2.0, -0.2, 0.0, 0.0, 0.1, 0.0, 0.2, 0.0, 0.0, 0.2], 2)
    >>> consistent = adaptctl.control.ConsistentAdaptation(gain=0.1, lift=lift)
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, consistent, initial=model.regrouping @ lift)
    >>> controller.init(p, v).law_state.lift.shape
    (20,)
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
        """
        Raise an error if the law does not fit the model, the initial estimate and the control period.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters and r primary joints.
        initial : ndarray
            Initial estimate (k,) in SI units.
        control_period : float
            Control period in s.

        Raises
        ------
        InputError
            If a size is wrong, the cutoff is too high for the control period, `lift` is not physically consistent or
            does not give the initial estimate (to 1e-9), or linear constraints eliminate parameters of bodies.
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
        """
        Return the initial parameters of all bodies, and torque filters of zero.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        initial : ndarray
            Initial estimate (k,) in SI units.
        q, v : ndarray
            Positions (..., n) in rad (m) of the n joints of the spanning tree, and velocities (..., r) of the primary
            joints in rad/s (m/s).
        control_period : float
            Control period in s.

        Returns
        -------
        ConsistentState
            Internal state of the law. Leading axes of q are arms; a part that does not depend on q is without them.

        Raises
        ------
        InputError
            If linear constraints fix parameters of the model at values other than zero.
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
        """
        Update the parameters of all bodies along geodesics, and regroup them into the estimate.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : Column
            Estimate (k,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : ConsistentState
            Internal state before the period.

        Returns
        -------
        tuple of Column and ConsistentState
            Estimate (k,) in SI units and internal state after the period.
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
        wrong = np.flatnonzero(~(np.abs(first - initial) <= LIFT_TOLERANCE * np.abs(first).max()))
        if wrong.size:
            j = int(wrong[0])
            raise InputError(
                f"consistent adaptation: the initial estimate does not match the lift: {model.names[j]} is "
                f"{initial[j]:g}, but {first[j]:g} by the lift. Pass initial=model.regrouping @ lift; "
                "adaptctl.identifiability.nearest_consistent finds the nearest lift of an estimate"
            )


def _lifted(model: ReducedModel, slope: Column) -> Column:
    """Slope (P,) of a slope (k,)."""
    return _product(model.regrouping.T, slope)


def _lowered(model: ReducedModel, lift: Column) -> Column:
    """Fundamental parameters (k,)."""
    return _product(model.regrouping, lift)


def _product(matrix: ArrayLike, column: Column) -> Column:
    """Constant matrix times a column."""
    entries = []
    for row in np.asarray(matrix):
        kept = np.flatnonzero(row).tolist()
        parts = [column[j] if row[j] == 1.0 else float(row[j]) * column[j] for j in kept]
        entries.append(sum(parts[1:], parts[0]) if parts else 0.0)
    return Column(entries)
