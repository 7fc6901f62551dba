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
    """The memory, between control periods, of a law that adapts k parameters by least squares and carries their
    information P^-1 (k, k), P the covariance: `information` (k (k + 1)/2,) is the upper triangle, row by row, of S P^-1
    S, S = Gamma^1/2 with the first gain Gamma, the identity at the start; `filtered` is the torque filters' memory.
    Nothing is checked."""

    information: Any
    """(k (k + 1)/2,) the upper triangle, row by row, of S P^-1 S, S = Gamma^1/2: the identity at the start"""
    filtered: Filtered


@dataclass(frozen=True, eq=False)
class CushionedFloor(ForgettingLeastSquares[InformationMemory]):
    """Composite adaptation of the estimate (k,) of k parameters by least squares with the cushioned floor, a lower
    bound on P^-1 (Slotine and Li 1989).

        estimate' = -P (Y's + W'R (W estimate - F[tau])),  (P^-1)' = -lambda (P^-1 - Gamma^-1) + W'R W

    The information matrix P^-1 (k, k) starts at its floor Gamma^-1, Gamma = diag(`gain`), `gain` (k,) positive, in
    units of the parameters squared per J. s (r,) is the sliding variable of r joints in rad/s (m/s for a prismatic
    joint), tau (r,) the torque in N m (N), Y (r, k) the torque regressor, W (r, k) that behind the filter F =
    cutoff/(d/dt + cutoff). `forgetting`, 1 by default, is lambda of at least 0 in 1/s; `weight`, 1 by default, is R in
    1/(N m s) (m/(N s)), one number or (r,), and `cutoff`, 20 by default, is in rad/s, both positive; `called` is the
    law's name in messages. A prime is the transpose, but on estimate and P^-1 a derivative in time. Raises `InputError`
    for other numbers and shapes at construction, and, with a controller, for sizes that do not fit the model, linear
    constraints on parameters that fix some at values other than zero, and a cutoff above 1/T_c, T_c the control period;
    a weight of NaN is a `NonFiniteError`.

    Guarantees, without disturbance, M being the mass matrix, K the control law's damping and error the estimate less
    the truth: P <= Gamma, and V = s'Ms/2 + error' P^-1 error/2 falls as -s'Ks - eps'R eps/2 - lambda error' (P^-1 -
    Gamma^-1) error/2, eps = W error: s and eps go to zero, and under persistent excitation s and the error
    exponentially. Every direction forgets for itself: what W sees is forgotten and learned anew at lambda, what it does
    not see keeps the gain Gamma. `BoundedGainForgetting` has one lambda(t) for all, and where some directions are not
    excited they bring it, and with it all learning, to a stop.

    Gives up: friction that is no parameter, actuator lag and delay are learned as inertia. Costs a Cholesky
    factorisation a period, k^3/3 operations, and a memory of k (k + 1)/2.
    """

    tunable = ("gain", "weight", "cutoff", "forgetting")

    called: ClassVar[str] = "cushioned floor"

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> InformationMemory:
        """The memory before the first control period: the upper triangle (k (k + 1)/2,) of the information matrix P^-1
        = Gamma^-1 of k parameters, in units of Gamma^-1 (Gamma the first gain), and the torque filters at rest, their
        outputs zero.

        `initial`, the first estimate (k,), is not looked at; q (..., n) are the positions of the spanning tree's n
        joints in rad (m for a prismatic joint), v (..., r) the velocities of the r primary (independent) joints in
        rad/s (m/s), `period` the control period in s. Leading axes are arms: the filters' `regressor` then has them
        too, all else is the same for all arms. Raises `InputError` for a model whose linear constraints fix parameters
        at values other than zero; nothing else is checked.
        """
        filtered = TorqueFilter(self.cutoff, period).start(model, q, v)
        return InformationMemory(first_triangle(self.gain.shape[-1]), filtered)

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: InformationMemory
    ) -> tuple[Column, InformationMemory]:
        """The estimate (k,) of the model's k parameters, in their SI units, and the memory after a control period: the
        information matrix P^-1 (k, k) forgets by the implicit rule and learns from the period's torques, then the
        estimate descends by the new covariance P.

        `estimate` (k,) and `memory`, the upper triangle (k (k + 1)/2,) of P^-1 in units of Gamma^-1, Gamma the first
        gain, and the torque filters, are those before the control period that `period` describes. Nothing is checked
        here.
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
        """The covariance P (k, k) of least squares on k parameters, the present adaptation gain, symmetric, that a
        `memory` of this adaptation law, for one arm, holds, in units of the parameters squared per J. Raises
        `ValueError` for the memory of several arms."""
        scale = np.sqrt(self.gain)
        return np.asarray(np.linalg.inv(from_triangle(memory.information, len(self.gain))) * np.outer(scale, scale))
