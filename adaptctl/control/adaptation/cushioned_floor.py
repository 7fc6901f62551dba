"""Composite adaptation with least squares that forget towards what was known at the start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.adaptation.composite import residual
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.least_squares import (
    ForgettingLeastSquares,
    first_triangle,
    from_triangle,
    full_rows,
    upper_rows,
)
from adaptctl.control.adaptation.prediction import Filtered, TorqueFilter
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, each


class InformationMemory(NamedTuple):
    """Internal state, between control periods, of an adaptation law that estimates k parameters by least squares with
    their information matrix P^-1 (k, k), P being the covariance. `information` (k (k + 1)/2,) is the upper triangle,
    row by row, of S P^-1 S, without a unit, where S = Gamma^1/2 and Gamma is the initial gain: the identity at the
    start. `filtered` is the torque filters' internal state, a `Filtered`. Nothing is checked."""

    information: Any
    """(k (k + 1)/2,) the upper triangle, row by row, of S P^-1 S, S = Gamma^1/2: the identity at the start"""
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

    tunable = ("gain", "weight", "cutoff", "forgetting")

    called: ClassVar[str] = "cushioned floor"

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> InformationMemory:
        """The internal state before the first control period: the information matrix P^-1 = Gamma^-1 (k, k) of k
        parameters, Gamma being the initial gain, and the torque filters with zero output. P^-1 is given by its upper
        triangle (k (k + 1)/2,), in units of Gamma^-1.

        `initial`, the initial estimate (k,), is not looked at; q (..., n) are the positions of the spanning tree's n
        joints in rad (m for a prismatic joint), v (..., r) the velocities of the r primary (independent) joints in
        rad/s (m/s), `period` the control period in s. Leading axes are arms: the filters' field `regressor` then has
        them too, all else is the same for all arms. Raises `InputError` for a `model` whose linear constraints fix
        parameters at values other than zero; nothing else is checked.
        """
        filtered = TorqueFilter(self.cutoff, period).start(model, q, v)
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
        rows, torque, filtered = TorqueFilter(self.cutoff, period.length).predicted(model, period, memory.filtered)
        scaled = [self._scale * row for row in rows]
        weights = each(self.weight, model.mechanism.dof)
        share = self.forgetting * period.elapsed
        keep = 1.0 / (1.0 + share)
        information = [
            [keep * (x + share) if i == j else keep * x for j, x in enumerate(row, start=i)]
            for i, row in enumerate(upper_rows(memory.information, len(estimate)))
        ]
        slope = self._scale * period.gradient(period.integral)
        for row, weight, miss in zip(scaled, weights, residual(rows, estimate, torque), strict=True):
            heavy = (period.elapsed * weight) * row
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
