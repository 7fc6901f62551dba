"""Least squares with a gain that follows the information: settings of those that forget, and symmetric matrices."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np

from adaptctl.arrays import Array, frozen_array, numbers
from adaptctl.compilation import outlined
from adaptctl.control.adaptation.composite import Filtered, TorqueFilter, residual, validate_filter, validate_predicted
from adaptctl.control.adaptation.gradient import validate_size
from adaptctl.control.adaptation.law import AdaptationLaw, Period
from adaptctl.control.pytree import Memory
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column, each, sqrt


@dataclass(frozen=True, eq=False)
class ForgettingLeastSquares(AdaptationLaw[Memory]):
    """Base class of adaptation laws for k parameters by least squares with forgetting, from filtered torques.

    `gain` (k,), positive, is the diagonal of Gamma, the initial covariance, in units of the parameters squared per J;
    `weight` the weight of the squared errors of predicted torques, in 1/(N m s) (m/(N s) for a prismatic joint), one
    number, by default 1, or one for each of r joints (r,); `cutoff` the torque filter's corner frequency, 20 rad/s by
    default; `forgetting` the rate at which the past is forgotten, in 1/s, 1 by default. A subclass sets the class
    attribute `called`, the law's name in messages, and writes the methods `start(model, initial, q, v, period)`, which
    returns the internal state before the first control period, and `law(model, estimate, period, memory)`, which
    returns the estimate (k,) and the internal state after one. Raises `InputError` at construction for a gain, weight
    or cutoff that is not positive and finite or of another shape, and a forgetting that is not finite or below 0;
    `NonFiniteError` for a weight of NaN.
    """

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
        if not (np.isfinite(self.forgetting) and self.forgetting >= 0.0):
            raise InputError(f"{self.called}: forgetting: expected at least 0 1/s, got {self.forgetting}")

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` unless the adaptation law fits the `model`, of k parameters and r joints, and the control
        `period` T_c (s). Required are an adaptation gain of k numbers, one positive weight of prediction errors or one
        for each joint, a cutoff of the torque filter (rad/s) of at most 1/T_c, and no linear constraint that fixes a
        parameter of the mechanism at a value other than zero.

        `initial`, the initial estimate (k,), is not used. The controller, not this method, checks that T_c is positive.
        """
        validate_size(self.gain, model, f"{self.called}: gain")
        validate_predicted(self.called, model, self.prediction_weight, self.cutoff, control_period)

    @property
    def _scale(self) -> Column:
        """Gamma^1/2 (k,): in its units P and the parameters' errors are near 1."""
        return Column(map(sqrt, column(self.gain)))


def first_triangle(k: int) -> Array:
    """The upper triangle (k (k + 1)/2,), row by row, of the identity (k, k), as floats. Raises `ValueError` for a
    negative `k`."""
    return np.eye(k)[np.triu_indices(k)]


def from_triangle(entries: Array, k: int) -> Array:
    """The symmetric matrix (k, k), as an array, whose upper triangle, row by row, is `entries` (k (k + 1)/2,). Raises
    `ValueError` for another number of them."""
    upper = np.zeros((k, k))
    upper[np.triu_indices(k)] = np.reshape(entries, k * (k + 1) // 2)
    return upper + np.triu(upper, 1).T


def upper_rows(entries: Column, k: int) -> list[list[Scalar]]:
    """The k rows of a symmetric matrix's upper triangle, given by its `entries` (k (k + 1)/2,), row by row: lists of k,
    k - 1, ..., 1 scalars, each from the diagonal entry on. Nothing is checked."""
    return [list(entries.of[a:b]) for a, b in pairwise(_starts(k))]


def full_rows(upper: list[list[Scalar]]) -> list[list[Scalar]]:
    """The k rows of k scalars each of a symmetric matrix, from those of its upper triangle, `upper`: lists of k, k - 1,
    ..., 1 scalars, each from the diagonal entry on. Raises `IndexError` for rows that are too short."""
    k = len(upper)
    return [[upper[min(i, j)][max(i, j) - min(i, j)] for j in range(k)] for i in range(k)]


def symmetric_product(entries: Column, vector: Column) -> Column:
    """The product (k,) of a symmetric matrix (k, k), given by the `entries` (k (k + 1)/2,) of its upper triangle, row
    by row, and a `vector` (k,), over scalars of any kind. Raises `IndexError` for too few entries."""
    rows = full_rows(upper_rows(entries, len(vector)))
    return Column(Column(row) @ vector for row in rows)


def symmetric_trace(entries: Column, k: int) -> Scalar:
    """The trace of a symmetric matrix (k, k), given by the `entries` (k (k + 1)/2,) of its upper triangle, row by row.
    Raises `IndexError` for too few entries."""
    diagonal = [entries[start] for start in _starts(k)[:-1]]
    return sum(diagonal[1:], diagonal[0])


def _starts(k: int) -> list[int]:
    """Indices in an upper triangle's entries at which each row begins, and at which the last ends."""
    return [i * k - i * (i - 1) // 2 for i in range(k + 1)]


class CovarianceMemory(NamedTuple):
    """Internal state, between control periods, of an adaptation law that estimates k parameters by least squares with
    their covariance P (k, k). `covariance` (k (k + 1)/2,) is the upper triangle, row by row, of S^-1 P S^-1, without a
    unit, where S = Gamma^1/2 and Gamma is the initial gain: the identity at the start. `filtered` is the torque
    filters' internal state, a `Filtered`. Nothing is checked."""

    covariance: Any
    filtered: Filtered


@dataclass(frozen=True, eq=False)
class BoundedGainForgetting(ForgettingLeastSquares[CovarianceMemory]):
    """Composite adaptation of the estimate (k,) of k parameters by least squares with bounded-gain forgetting (Slotine
    and Li 1989).

        estimate' = -P (Y' s + W'R (W estimate - F[tau])),  P' = lambda(t) P - P W'R W P

    lambda(t) = forgetting (1 - tr(Gamma^-1 P)/(k bound)). The covariance P (k, k) starts at Gamma = diag(`gain`),
    `gain` (k,) positive, in units of the parameters squared per J. s (r,) is the sliding variable of r joints in rad/s
    (m/s for a prismatic joint), tau (r,) the torque in N m (N), Y (r, k) the torque regressor, W (r, k) that behind the
    filter F = cutoff/(d/dt + cutoff). `weight`, 1 by default, is R in 1/(N m s) (m/(N s)), one number or (r,), and
    `cutoff`, 20 by default, is in rad/s, both positive; `forgetting` of at least 0, 1 by default, is in 1/s; `bound` of
    at least 1, unitless, is the most that tr(Gamma^-1 P)/k, the mean gain over Gamma, may become; the class attribute
    `called` is the law's name in messages. A prime is the transpose, but on estimate and P a derivative in time. Raises
    `InputError` at construction for numbers outside these ranges and for other shapes (`NonFiniteError` for a weight of
    NaN), and, with a controller, for sizes that do not fit the model, linear constraints on parameters that fix some at
    values other than zero, a cutoff above 1/T_c and a forgetting above 0.1/T_c, T_c the control period.

    Guarantees, without disturbance, M being the mass matrix, K the control law's damping and error the estimate less
    the truth: 0 < P, tr(Gamma^-1 P) <= k bound, and V = s'Ms/2 + error' P^-1 error/2 has the time derivative -s'Ks -
    eps'R eps/2 - lambda(t) error' P^-1 error/2, eps = W error: s and eps go to zero. Under persistent excitation
    lambda(t) stays positive, and s and the error go to zero exponentially. Every period is solved implicitly, one
    joint's equation after the other, which keeps P positive definite.

    Gives up: friction that is no parameter, actuator lag and delay are learned as inertia. Without excitation P grows
    to its bound along what W does not see, where noise then moves the estimate fastest. And there is one lambda(t) for
    all directions: it settles at forgetting/(1 + forgetting c/(k bound)), c the trace of the inverse of Gamma^1/2 W'R W
    Gamma^1/2 on average, which is large where some direction is hardly excited. Then nothing is forgotten, however fast
    the forgetting, P shrinks along all that W sees, and a parameter that changes, as with a payload, is not learned any
    more; `CushionedFloor` learns it. This law is for parameters that are constant. Costs k^2 operations for each joint
    and storage for k (k + 1)/2 numbers.
    """

    tunable = ("gain", "prediction_weight", "cutoff", "forgetting", "bound")
    needs_double = True

    called: ClassVar[str] = "bounded-gain forgetting"

    bound: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite(self.bound) and self.bound >= 1.0):
            raise InputError(f"{self.called}: bound: expected at least 1, got {self.bound}")

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` unless the adaptation law fits the `model`, of k parameters and r joints, and the control
        `period` T_c (s). Required are an adaptation gain of k numbers, one positive weight of prediction errors or one
        for each joint, a cutoff of the torque filter (rad/s) of at most 1/T_c, a rate of forgetting (1/s) of at most
        0.1/T_c, and no linear constraint that fixes a parameter of the mechanism at a value other than zero.

        `initial`, the initial estimate (k,), is not used. The controller, not this method, checks that T_c is positive.
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
        """The internal state before the first control period: the covariance P = Gamma (k, k) of k parameters, Gamma
        being the initial gain, and the torque filters with zero output. P is given by its upper triangle (k (k +
        1)/2,), in units of Gamma.

        `initial`, the initial estimate (k,), is not looked at; q (..., n) are the positions of the spanning tree's n
        joints in rad (m for a prismatic joint), v (..., r) the velocities of the r primary (independent) joints in
        rad/s (m/s), `period` the control period in s. Leading axes are arms: the filters' field `regressor` then has
        them too, all else is the same for all arms. Raises `InputError` for a `model` whose linear constraints fix
        parameters at values other than zero; nothing else is checked.
        """
        filtered = TorqueFilter(self.cutoff, control_period).start(model, q, v)
        return CovarianceMemory(first_triangle(self.gain.shape[-1]), filtered)

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: CovarianceMemory
    ) -> tuple[Column, CovarianceMemory]:
        """The estimate (k,) of the model's k parameters, in their SI units, and the internal state after a control
        period. The estimate takes a step for the tracking error (trapezium rule) and an implicit step for each joint's
        prediction error; then forgetting lets the covariance P (k, k) grow.

        `estimate` (k,) and the internal state `memory` are those before the control period that `period` describes;
        that state is the upper triangle (k (k + 1)/2,) of P, in units of the initial gain Gamma, and the torque
        filters. Nothing is checked here.
        """
        covariance, scale = memory.covariance, self._scale
        gradient = scale * period.gradient(period.integral)
        moved = estimate - scale * symmetric_product(covariance, gradient)
        rows, torque, filtered = TorqueFilter(self.cutoff, period.period).predicted(model, period, memory.filtered)
        for row, wanted, weight in zip(rows, torque, each(self.prediction_weight, model.mechanism.dof), strict=True):
            firm = 1.0 / (weight * period.period)
            step, covariance = _updated(covariance, scale * row, row @ moved - wanted, firm, period.dt_ratio)
            moved = moved - scale * step
        rate = self.forgetting * (
            1.0 - symmetric_trace(covariance, len(estimate)) * (1.0 / (self.bound * len(estimate)))
        )
        return moved, CovarianceMemory((1.0 + period.dt * rate) * covariance, filtered)

    def covariance(self, memory: CovarianceMemory) -> Array:
        """Covariance P (k, k) of the estimate of k parameters by least squares, symmetric, in units of the parameters
        squared per J: the adaptation law's present gain. It is read from `memory`, an internal state of this law for
        one arm. Raises `ValueError` for that of several arms."""
        scale = np.sqrt(self.gain)
        return from_triangle(memory.covariance, len(self.gain)) * np.outer(scale, scale)


def _update(covariance: Column, row: Column, miss: Scalar, firm: Scalar, share: Scalar) -> tuple[Column, Column]:
    """The step (k,) that one equation, missed by `miss`, takes from the estimate, and the covariance after it.

    `firm` is the variance of the equation; a share of 0 leaves everything as it is.
    """
    k = len(row)
    gain = symmetric_product(covariance, row)
    weight = share * (1.0 / (row @ gain + firm))
    scaled = weight * gain
    pairs = ((i, j) for i in range(k) for j in range(i, k))
    after = Column(p - scaled[i] * gain[j] for p, (i, j) in zip(covariance, pairs, strict=True))
    return miss * scaled, after


_updated = outlined(_update)


class InformationMemory(NamedTuple):
    """Internal state, between control periods, of an adaptation law that estimates k parameters by least squares with
    their information matrix P^-1 (k, k), P being the covariance. `information` (k (k + 1)/2,) is the upper triangle,
    row by row, of S P^-1 S, without a unit, where S = Gamma^1/2 and Gamma is the initial gain: the identity at the
    start. `filtered` is the torque filters' internal state, a `Filtered`. Nothing is checked."""

    information: Any
    filtered: Filtered


@dataclass(frozen=True, eq=False)
class CushionedFloor(ForgettingLeastSquares[InformationMemory]):
    """Composite adaptation of the estimate (k,) of k parameters by least squares with the cushioned floor, a lower
    bound on P^-1 (Slotine and Li 1989).

        estimate' = -P (Y' s + W'R (W estimate - F[tau])),  (P^-1)' = -lambda (P^-1 - Gamma^-1) + W'R W

    The information matrix P^-1 (k, k) starts at its floor Gamma^-1, Gamma = diag(`gain`), `gain` (k,) positive, in
    units of the parameters squared per J. s (r,) is the sliding variable of r joints in rad/s (m/s for a prismatic
    joint), tau (r,) the torque in N m (N), Y (r, k) the torque regressor, W (r, k) that behind the filter F =
    cutoff/(d/dt + cutoff). `forgetting`, 1 by default, is lambda of at least 0 in 1/s; `weight`, 1 by default, is R in
    1/(N m s) (m/(N s)), one number or (r,), and `cutoff`, 20 by default, is in rad/s, both positive; the class
    attribute `called` is the law's name in messages. A prime is the transpose, but on estimate and P^-1 a derivative in
    time. Raises `InputError` at construction for numbers outside these ranges and for other shapes (`NonFiniteError`
    for a weight of NaN), and, with a controller, for sizes that do not fit the model, linear constraints on parameters
    that fix some at values other than zero, and a cutoff above 1/T_c, T_c the control period.

    Guarantees, without disturbance, M being the mass matrix, K the control law's damping and error the estimate less
    the truth: P <= Gamma, and V = s'Ms/2 + error' P^-1 error/2 has the time derivative -s'Ks - eps'R eps/2 - lambda
    error' (P^-1 - Gamma^-1) error/2, eps = W error: s and eps go to zero, and under persistent excitation s and the
    error exponentially. Every direction forgets for itself: what W sees is forgotten and learned anew at lambda, what
    it does not see keeps the gain Gamma. `BoundedGainForgetting` has one lambda(t) for all, and where some directions
    are not excited they bring it, and with it all learning, to a stop.

    Gives up: friction that is no parameter, actuator lag and delay are learned as inertia. Costs a Cholesky
    factorisation a period, k^3/3 operations, and storage for k (k + 1)/2 numbers.
    """

    tunable = ("gain", "prediction_weight", "cutoff", "forgetting")

    called: ClassVar[str] = "cushioned floor"

    def initial_state(
        self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float
    ) -> InformationMemory:
        """The internal state before the first control period: the information matrix P^-1 = Gamma^-1 (k, k) of k
        parameters, Gamma being the initial gain, and the torque filters with zero output. P^-1 is given by its upper
        triangle (k (k + 1)/2,), in units of Gamma^-1.

        `initial`, the initial estimate (k,), is not looked at; q (..., n) are the positions of the spanning tree's n
        joints in rad (m for a prismatic joint), v (..., r) the velocities of the r primary (independent) joints in
        rad/s (m/s), `period` the control period in s. Leading axes are arms: the filters' field `regressor` then has
        them too, all else is the same for all arms. Raises `InputError` for a `model` whose linear constraints fix
        parameters at values other than zero; nothing else is checked.
        """
        filtered = TorqueFilter(self.cutoff, control_period).start(model, q, v)
        return InformationMemory(first_triangle(self.gain.shape[-1]), filtered)

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: InformationMemory
    ) -> tuple[Column, InformationMemory]:
        """The estimate (k,) of the model's k parameters, in their SI units, and the internal state after a control
        period. The information matrix P^-1 (k, k) forgets by the implicit rule and learns from the period's torques,
        then the estimate descends by the new covariance P.

        `estimate` (k,) and the internal state `memory` are those before the control period that `period` describes;
        that state is the upper triangle (k (k + 1)/2,) of P^-1 in units of Gamma^-1, Gamma the initial gain, and the
        torque filters. Nothing is checked here.
        """
        rows, torque, filtered = TorqueFilter(self.cutoff, period.period).predicted(model, period, memory.filtered)
        scaled = [self._scale * row for row in rows]
        weights = each(self.prediction_weight, model.mechanism.dof)
        share = self.forgetting * period.dt
        keep = 1.0 / (1.0 + share)
        information = [
            [keep * (x + share) if i == j else keep * x for j, x in enumerate(row, start=i)]
            for i, row in enumerate(upper_rows(memory.information, len(estimate)))
        ]
        slope = self._scale * period.gradient(period.integral)
        for row, weight, miss in zip(scaled, weights, residual(rows, estimate, torque), strict=True):
            heavy = (period.dt * weight) * row
            information = [
                [x + heavy[i] * y for x, y in zip(upper, row.of[i:], strict=True)]
                for i, upper in enumerate(information)
            ]
            slope = slope + miss * heavy
        step = solve_symmetric(full_rows(information), slope)
        after = Column(x for upper in information for x in upper)
        return estimate - self._scale * step, InformationMemory(after, filtered)

    def covariance(self, memory: InformationMemory) -> Array:
        """Covariance P (k, k) of the estimate of k parameters by least squares, symmetric, in units of the parameters
        squared per J: the adaptation law's present gain. It is read from `memory`, an internal state of this law for
        one arm. Raises `ValueError` for that of several arms."""
        scale = np.sqrt(self.gain)
        return np.asarray(np.linalg.inv(from_triangle(memory.information, len(self.gain))) * np.outer(scale, scale))
