"""Torques predicted by the estimate, filtered so that no acceleration is needed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array, positive_number, stacked
from adaptctl.compilation import trace
from adaptctl.control.adaptation.law import Period
from adaptctl.dynamics.recursion.momentum import momentum_terms
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column, spread


class Filtered(NamedTuple):
    """The memory of the torque filters: those of the regressor's entries and of the torques."""

    regressor: Any
    """rows of F[lambda H + N], as far as it is known before the next sample, without what is always zero"""
    torque: Any
    """(r,) F[tau], N m"""


class Prediction(NamedTuple):
    """A prediction of filtered torques: the linear equation W beta = torque for the true parameters, as far as nothing
    disturbs."""

    rows: list[Column]
    """W (r, k)"""
    torque: Column
    """F[tau] (r,), N m"""
    after: Filtered


@dataclass(frozen=True)
class TorqueFilter:
    """The filter F = lambda/(d/dt + lambda) of the equations of motion, tau = Y(p, v, a) beta, by parts, without
    accelerations (Slotine and Li 1989).

    With tau = d/dt (H beta) - N beta, H the momenta's regressor, F[Y] = W = lambda H - F[lambda H + N] when
    F[H] starts at H: positions and velocities are enough. The torque is held over each period, for which its
    filter is exact; lambda H + N goes in by the trapezium between samples, exact to T_c^2. `cutoff` is lambda
    in rad/s, `period` T_c in s.
    """

    cutoff: float
    period: float

    def start(self, model: ReducedModel, q: Array | Column, v: Array | Column) -> Filtered:
        """The memory before the first tick, at configurations q (..., n) and velocities v (..., r), arrays or columns:
        W is zero there."""
        momentum, forces = momentum_terms(model.mechanism.equations, column(q), column(v), model.columns)
        kept: list[Any] = []
        for row, change, places in zip(momentum, forces, momentum_columns(model), strict=True):
            scaled = self.cutoff * row
            first = scaled - self._new * (scaled + change)
            kept += [first[j] for j in places]
        first_rows = Column(kept) if isinstance(q, Column) else stacked(kept, q.shape[:-1])
        return Filtered(first_rows, np.zeros(model.mechanism.dof))

    def predicted(self, model: ReducedModel, period: Period, memory: Filtered) -> Prediction:
        """The linear equation for the parameters now, from configuration and velocities now and the torque of the
        period just passed."""
        momentum, forces = momentum_terms(model.mechanism.equations, period.q, period.v, model.columns)
        k, keep, last = len(model.columns), self._keep, iter(memory.regressor)
        rows: list[Column] = []
        before: list[Any] = []
        for row, change, places in zip(momentum, forces, momentum_columns(model), strict=True):
            scaled = self.cutoff * row
            now = scaled + change
            filtered = spread(Column(next(last) + self._new * now[j] for j in places), places, k)
            rows.append(scaled - filtered)
            before += [keep * filtered[j] + self._old * now[j] for j in places]
        torque = keep * memory.torque + (1.0 - keep) * period.torque
        return Prediction(rows, torque, Filtered(Column(before), torque))

    @property
    def _keep(self) -> Any:
        """Share of a filter's state that is left after a period."""
        return decayed(self.cutoff * self.period)[0]

    @property
    def _new(self) -> Any:
        """Weight of a linear input's value at the end of a period."""
        return 1.0 - decayed(self.cutoff * self.period)[1]

    @property
    def _old(self) -> Any:
        """Weight of its value at the start."""
        return 1.0 - self._keep - self._new


def decayed(x: Any) -> tuple[Any, Any]:
    """exp(-x) and (1 - exp(-x))/x, its mean from 0 to x, for 0 < x <= 1, over scalars of any kind, to round-off.

    By the Pade approximant of order (5, 5) at x/4, and by doubling x twice.
    """
    y = 0.25 * x
    square = y * y
    odd = 15120.0 + square * (420.0 + square)
    even = 30240.0 + square * (3360.0 + 30.0 * square)
    below = 1.0 / (even + y * odd)
    left, mean = (even - y * odd) * below, (2.0 * odd) * below
    for _ in range(2):
        left, mean = left * left, (0.5 * mean) * (1.0 + left)
    return left, mean


@lru_cache(maxsize=64)
def momentum_columns(model: ReducedModel) -> list[list[int]]:
    """For each joint, the indices of the model's parameters that its momentum ever depends on: those of the links that
    it moves."""
    equations, r = model.mechanism.equations, model.mechanism.dof

    def terms(q: Column, v: Column) -> list[Column]:
        return [row + change for row, change in zip(*momentum_terms(equations, q, v, model.columns), strict=True)]

    k, entries = len(model.columns), trace(terms, {"q": equations.joints, "v": r}).outputs
    always_zero = [isinstance(x, float) and x == 0.0 for x in entries]
    return [[j for j in range(k) if not always_zero[k * i + j]] for i in range(r)]


def require_positive(cutoff: float) -> None:
    """Raise `InputError` for a cutoff that is not positive and finite."""
    positive_number(cutoff, "torque filter: cutoff: expected a positive number in rad/s")


def require_cutoff(cutoff: float, period: float) -> None:
    """Raise `InputError` for a filter that the control period (s) cannot carry."""
    require_positive(cutoff)
    if cutoff * period > 1.0:
        raise InputError(
            f"torque filter: cutoff: {cutoff:g} rad/s is too fast for a control period of {period:g} s; "
            f"use at most {1.0 / period:g} rad/s"
        )
