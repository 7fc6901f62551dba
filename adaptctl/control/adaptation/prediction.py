"""What the estimate says of the torque, filtered so that no acceleration is needed."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import Any, NamedTuple

import numpy as np

from adaptctl.control.adaptation.law import Period
from adaptctl.dynamics.arrays import column, stacked
from adaptctl.dynamics.momentum import momentum_terms
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.mechanism.pose import Array
from adaptctl.scalars import Column


class Filtered(NamedTuple):
    """The filters' memory."""

    regressor: Any
    """(r k,) rows of F[lambda H + N], as far as it is known before the next sample"""
    torque: Any
    """(r,) F[tau], N m"""


class Prediction(NamedTuple):
    """A linear equation for the true parameters: W beta = torque, as far as nothing disturbs."""

    rows: list[Column]
    """W (r, k)"""
    torque: Column
    """F[tau] (r,), N m"""
    after: Filtered


@dataclass(frozen=True)
class TorqueFilter:
    """tau = Y(p, v, a) beta behind the filter F = lambda/(d/dt + lambda), by parts (Slotine and Li 1989).

    With tau = d/dt (H beta) - N beta, H the momenta's regressor, F[Y] = W = lambda H - F[lambda H + N] when
    F[H] starts at H: positions and velocities are enough. The torque is held over each period, for which its
    filter is exact; lambda H + N goes in by the trapezium between samples, exact to T_c^2. `cutoff` is lambda
    in 1/s, `period` T_c in s.
    """

    cutoff: float
    period: float

    def start(self, model: ReducedModel, q: Array, v: Array) -> Filtered:
        """Before the first tick, at configurations q (..., n) and velocities v (..., r): W is zero there."""
        momentum, forces = momentum_terms(model.mechanism.equations, column(q), column(v), model.columns)
        kept = []
        for row, change in zip(momentum, forces, strict=True):
            scaled = self.cutoff * row
            kept += list(scaled - self._new * (scaled + change))
        return Filtered(stacked(kept, q.shape[:-1]), np.zeros(model.mechanism.dof))

    def predicted(self, model: ReducedModel, period: Period, memory: Filtered) -> Prediction:
        """The equation now, from configuration and velocities now and the torque of the period that has passed."""
        momentum, forces = momentum_terms(model.mechanism.equations, period.q, period.v, model.columns)
        k, keep = len(model.columns), self._keep
        rows, before = [], []
        for i, (row, change) in enumerate(zip(momentum, forces, strict=True)):
            scaled = self.cutoff * row
            now = scaled + change
            filtered = Column(memory.regressor.of[k * i : k * (i + 1)]) + self._new * now
            rows.append(scaled - filtered)
            before.append(keep * filtered + self._old * now)
        torque = keep * memory.torque + (1.0 - keep) * period.torque
        return Prediction(rows, torque, Filtered(Column(x for row in before for x in row), torque))

    @property
    def _keep(self) -> float:
        """How much of a filter's state is left after a period."""
        return exp(-self.cutoff * self.period)

    @property
    def _new(self) -> float:
        """Weight of a linear input's value at the end of a period."""
        return 1.0 - (1.0 - self._keep) / (self.cutoff * self.period)

    @property
    def _old(self) -> float:
        """Weight of its value at the start."""
        return 1.0 - self._keep - self._new


def require_cutoff(cutoff: float, period: float) -> None:
    """Refuse a filter that the control period cannot carry."""
    if not (np.isfinite(cutoff) and cutoff > 0.0):
        raise InputError(f"torque filter: cutoff: expected a positive number in 1/s, got {cutoff}")
    if cutoff * period > 1.0:
        raise InputError(
            f"torque filter: cutoff: {cutoff:g} 1/s is too fast for a control period of {period:g} s; "
            f"use at most {1.0 / period:g} 1/s"
        )
