"""Composite learning: least squares that remember what once was excited."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import outlined
from adaptctl.control.adaptation.composite import Filtered, TorqueFilter, residual
from adaptctl.control.adaptation.gradient import TINY
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.least_squares import (
    ForgettingLeastSquares,
    from_triangle,
    full_rows,
    symmetric_product,
    upper_rows,
)
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, each, maximum, sqrt, where


class LearningMemory(NamedTuple):
    """Internal state of composite learning of k parameters between control periods, in units of the initial gain Gamma,
    S being Gamma^1/2.

    `information` (k (k + 1)/2,) is the upper triangle of S Q S, row by row, Q (k, k) the information matrix, zero at
    the start; `known` (k,) is S z, where z (k,) is Q times the true parameters as far as nothing disturbs; `learned`
    (1,) is the number, 0 to r, of the r joints whose equation for the filtered torque was learned from in the last
    control period; `filtered` is the torque filters' internal state. Nothing is checked.
    """

    information: Any
    known: Any
    learned: Any
    """(1,) how many joints' equations passed the threshold in the last period"""
    filtered: Filtered

    @property
    def logged_state(self) -> Any:
        """Number (1,), 0 to r, of the r joints whose equation for the filtered torque was learned from in the last
        control period: the field `learned`, the part of this internal state that is stored with each sample of a
        recorded run."""
        return self.learned


@dataclass(frozen=True, eq=False)
class CompositeLearning(ForgettingLeastSquares[LearningMemory]):
    """Composite learning, an adaptation law for the estimate (k,) of k parameters (Pan and Yu 2018): least squares
    whose information matrix Q (k, k) and vector z (k,) accumulate past data and forget by direction (Kulhavy 1987, Cao
    and Schwartz 2000).

        estimate' = -P (Y' s + W'R (W estimate - F[tau]) + recall (Q estimate - z)),  P^-1 = Gamma^-1 + Q
        Q' = W'RW - forgetting Q W'(W Q W')^+ W Q,  z' = W'R F[tau] - forgetting Q W'(W Q W')^+ W z

    Y (r, k) is the torque regressor of r joints, s (r,) the sliding variable in rad/s (m/s for a prismatic joint), tau
    (r,) the torque applied in the last control period, N m (N); F = cutoff/(d/dt + cutoff) is a low-pass filter, F[tau]
    the filtered torque and W = F[Y] (r, k) the filtered regressor. A prime is the transpose, but on estimate, Q, z and
    V a derivative in time; ^+ is the pseudo-inverse. z = Q true, true being the true parameters.

    Along what W sees now the past is forgotten, at `forgetting` (1/s, 1 by default); what W does not see is kept until
    it is seen again. `recall` (1/s, 2 by default) is the rate at which the estimate goes to a solution of Q estimate =
    z, the same in all directions in which Q is large against Gamma^-1. `threshold` (1/s) is the excitation w'Gamma w R,
    w a joint's row of W, at or below which that joint's equation counts as noise: nothing is learned from it, nor
    forgotten; 0, the default, lets all count. `alarm` (W) is the power eps'R eps, eps = W estimate - F[tau], beyond
    which all of Q and z is forgotten as well, at the rate forgetting (eps'R eps/alarm - 1); infinity, the default,
    leaves that out.

    `gain` is Gamma's diagonal (k,), in units of the parameters squared per J, `weight` R, one number or (r,), 1 by
    default, in 1/(N m s) (m/(N s) for a prismatic joint), `cutoff` that of F, 20 rad/s by default; the class attribute
    `called` is the law's name in messages. Raises `InputError` for a gain, a weight, a cutoff or an alarm that is not
    positive, a forgetting, recall or threshold below 0, all finite but the alarm (`NonFiniteError` for a weight of
    NaN), and, with a controller, for sizes that do not fit the model, linear constraints on parameters that fix some at
    values other than zero, a cutoff above 1/T_c and a recall above 0.5/T_c, T_c the control period.

    Guarantees, without disturbance, M being the mass matrix, K the control law's damping and error the estimate less
    the truth: with V = s'Ms/2 + error' P^-1 error/2, where eps = W error, V' <= -s'Ks - eps'R eps/2 - recall error'Q
    error: s and eps go to zero, and so does the error in the excited subspace, the range of Q, also after excitation
    has ended (interval excitation: where Q is positive definite once, all of the error; excited and unexcited
    subspaces: Shen, Wang, Wen and Lu, arXiv 2408.01731). A parameter that changes is learned again at forgetting along
    what is excited then.

    Gives up: friction that is no parameter, actuator lag and delay are learned as inertia. After a change, what is no
    longer excited stays as it was, wrong or right. Costs a rank-one change of Q twice a joint, k^2 operations each, a
    Cholesky factorisation, k^3/3, and storage for k (k + 3)/2 numbers.
    """

    tunable = ("gain", "prediction_weight", "cutoff", "forgetting", "recall", "excitation_threshold", "reset_power")
    needs_double = True

    called: ClassVar[str] = "composite learning"

    recall: float = 2.0
    excitation_threshold: float = 0.0
    reset_power: float = np.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, unit in (("recall", "1/s"), ("excitation_threshold", "1/s")):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"{self.called}: {name}: expected a finite number of at least 0 {unit}, got {value}")

        if not self.reset_power > 0.0:
            raise InputError(
                f"{self.called}: alarm: expected a positive number of W, or infinity, got {self.reset_power}"
            )

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` unless the adaptation law fits the `model`, of k parameters and r joints, and the control
        `period` T_c (s). Required are an adaptation gain of k numbers, one positive weight of prediction errors or one
        for each joint, a cutoff of the torque filter (rad/s) of at most 1/T_c, a rate `recall` (1/s), an attribute, of
        at most 0.5/T_c, and no linear constraint that fixes a parameter of the mechanism at a value other than zero.

        `recall` is the rate at which the estimate goes to the least-squares solution of the past data. `initial`, the
        initial estimate (k,), is not used. The controller, not this method, checks that T_c is positive.
        """
        super().validate(model, initial, control_period)
        if self.recall * control_period > 0.5:
            raise InputError(
                f"{self.called}: recall: {self.recall:g} 1/s is too fast for a control period of {control_period:g} s; "
                f"use at most {0.5 / control_period:g} 1/s"
            )

    def initial_state(
        self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float
    ) -> LearningMemory:
        """The internal state before the first control period: no information on the k parameters, and the torque
        filters with zero output. The upper triangle (k (k + 1)/2,) of the information matrix Q (k, k), the vector z
        (k,), which is Q times the true parameters, and the number (1,) of joints' torque equations learned from are all
        zero.

        `initial`, the initial estimate (k,), is not looked at; q (..., n) are the positions of the spanning tree's n
        joints in rad (m for a prismatic joint), v (..., r) the velocities of the r primary (independent) joints in
        rad/s (m/s), `period` the control period in s. Leading axes are arms: the filters' field `regressor` then has
        them too, all else is the same for all arms. Raises `InputError` for a `model` whose linear constraints fix
        parameters at values other than zero; nothing else is checked.
        """
        k = len(model.columns)
        filtered = TorqueFilter(self.cutoff, control_period).start(model, q, v)
        return LearningMemory(np.zeros(k * (k + 1) // 2), np.zeros(k), np.zeros(1), filtered)

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: LearningMemory
    ) -> tuple[Column, LearningMemory]:
        """The estimate (k,) of the model's k parameters, in their SI units, and the internal state after a control
        period. One joint's equation after the other is forgotten along and learned; then the estimate descends by the
        gain P = (Gamma^-1 + Q)^-1 (k, k).

        `estimate` (k,) and the internal state `memory` are those before the control period that `period` describes.
        That state is the upper triangle (k (k + 1)/2,) of the information matrix Q, the vector z (k,), which is Q times
        the true parameters, both in units of the initial gain Gamma, the number (1,) of joints' torque equations
        learned from, and the torque filters. Nothing is checked here.
        """
        rows, torque, filtered = TorqueFilter(self.cutoff, period.period).predicted(model, period, memory.filtered)
        missed, weights = residual(rows, estimate, torque), each(self.prediction_weight, model.mechanism.dof)
        kept, scale = self._kept(missed @ (weights * missed), period), self._scale
        information, known = kept * memory.information, kept * memory.known
        slope, learned = scale * period.gradient(period.integral), 0.0
        forgotten = self.forgetting * period.dt / (1.0 + self.forgetting * period.dt)
        for row, measured, miss, weight in zip(rows, torque, missed, weights, strict=True):
            root = sqrt(weight)
            scaled = (root * scale) * row
            counts = where(scaled @ scaled > self.excitation_threshold, 1.0, 0.0)
            shares = Column((counts * forgotten, counts * period.dt))
            information, known = _remembered(information, known, scaled, root * measured, shares)
            slope = slope + (shares[1] * root * miss) * scaled
            learned = learned + counts * period.dt_ratio
        inverse_scale = Column(1.0 / x for x in scale)
        error = symmetric_product(information, inverse_scale * estimate) - known
        slope = slope + (self.recall * period.dt) * error
        step = solve_symmetric(_gained(information, len(estimate)), slope)
        return estimate - scale * step, LearningMemory(information, known, Column((learned,)), filtered)

    def _kept(self, power: Scalar, period: Period) -> Scalar:
        """The share of all memory that is left after a period with so much power missed (W)."""
        excess = maximum(power / self.reset_power - 1.0, 0.0)
        return 1.0 / (1.0 + (self.forgetting * period.dt) * excess)

    def covariance(self, memory: LearningMemory) -> Array:
        """Covariance P (k, k) of the estimate of k parameters, symmetric, in units of the parameters squared per J: the
        adaptation law's present gain, P = (Gamma^-1 + Q)^-1, with the initial gain Gamma and the information matrix Q.
        It is read from `memory`, an internal state of this law for one arm. Raises `ValueError` for that of several
        arms."""
        k, scale = len(self.gain), np.sqrt(self.gain)
        return np.asarray(np.linalg.inv(np.eye(k) + from_triangle(memory.information, k)) * np.outer(scale, scale))

    def remembered(self, memory: LearningMemory) -> Array:
        """Information matrix Q (k, k) of least squares on k parameters, symmetric, in J per unit of the parameters
        squared: 0 along directions that were never excited. It is read from `memory`, an internal state of this
        adaptation law for one arm. Raises `ValueError` for that of several arms."""
        scale = np.sqrt(self.gain)
        return np.asarray(from_triangle(memory.information, len(self.gain)) / np.outer(scale, scale))


def _gained(information: Column, k: int) -> list[list[Scalar]]:
    """The matrix 1 + Q (k, k)."""
    upper = upper_rows(information, k)
    return full_rows([[row[0] + 1.0, *row[1:]] for row in upper])


def _remember(information: Column, known: Column, row: Column, torque: Scalar, shares: Column) -> tuple[Column, Column]:
    """Q and z after one joint's equation row' x = torque: first the share shares[0] of their content along the row is
    forgotten, then shares[1] of the equation learned."""
    k, along = len(row), symmetric_product(information, row)
    lost = shares[0] / (row @ along + TINY)
    fading, heavy = lost * along, shares[1] * row
    pairs = ((i, j) for i in range(k) for j in range(i, k))
    after = Column(x - fading[i] * along[j] + heavy[i] * row[j] for x, (i, j) in zip(information, pairs, strict=True))
    return after, known - (row @ known) * fading + torque * heavy


_remembered = outlined(_remember)
