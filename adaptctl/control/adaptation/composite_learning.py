"""Composite learning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from adaptctl.arrays import Array, finite_number
from adaptctl.control.adaptation.composite import Filtered, TorqueFilter, residual
from adaptctl.control.adaptation.gradient import MIN_POWER
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.recall import RecallingLeastSquares
from adaptctl.control.adaptation.symmetric import Equation, directional_update, from_triangle, solve
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, each, maximum, sqrt, where


class LearningMemory(NamedTuple):
    """Information and z in units of the initial gain, joints learned from, torque filters."""

    information: Any
    known: Any
    learned: Any
    filtered: Filtered

    @property
    def logged_state(self) -> Any:
        """Number (1,) of joints learned from in the last period."""
        return self.learned


@dataclass(frozen=True, eq=False)
class CompositeLearning(RecallingLeastSquares[LearningMemory]):
    r"""
    Least squares with stored information and directional forgetting.

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
        Rate in 1/s at which the past is forgotten along directions that are excited now. At 1 the time constant is 1 s.
    recall : float, default 2.0
        Rate rho in 1/s of convergence to the stored information, at most 0.5 divided by the control period. By default
        twice the rate of forgetting: information is used before it fades.
    excitation_threshold : float, default 0.0
        Excitation in 1/s at or below which a joint's equation counts as noise and is not stored. By default every
        equation that is excited at all is stored.
    reset_power : float, default inf
        Power in W of the prediction error above which stored information is reduced, in proportion to the excess. By
        default never, so that noise erases nothing.

    Raises
    ------
    InputError
        If a number is out of range or a shape is wrong.
    NonFiniteError
        If a weight is NaN.

    Notes
    -----
    .. math::

        \dot{\hat\beta}=-P\bigl(Y^\top s+W^\top R(W\hat\beta-F[\tau])+\rho(Q\hat\beta-z)\bigr),\quad
        P^{-1}=\Gamma^{-1}+Q.

    Q and z accumulate :math:`W^\top RW` and :math:`W^\top RF[\tau]`, and forget by direction [2]_. The estimate
    converges along all past excitation [1]_.

    References
    ----------
    .. [1] Pan and Yu, IEEE Trans. Automatic Control, 2018.
    .. [2] Cao and Schwartz, Automatica, 2000.

    Examples
    --------
    >>> learning = adaptctl.control.CompositeLearning(np.full(6, 0.1))
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, learning)
    >>> state = controller.init(p, v).law_state
    >>> learning.covariance(state).shape, float(learning.remembered(state).max())
    ((6, 6), 0.0)
    """

    tunable = ("gain", "prediction_weight", "cutoff", "forgetting", "recall", "excitation_threshold", "reset_power")
    needs_double = True

    called: ClassVar[str] = "composite learning"

    excitation_threshold: float = 0.0
    reset_power: float = np.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        finite_number(self.recall, f"{self.called}: recall")
        finite_number(self.excitation_threshold, f"{self.called}: excitation_threshold")
        if not self.reset_power > 0.0:
            raise InputError(
                f"{self.called}: reset_power: expected a positive number of W, or infinity, got {self.reset_power}"
            )

    def initial_state(
        self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float
    ) -> LearningMemory:
        """
        Return the initial state, an information matrix and torque filters of zero.

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
        LearningMemory
            Internal state of the law. Leading axes of q are arms; a part that does not depend on q is without them.

        Raises
        ------
        InputError
            If linear constraints fix parameters of the model at values other than zero.
        """
        k = len(model.columns)
        filtered = TorqueFilter(self.cutoff, control_period).start(model, q, v)
        return LearningMemory(np.zeros(k * (k + 1) // 2), np.zeros(k), np.zeros(1), filtered)

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: LearningMemory
    ) -> tuple[Column, LearningMemory]:
        """
        Update the stored information and the estimate by one control period.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : Column
            Estimate (k,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : LearningMemory
            Internal state before the period.

        Returns
        -------
        tuple of Column and LearningMemory
            Estimate (k,) in SI units and internal state after the period.
        """
        rows, torque, filtered = TorqueFilter(self.cutoff, period.period).predicted(model, period, memory.filtered)
        missed, weights = residual(rows, estimate, torque), each(self.prediction_weight, model.mechanism.dof)
        kept, scale = self._retained(missed @ (weights * missed), period), self._scale
        forgotten = self.forgetting * period.dt / (1.0 + self.forgetting * period.dt)
        slope, learned, equations = scale * period.gradient(period.integral), 0.0, []
        for row, measured, miss, weight in zip(rows, torque, missed, weights, strict=True):
            root = sqrt(weight)
            unit = (root * scale) * row
            counts = where(unit @ unit > self.excitation_threshold, 1.0, 0.0)
            share = counts * period.dt
            gained = share * root * measured
            equations.append(Equation(unit, counts * forgotten, MIN_POWER, learned=share, gained=gained))
            slope = slope + (share * root * miss) * unit
            learned = learned + counts * period.dt_ratio
        information, known = directional_update(memory.information, kept * memory.known, equations, kept)
        recalled = (self.recall * period.dt) * (Column(1.0 / x for x in scale) * estimate)
        # P (Q x - z) = x - P (x + z), since P^-1 = 1 + Q
        step = recalled + solve(information, slope - recalled - (self.recall * period.dt) * known, shift=1.0)
        return estimate - scale * step, LearningMemory(information, known, Column((learned,)), filtered)

    def _retained(self, power: Scalar, period: Period) -> Scalar:
        """Part of the memory kept at this error power (W)."""
        excess = maximum(power / self.reset_power - 1.0, 0.0)
        return 1.0 / (1.0 + (self.forgetting * period.dt) * excess)

    def covariance(self, memory: LearningMemory) -> Array:
        """
        Return the present adaptation gain.

        Parameters
        ----------
        memory : LearningMemory
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
        return self._covariance(memory.information)

    def remembered(self, memory: LearningMemory) -> Array:
        """
        Return the stored information matrix.

        Parameters
        ----------
        memory : LearningMemory
            Internal state of one arm.

        Returns
        -------
        ndarray
            Information Q (k, k) in J per unit of the parameters squared, 0 along directions never excited.

        Raises
        ------
        ValueError
            If the state is of several arms.
        """
        scale = np.sqrt(self.gain)
        return np.asarray(from_triangle(memory.information, len(self.gain)) / np.outer(scale, scale))
