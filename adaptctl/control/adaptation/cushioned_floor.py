"""Composite adaptation with least squares that forget towards what was known at the start."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array, frozen_array
from adaptctl.control.adaptation.composite import residual
from adaptctl.control.adaptation.gain import numbers, require_size
from adaptctl.control.adaptation.law import AdaptationLaw, Period
from adaptctl.control.adaptation.prediction import Filtered, TorqueFilter, require_cutoff
from adaptctl.control.gains.gains import per_joint
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar


class Floored(NamedTuple):
    """What the law remembers."""

    information: Any
    """(k (k + 1)/2,) the upper triangle, row by row, of S P^-1 S, S = Gamma^1/2: the identity at the start"""
    filtered: Filtered


@dataclass(frozen=True, eq=False)
class CushionedFloor(AdaptationLaw[Floored]):
    """estimate' = -P (Y's + W'R (W estimate - F[tau])), (P^-1)' = -lambda (P^-1 - Gamma^-1) + W'R W
    (Slotine and Li 1989).

    The information P^-1 starts at its floor Gamma^-1, Gamma = diag(`gain`) (k,). `forgetting` is lambda in 1/s;
    `weight` R (r,) and `cutoff` (1/s) are those of `Composite`.

    Guarantees, without disturbance: P <= Gamma, and V = s'Ms/2 + error' P^-1 error/2 falls as -s'Ks - eps'R eps/2
    - lambda error' (P^-1 - Gamma^-1) error/2, eps = W error: s and eps go to zero, and under persistent excitation
    s and the error exponentially. Every direction forgets for itself: what W sees is forgotten and learned anew at
    lambda, what it does not see keeps the gain Gamma. `BoundedGainForgetting` has one lambda(t) for all, and where
    some directions are not excited they bring it, and with it all learning, to a stop.

    Gives up: what `Composite` does. Costs k^3/3 operations a period, a Cholesky factorisation, and a memory of
    k (k + 1)/2.
    """

    gain: Array
    weight: Array = 1.0  # type: ignore[assignment]  # a number becomes an array for the model's joints
    cutoff: float = 20.0
    forgetting: float = 1.0

    def __post_init__(self) -> None:
        gain = frozen_array(self.gain, (np.size(self.gain),), "cushioned floor: gain")
        if np.any(gain <= 0.0):
            raise InputError("cushioned floor: gain: expected positive numbers (k,)")
        object.__setattr__(self, "gain", gain)
        per_joint(self.weight, np.size(self.weight), "cushioned floor: weight")
        if not (np.isfinite(self.forgetting) and self.forgetting >= 0.0):
            raise InputError(f"cushioned floor: forgetting: expected at least 0 1/s, got {self.forgetting}")

    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """A gain for each parameter, a weight for each joint, and a filter that the period carries."""
        require_size(self.gain, model, "cushioned floor: gain")
        per_joint(self.weight, model.mechanism.dof, "cushioned floor: weight")
        require_cutoff(self.cutoff, period)

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> Floored:
        """P = Gamma, and the filters at rest."""
        identity = np.eye(len(self.gain))[np.triu_indices(len(self.gain))]
        return Floored(identity, TorqueFilter(self.cutoff, period).start(model, q, v))

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Floored) -> tuple[Column, Floored]:
        """Forget by the implicit rule, learn what the period told, and descend by what is known then."""
        rows, torque, filtered = TorqueFilter(self.cutoff, period.length).predicted(model, period, memory.filtered)
        scaled = [self._scale * row for row in rows]
        weights = per_joint(self.weight, model.mechanism.dof, "cushioned floor: weight").tolist()
        share = self.forgetting * period.elapsed
        keep = 1.0 / (1.0 + share)
        information = [
            [keep * (x + share) if i == j else keep * x for j, x in enumerate(row, start=i)]
            for i, row in enumerate(_triangle(memory.information, len(estimate)))
        ]
        slope = self._scale * period.gradient(period.integral)
        for row, weight, miss in zip(scaled, weights, residual(rows, estimate, torque), strict=True):
            heavy = (period.elapsed * weight) * row
            information = [
                [x + heavy[i] * y for x, y in zip(upper, row.of[i:], strict=True)]
                for i, upper in enumerate(information)
            ]
            slope = slope + miss * heavy
        step = solve_symmetric(_full(information), slope)
        after = Column(x for upper in information for x in upper)
        return estimate - self._scale * step, Floored(after, filtered)

    def covariance(self, memory: Floored) -> Array:
        """P (k, k), in units of the parameters squared per J s."""
        k = len(self.gain)
        upper = np.zeros((k, k))
        upper[np.triu_indices(k)] = memory.information
        scale = np.sqrt(self.gain)
        return np.asarray(np.linalg.inv(upper + np.triu(upper, 1).T) * np.outer(scale, scale))

    @cached_property
    def _scale(self) -> Column:
        return numbers(np.sqrt(self.gain))


def _triangle(entries: Column, k: int) -> list[list[Scalar]]:
    """Rows of an upper triangle, each from its diagonal entry on."""
    starts = [i * k - i * (i - 1) // 2 for i in range(k + 1)]
    return [list(entries.of[a:b]) for a, b in pairwise(starts)]


def _full(upper: list[list[Scalar]]) -> list[list[Scalar]]:
    """The symmetric matrix."""
    k = len(upper)
    return [[upper[min(i, j)][max(i, j) - min(i, j)] for j in range(k)] for i in range(k)]
