"""Concurrent learning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.control.adaptation.composite import (
    Filtered,
    TorqueFilter,
    momentum_columns,
    validate_filter,
    validate_predicted,
)
from adaptctl.control.adaptation.gradient import Descent
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.sample_stack import sample_stack
from adaptctl.control.adaptation.symmetric import joined
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, each

MAX_SAMPLES = 64


class Stack(NamedTuple):
    """Samples, newest first, a flag that the last was kept, torque filters."""

    rows: Any
    torques: Any
    learned: Any
    filtered: Filtered

    @property
    def logged_state(self) -> Any:
        """Flag (1,) that the last period's sample was kept."""
        return self.learned


@dataclass(frozen=True, eq=False)
class ConcurrentLearning(Descent[Stack]):
    r"""
    Gradient adaptation that also uses a stack of stored samples repeatedly.

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
    stack_size : int, default 12
        Samples stored, 1 to 64, of r equations each. Full rank needs at least k/r of them: 12 allow 12 parameters for
        each joint.
    novelty_threshold : float, default 1.0
        Weighted squared distance in 1/s from the last stored sample above which a sample replaces the oldest.

    Raises
    ------
    InputError
        If a number is out of range, a shape is wrong, or linear constraints fix parameters at values other than zero.
    NonFiniteError
        If a weight is NaN.

    Notes
    -----
    .. math:: \dot{\hat\beta}=-\Gamma\bigl(Y^\top s+\sum_jW_j^\top R(W_j\hat\beta-F[\tau]_j)\bigr).

    Errors converge exponentially, also at rest, if the stack has full rank [1]_.

    References
    ----------
    .. [1] Chowdhary and Johnson, IEEE CDC, 2010.

    Examples
    --------
    >>> stored = adaptctl.control.ConcurrentLearning(np.full(6, 0.1), stack_size=4)
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, stored)
    >>> controller.init(p, v).law_state.torques.shape
    (8,)
    """

    tunable = ("gain", "prediction_weight", "cutoff", "novelty_threshold")

    prediction_weight: Array = 1.0  # type: ignore[assignment]  # a number becomes an array for the model's joints
    cutoff: float = 20.0
    stack_size: int = 12
    novelty_threshold: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_filter("concurrent learning", self.prediction_weight, self.cutoff)
        if isinstance(self.stack_size, bool) or not isinstance(self.stack_size, int | np.integer):
            raise InputError(f"concurrent learning: stack_size: expected a whole number, got {self.stack_size!r}")
        if not 1 <= self.stack_size <= MAX_SAMPLES:
            raise InputError(
                f"concurrent learning: stack_size: expected 1 to {MAX_SAMPLES}, got {self.stack_size}; use Gradient "
                "without samples"
            )
        positive_number(
            self.novelty_threshold,
            "concurrent learning: novelty_threshold: expected a positive number of 1/s, since at 0 every period would "
            "replace a sample",
        )

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
        validate_predicted("concurrent learning", model, self.prediction_weight, self.cutoff, control_period)

    def initial_state(self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float) -> Stack:
        """
        Return the initial state, an empty stack of samples and torque filters of zero.

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
        Stack
            Internal state of the law. Leading axes of q are arms; a part that does not depend on q is without them.

        Raises
        ------
        InputError
            If linear constraints fix parameters of the model at values other than zero.
        """
        entries, r = sum(map(len, momentum_columns(model))), model.mechanism.dof
        filtered = TorqueFilter(self.cutoff, control_period).start(model, q, v)
        return Stack(np.zeros(self.stack_size * entries), np.zeros(self.stack_size * r), np.zeros(1), filtered)

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Stack) -> tuple[Column, Stack]:
        """
        Update the stack of samples, and the estimate by the tracking error and the stored samples.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : Column
            Estimate (k,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : Stack
            Internal state before the period.

        Returns
        -------
        tuple of Column and Stack
            Estimate (k,) in SI units and internal state after the period.
        """
        estimate = estimate - self.applied(period.gradient(period.integral))
        rows, torque, filtered = TorqueFilter(self.cutoff, period.period).predicted(model, period, memory.filtered)
        places = tuple(map(tuple, momentum_columns(model)))
        sample = Column(row[j] for row, of_joint in zip(rows, places, strict=True) for j in of_joint)
        weights = each(self.prediction_weight, model.mechanism.dof)
        gain = self._columns
        learn = sample_stack(places, self.stack_size, len(model.columns), isinstance(gain, list))
        entries = joined(gain) if isinstance(gain, list) else gain
        numbers = Column((self.novelty_threshold, period.dt_ratio, period.dt))
        given = estimate, entries, memory.rows, memory.torques, sample, torque, weights, numbers
        estimate, kept, torques, learned = learn(*given)
        return estimate, Stack(kept, torques, learned, filtered)
