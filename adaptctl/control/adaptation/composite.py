"""Composite adaptation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_number, positive_numbers, positive_per_joint, stacked
from adaptctl.compilation import trace
from adaptctl.control.adaptation.gradient import Descent
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.low_pass import washed_out
from adaptctl.dynamics.recursion.energy import momentum_terms
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, Structure, column, each, spread
from adaptctl.scalars.column import combined


class Filtered(NamedTuple):
    """State of the torque filters: nonzero regressor entries (e,) and torques (r,)."""

    regressor: Any
    torque: Any


class Prediction(NamedTuple):
    """Filtered regressor by rows, filtered torques (r,), and the filters' next state."""

    rows: list[Column]
    torque: Column
    after: Filtered


@dataclass(frozen=True)
class TorqueFilter:
    """Low-pass filter of the equations of motion without accelerations (Slotine and Li 1989)."""

    cutoff: float
    control_period: float

    def start(self, model: ReducedModel, q: Array | Column, v: Array | Column) -> Filtered:
        """Initial state, with zero output."""
        momentum, forces = momentum_terms(model.mechanism.equations, column(q), column(v), model.columns)
        _, new, _ = self._weights
        scaled = self.cutoff * nonzero(momentum, model)
        first = scaled - new * (scaled + nonzero(forces, model))
        entries = first if isinstance(q, Column) else stacked(first.of, q.shape[:-1])
        return Filtered(entries, np.zeros(model.mechanism.dof))

    def predicted(self, model: ReducedModel, period: Period, memory: Filtered, v_f: Column | None = None) -> Prediction:
        """Prediction at the end of a control period, with friction at v_f, or at the velocities."""
        momentum, forces = momentum_terms(model.mechanism.equations, period.q, period.v, model.columns, v_f)
        x, rate, (keep, new, old) = nonzero(momentum, model), nonzero(forces, model), self._weights
        found, after = washed_out(x, rate, memory.regressor, (self.cutoff, keep, new, old))
        torque = keep * memory.torque + (1.0 - keep) * period.torque
        return Prediction(spread_rows(found, model), torque, Filtered(after, torque))

    @property
    def _weights(self) -> tuple[Any, Any, Any]:
        """Weights of what was, and of a linear input's values at the end and at the start."""
        keep, mean = decayed(self.cutoff * self.control_period)
        return keep, 1.0 - mean, 1.0 - keep - (1.0 - mean)


def decayed(x: Any) -> tuple[Any, Any]:
    """exp(-x) and (1 - exp(-x))/x, 0 < x <= 1, by a Pade approximant."""
    y = 0.25 * x
    square = y * y
    odd = 15120.0 + square * (420.0 + square)
    even = 30240.0 + square * (3360.0 + 30.0 * square)
    below = 1.0 / (even + y * odd)
    left, mean = (even - y * odd) * below, (2.0 * odd) * below
    for _ in range(2):
        left, mean = left * left, (0.5 * mean) * (1.0 + left)
    return left, mean


def nonzero(rows: Sequence[Column], model: ReducedModel) -> Column:
    """Entries (e,) of a filtered regressor's rows that are not always zero."""
    return Column(row[j] for row, places in zip(rows, momentum_columns(model), strict=True) for j in places)


def spread_rows(entries: Column, model: ReducedModel) -> list[Column]:
    """Rows (r, k) of a filtered regressor of its entries (e,)."""
    rest, k = iter(entries), len(model.columns)
    return [spread(Column(next(rest) for _ in places), places, k) for places in momentum_columns(model)]


def momentum_columns(model: ReducedModel) -> list[list[int]]:
    """Indices of the parameters in each joint's filtered torque."""
    return _momentum_columns(model.structure)


@lru_cache(maxsize=64)
def _momentum_columns(structure: Structure) -> list[list[int]]:
    model: ReducedModel = structure.of
    equations, r = model.mechanism.equations, model.mechanism.dof

    def terms(q: Column, v: Column) -> list[Column]:
        return [row + change for row, change in zip(*momentum_terms(equations, q, v, model.columns), strict=True)]

    k, entries = len(model.columns), trace(terms, {"q": equations.num_joints, "v": r}).outputs
    always_zero = [isinstance(x, float) and x == 0.0 for x in entries]
    return [[j for j in range(k) if not always_zero[k * i + j]] for i in range(r)]


def validate_filter(law: str, weight: ArrayLike, cutoff: float) -> None:
    """Raise `InputError` unless prediction weight and cut-off frequency are positive."""
    positive_number(cutoff, "torque filter: cutoff: expected a positive number in rad/s")
    positive_numbers(weight, f"{law}: prediction_weight")


def validate_cutoff(cutoff: float, control_period: float, what: str = "torque filter") -> None:
    """Raise `InputError` unless a filter's cut-off frequency fits the control period."""
    positive_number(cutoff, f"{what}: cutoff: expected a positive number in rad/s")
    if cutoff * control_period > 1.0:
        raise InputError(
            f"{what}: cutoff: {cutoff:g} rad/s is too fast for a control period of {control_period:g} s; "
            f"use at most {1.0 / control_period:g} rad/s"
        )


def validate_predicted(law: str, model: ReducedModel, weight: ArrayLike, cutoff: float, control_period: float) -> None:
    """
    Raise an error unless an adaptation law can predict torques with the given settings.

    Parameters
    ----------
    law : str
        Name of the law in messages.
    model : ReducedModel
        Model with k parameters and r joints.
    weight : array_like
        Prediction weights in 1/((N m)^2 s), one number or one per joint (r,), above 0.
    cutoff : float
        Cutoff of the torque filter in 1/s, above 0 and below its limit for the control period.
    control_period : float
        Control period T_c in s.

    Raises
    ------
    InputError
        If a number is out of range, or constraints fix parameters at values other than zero.

    Examples
    --------
    >>> from adaptctl.control.adaptation.composite import validate_predicted
    >>> validate_predicted("my law", model, [1.0, 1.0], cutoff=20.0, control_period=period)
    """
    mechanism = model.mechanism
    positive_per_joint(weight, mechanism.dof, f"{law}: prediction_weight")
    validate_cutoff(cutoff, control_period)
    if mechanism.equations.has_constraint_bias:
        fixed = mechanism.with_parameters(np.zeros(len(mechanism.parameter_names))).description
        pairs = zip(fixed.parameter_names, fixed.inertial_parameters.tolist(), strict=True)
        raise InputError(
            f"{law}: {mechanism.name}: constraints fix values other than zero, with which torques cannot be predicted "
            f"without accelerations: {', '.join(f'{name} ({value:g})' for name, value in pairs if value)}. Remove "
            "these constraints, or adapt only with the tracking error, like Gradient"
        )


@dataclass(frozen=True, eq=False)
class Composite(Descent[Filtered]):
    r"""
    Gradient adaptation by the tracking error and the torque prediction error.

    Parameters
    ----------
    gain : array_like
        Adaptation gain Gamma, its diagonal (k,) or the whole matrix (k, k), in units of the parameters squared per J.
    prediction_weight : array_like, default 1.0
        Weight R of the torque prediction error in 1/(N m s) (m/(N s)), one number or (r,). At 1 an error of 1 N m moves
        the estimate as much as s = 1 rad/s does.
    cutoff : float, default 20.0
        Corner frequency in rad/s of the low-pass filter of torques and regressor. 20 is about as fast as an arm moves;
        a higher one lets more noise in.

    Raises
    ------
    InputError
        If the gain is not positive definite, weight or cutoff is not positive, the cutoff exceeds 1 divided by the
        control period, or linear constraints fix parameters at values other than zero.
    NonFiniteError
        If a weight is NaN.

    Notes
    -----
    .. math:: \dot{\hat\beta}=-\Gamma\bigl(Y^\top s+W^\top R(W\hat\beta-F[\tau])\bigr),

    with filtered torques and their regressor W. Errors converge to zero, estimates under persistent excitation [1]_.

    References
    ----------
    .. [1] Slotine and Li, Automatica, 1989.

    Examples
    --------
    >>> composite = adaptctl.control.Composite(np.full(6, 0.1), prediction_weight=0.5)
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, composite)
    >>> controller.init(p, v).law_state.torque
    array([0., 0.])
    """

    tunable = ("gain", "prediction_weight", "cutoff")

    prediction_weight: Array = 1.0  # type: ignore[assignment]  # a number becomes an array for the model's joints
    cutoff: float = 20.0

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_filter("composite", self.prediction_weight, self.cutoff)

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """
        Raise an error if the law does not fit the model and the control period.

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
            If a size is wrong, the cutoff is too high for the control period, or linear constraints fix parameters at
            values other than zero.
        """
        super().validate(model, initial, control_period)
        validate_predicted("composite", model, self.prediction_weight, self.cutoff, control_period)

    def initial_state(self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float) -> Filtered:
        """
        Return the initial state, torque filters with zero output.

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
        Filtered
            Internal state of the law. Leading axes of q are arms; a part that does not depend on q is without them.

        Raises
        ------
        InputError
            If linear constraints fix parameters of the model at values other than zero.
        """
        return TorqueFilter(self.cutoff, control_period).start(model, q, v)

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Filtered) -> tuple[Column, Filtered]:
        """
        Update the estimate by a gradient step of the tracking error and an implicit step of the prediction error.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : Column
            Estimate (k,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : Filtered
            Internal state before the period.

        Returns
        -------
        tuple of Column and Filtered
            Estimate (k,) in SI units and internal state after the period.
        """
        moved = estimate - self.applied(period.gradient(period.integral))
        rows, torque, after = TorqueFilter(self.cutoff, period.period).predicted(model, period, memory)
        loaded = [self.applied(row) for row in rows]
        firm = Column(1.0 / (weight * period.period) for weight in each(self.prediction_weight, model.mechanism.dof))
        force = solve_symmetric(_products(rows, loaded, firm), residual(rows, moved, torque))
        return moved - period.dt_ratio * combined(loaded, force), after


def residual(rows: list[Column], estimate: Column, torque: Column) -> Column:
    """Predicted minus filtered torques (r,)."""
    return Column(row @ estimate for row in rows) - torque


def _products(rows: list[Column], loaded: list[Column], firm: Column) -> list[list[Scalar]]:
    r = len(rows)
    lower = [[rows[i] @ loaded[j] for j in range(i + 1)] for i in range(r)]
    for i in range(r):
        lower[i][i] = lower[i][i] + firm[i]
    return [[lower[max(i, j)][min(i, j)] for j in range(r)] for i in range(r)]
