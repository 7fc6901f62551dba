"""Least squares with forgetting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from adaptctl.arrays import Array, finite_number, frozen_array, numbers
from adaptctl.control.adaptation.composite import Filtered, TorqueFilter, residual, validate_filter, validate_predicted
from adaptctl.control.adaptation.gradient import validate_size
from adaptctl.control.adaptation.law import AdaptationLaw, Period
from adaptctl.control.adaptation.symmetric import (
    Equation,
    directional_update,
    first_triangle,
    from_triangle,
    rank_update,
    scaled,
    solve,
    symmetric_product,
    symmetric_trace,
)
from adaptctl.control.pytree import Memory
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column, each, sqrt


@dataclass(frozen=True, eq=False)
class ForgettingLeastSquares(AdaptationLaw[Memory]):
    """Base class of least squares with forgetting."""

    called: ClassVar[str]

    gain: Array
    prediction_weight: Array = 1.0  # type: ignore[assignment]  # a number becomes an array for the model's joints
    cutoff: float = 20.0
    forgetting: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if (gain := numbers(self.gain, f"{self.called}: gain", "(k,)")).ndim != 1 or not gain.size:
            raise InputError(f"{self.called}: gain: expected Gamma's diagonal (k,), got shape {gain.shape}")
        gain = frozen_array(gain, gain.shape, f"{self.called}: gain")
        if np.any(gain <= 0.0):
            raise InputError(f"{self.called}: gain: expected positive numbers (k,)")
        object.__setattr__(self, "gain", gain)
        validate_filter(self.called, self.prediction_weight, self.cutoff)
        finite_number(self.forgetting, f"{self.called}: forgetting")

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
        validate_size(self.gain, model, f"{self.called}: gain")
        validate_predicted(self.called, model, self.prediction_weight, self.cutoff, control_period)

    @property
    def _scale(self) -> Column:
        """Root (k,) of the initial gain."""
        return Column(map(sqrt, column(self.gain)))


class CovarianceMemory(NamedTuple):
    """Covariance in units of the initial gain, and filters."""

    covariance: Any
    filtered: Filtered


@dataclass(frozen=True, eq=False)
class BoundedGainForgetting(ForgettingLeastSquares[CovarianceMemory]):
    r"""
    Least squares with one forgetting rate and a bounded gain.

    Parameters
    ----------
    gain : array_like
        Diagonal (k,) of the initial gain Gamma, in units of the parameters squared per J.
    prediction_weight : array_like, default 1.0
        Weight R of the torque prediction error in 1/(N m s) (m/(N s)), one number or (r,). At 1 an error of 1 N m moves
        the estimate as much as s = 1 rad/s does.
    cutoff : float, default 20.0
        Corner frequency in rad/s of the low-pass filter of torques and regressor. 20 is about as fast as an arm moves;
        a higher one lets more noise in.
    forgetting : float, default 1.0
        Largest rate of forgetting in 1/s, at most 0.1 divided by the control period. At 1 the past fades with a time
        constant of 1 s.
    bound : float, default 2.0
        Bound of the mean gain, tr(Gamma^-1 P)/k without a unit, at least 1. At 2 the mean gain at most doubles without
        excitation.

    Raises
    ------
    InputError
        If a number is out of range or a shape is wrong.
    NonFiniteError
        If a weight is NaN.

    Notes
    -----
    .. math::

        \dot{\hat\beta}=-P\bigl(Y^\top s+W^\top R(W\hat\beta-F[\tau])\bigr),\quad \dot P=\lambda P-PW^\top RWP,\quad
        \lambda=\lambda_0\bigl(1-\operatorname{tr}(\Gamma^{-1}P)/(k\,\text{bound})\bigr).

    Errors converge as with `Composite` [1]_. Use `CushionedFloor` for parameters that change.

    References
    ----------
    .. [1] Slotine and Li, Automatica, 1989.

    Examples
    --------
    >>> least_squares = adaptctl.control.BoundedGainForgetting(np.full(6, 0.1))
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, least_squares)
    >>> least_squares.covariance(controller.init(p, v).law_state).diagonal()
    array([0.1, 0.1, 0.1, 0.1, 0.1, 0.1])
    """

    tunable = ("gain", "prediction_weight", "cutoff", "forgetting", "bound")
    needs_double = True

    called: ClassVar[str] = "bounded-gain forgetting"

    bound: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        finite_number(self.bound, f"{self.called}: bound", 1.0)

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
            If a size is wrong, the cutoff or the forgetting is too high for the control period, or linear constraints
            fix parameters at values other than zero.
        """
        super().validate(model, initial, control_period)
        if self.forgetting * control_period > 0.1:
            raise InputError(
                f"{self.called}: forgetting: {self.forgetting:g} 1/s is too fast for a control period of "
                f"{control_period:g} s; use at most {0.1 / control_period:g} 1/s"
            )

    def initial_state(
        self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float
    ) -> CovarianceMemory:
        """
        Return the initial state, the covariance Gamma and torque filters of zero.

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
        CovarianceMemory
            Internal state of the law. Leading axes of q are arms; a part that does not depend on q is without them.

        Raises
        ------
        InputError
            If linear constraints fix parameters of the model at values other than zero.
        """
        filtered = TorqueFilter(self.cutoff, control_period).start(model, q, v)
        return CovarianceMemory(first_triangle(self.gain.shape[-1]), filtered)

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: CovarianceMemory
    ) -> tuple[Column, CovarianceMemory]:
        """
        Update the estimate by the tracking and prediction errors, and the covariance with forgetting.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : Column
            Estimate (k,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : CovarianceMemory
            Internal state before the period.

        Returns
        -------
        tuple of Column and CovarianceMemory
            Estimate (k,) in SI units and internal state after the period.
        """
        covariance, scale = memory.covariance, self._scale
        gradient = scale * period.gradient(period.integral)
        rows, torque, filtered = TorqueFilter(self.cutoff, period.period).predicted(model, period, memory.filtered)
        weights = each(self.prediction_weight, model.mechanism.dof)
        equations = [
            Equation(scale * row, period.dt_ratio, 1.0 / (weight * period.period), target=-miss)
            for row, weight, miss in zip(rows, weights, residual(rows, estimate, torque), strict=True)
        ]
        covariance, step = directional_update(covariance, -symmetric_product(covariance, gradient), equations)
        rate = self.forgetting * (
            1.0 - symmetric_trace(covariance, len(estimate)) * (1.0 / (self.bound * len(estimate)))
        )
        return estimate + scale * step, CovarianceMemory(scaled(covariance, 1.0 + period.dt * rate), filtered)

    def covariance(self, memory: CovarianceMemory) -> Array:
        """
        Return the present adaptation gain.

        Parameters
        ----------
        memory : CovarianceMemory
            Internal state of one arm.

        Returns
        -------
        ndarray
            Covariance P (k, k) in units of the parameters squared per J.

        Raises
        ------
        ValueError
            If the state is of several arms.
        """
        scale = np.sqrt(self.gain)
        return from_triangle(memory.covariance, len(self.gain)) * np.outer(scale, scale)


class InformationMemory(NamedTuple):
    """Information in units of the initial gain's inverse, and filters."""

    information: Any
    filtered: Filtered


@dataclass(frozen=True, eq=False)
class CushionedFloor(ForgettingLeastSquares[InformationMemory]):
    r"""
    Least squares with directional forgetting and a lower bound of the information.

    Parameters
    ----------
    gain : array_like
        Diagonal (k,) of the initial gain Gamma, in units of the parameters squared per J.
    prediction_weight : array_like, default 1.0
        Weight R of the torque prediction error in 1/(N m s) (m/(N s)), one number or (r,). At 1 an error of 1 N m moves
        the estimate as much as s = 1 rad/s does.
    cutoff : float, default 20.0
        Corner frequency in rad/s of the low-pass filter of torques and regressor. 20 is about as fast as an arm moves;
        a higher one lets more noise in.
    forgetting : float, default 1.0
        Rate lambda of forgetting in 1/s. At 1 the past fades with a time constant of 1 s.

    Raises
    ------
    InputError
        If a number is out of range or a shape is wrong.
    NonFiniteError
        If a weight is NaN.

    Notes
    -----
    .. math::

        \dot{\hat\beta}=-P\bigl(Y^\top s+W^\top R(W\hat\beta-F[\tau])\bigr),\quad
        \dot{(P^{-1})}=-\lambda(P^{-1}-\Gamma^{-1})+W^\top RW.

    Errors converge as with `Composite` [1]_. Directions not excited keep the gain :math:`\Gamma`.

    References
    ----------
    .. [1] Slotine and Li, Automatica, 1989.

    Examples
    --------
    >>> floor = adaptctl.control.CushionedFloor(np.full(6, 0.1), forgetting=2.0)
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, floor)
    >>> floor.covariance(controller.init(p, v).law_state).shape
    (6, 6)
    """

    tunable = ("gain", "prediction_weight", "cutoff", "forgetting")

    called: ClassVar[str] = "cushioned floor"

    def initial_state(
        self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float
    ) -> InformationMemory:
        """
        Return the initial state, the information of the initial gain and torque filters of zero.

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
        InformationMemory
            Internal state of the law. Leading axes of q are arms; a part that does not depend on q is without them.

        Raises
        ------
        InputError
            If linear constraints fix parameters of the model at values other than zero.
        """
        filtered = TorqueFilter(self.cutoff, control_period).start(model, q, v)
        return InformationMemory(first_triangle(self.gain.shape[-1]), filtered)

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: InformationMemory
    ) -> tuple[Column, InformationMemory]:
        """
        Update the information with forgetting, and the estimate by a gradient step.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : Column
            Estimate (k,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : InformationMemory
            Internal state before the period.

        Returns
        -------
        tuple of Column and InformationMemory
            Estimate (k,) in SI units and internal state after the period.
        """
        rows, torque, filtered = TorqueFilter(self.cutoff, period.period).predicted(model, period, memory.filtered)
        units = [self._scale * row for row in rows]
        weights = period.dt * each(self.prediction_weight, model.mechanism.dof)
        share = self.forgetting * period.dt
        information = rank_update(memory.information, units, weights, 1.0 / (1.0 + share), share)
        slope = self._scale * period.gradient(period.integral)
        for row, weight, miss in zip(units, weights, residual(rows, estimate, torque), strict=True):
            slope = slope + (weight * miss) * row
        step = solve(information, slope)
        return estimate - self._scale * step, InformationMemory(information, filtered)

    def covariance(self, memory: InformationMemory) -> Array:
        """
        Return the present adaptation gain.

        Parameters
        ----------
        memory : InformationMemory
            Internal state of one arm.

        Returns
        -------
        ndarray
            Covariance P (k, k) in units of the parameters squared per J.

        Raises
        ------
        ValueError
            If the state is of several arms.
        """
        scale = np.sqrt(self.gain)
        return np.asarray(np.linalg.inv(from_triangle(memory.information, len(self.gain))) * np.outer(scale, scale))
