"""Composite adaptation with a gain that follows the information: least squares that forget, within a bound."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array, frozen_array
from adaptctl.compilation import outlined
from adaptctl.control.adaptation.gain import numbers, require_size
from adaptctl.control.adaptation.law import AdaptationLaw, Period
from adaptctl.control.adaptation.prediction import Filtered, TorqueFilter, require_cutoff
from adaptctl.control.gains.gains import per_joint
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar


class Information(NamedTuple):
    """What least squares remember."""

    covariance: Any
    """(k (k + 1)/2,) the upper triangle, row by row, of P in units of the first gain: the identity at the start"""
    filtered: Filtered


@dataclass(frozen=True, eq=False)
class BoundedGainForgetting(AdaptationLaw[Information]):
    """estimate' = -P (Y's + W'R (W estimate - F[tau])), P' = lambda(t) P - P W'R W P (Slotine and Li 1989).

    lambda(t) = forgetting (1 - tr(Gamma^-1 P)/(k bound)). P starts at Gamma = diag(`gain`) (k,); `weight` R
    (r,) and `cutoff` (1/s) are those of `Composite`; `forgetting` is in 1/s; `bound` of at least 1 is how far
    the mean gain may rise above Gamma.

    Guarantees, without disturbance: 0 < P, tr(Gamma^-1 P) <= k bound, and V = s'Ms/2 + error' P^-1 error/2
    falls as -s'Ks - eps'R eps/2 - lambda(t) error' P^-1 error/2, eps = W error: s and eps go to zero. Under
    persistent excitation lambda(t) stays positive, and s and the error go to zero exponentially. Every period
    is solved implicitly, one joint's equation after the other, which keeps P positive definite.

    Gives up: what `Composite` does. Without excitation P grows to its bound along what W does not see, where
    noise then moves the estimate fastest. And there is one lambda(t) for all directions: it settles at
    forgetting/(1 + forgetting c/(k bound)), c the trace of the inverse of Gamma^1/2 W'R W Gamma^1/2 on average,
    which is large where some direction is hardly excited. Then nothing is forgotten, however fast the forgetting, P
    shrinks along all that W sees, and a parameter that changes, a payload, is not learned any more (`CushionedFloor`
    is). It is for parameters that are constant. Costs k^2 operations a joint and a memory of k (k + 1)/2.
    """

    gain: Array
    weight: Array = 1.0  # type: ignore[assignment]  # a number becomes an array for the model's joints
    cutoff: float = 20.0
    forgetting: float = 1.0
    bound: float = 2.0

    def __post_init__(self) -> None:
        gain = frozen_array(self.gain, (np.size(self.gain),), "bounded-gain forgetting: gain")
        if np.any(gain <= 0.0):
            raise InputError("bounded-gain forgetting: gain: expected positive numbers (k,)")
        object.__setattr__(self, "gain", gain)
        per_joint(self.weight, np.size(self.weight), "bounded-gain forgetting: weight")
        if not (np.isfinite(self.forgetting) and self.forgetting >= 0.0):
            raise InputError(f"bounded-gain forgetting: forgetting: expected at least 0 1/s, got {self.forgetting}")
        if not (np.isfinite(self.bound) and self.bound >= 1.0):
            raise InputError(f"bounded-gain forgetting: bound: expected at least 1, got {self.bound}")

    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """A gain for each parameter, a weight for each joint, and rates that the period carries."""
        require_size(self.gain, model, "bounded-gain forgetting: gain")
        per_joint(self.weight, model.mechanism.dof, "bounded-gain forgetting: weight")
        require_cutoff(self.cutoff, period)
        if self.forgetting * period > 0.1:
            raise InputError(
                f"bounded-gain forgetting: forgetting: {self.forgetting:g} 1/s is too fast for a control period of "
                f"{period:g} s; use at most {0.1 / period:g} 1/s"
            )

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> Information:
        """P = Gamma, and the filters at rest."""
        identity = np.eye(len(self.gain))[np.triu_indices(len(self.gain))]
        return Information(identity, TorqueFilter(self.cutoff, period).start(model, q, v))

    def law(
        self, model: ReducedModel, estimate: Column, period: Period, memory: Information
    ) -> tuple[Column, Information]:
        """The trapezium for the tracking error, then each joint's equation, then forgetting."""
        covariance, scale = memory.covariance, self._scale
        gradient = scale * period.gradient(period.integral)
        moved = estimate - scale * times(covariance, gradient)
        rows, torque, filtered = TorqueFilter(self.cutoff, period.length).predicted(model, period, memory.filtered)
        for row, wanted, weight in zip(rows, torque, self._weights(model), strict=True):
            firm = 1.0 / (weight * period.length)
            step, covariance = _updated(covariance, scale * row, row @ moved - wanted, firm, period.share)
            moved = moved - scale * step
        rate = self.forgetting * (1.0 - trace(covariance, len(estimate)) * (1.0 / (self.bound * len(estimate))))
        return moved, Information((1.0 + period.elapsed * rate) * covariance, filtered)

    def covariance(self, memory: Information) -> Array:
        """P (k, k), in units of the parameters squared per J s."""
        k = len(self.gain)
        upper = np.zeros((k, k))
        upper[np.triu_indices(k)] = memory.covariance
        scale = np.sqrt(self.gain)
        return (upper + np.triu(upper, 1).T) * np.outer(scale, scale)

    def _weights(self, model: ReducedModel) -> list[float]:
        weights: list[float] = per_joint(self.weight, model.mechanism.dof, "weight").tolist()
        return weights

    @cached_property
    def _scale(self) -> Column:
        return numbers(np.sqrt(self.gain))


def _update(covariance: Column, row: Column, miss: Scalar, firm: Scalar, share: Scalar) -> tuple[Column, Column]:
    """What one equation, missed by `miss`, takes from the estimate, and the covariance after it.

    `firm` is the variance of the equation; a share of 0 leaves everything as it is.
    """
    k = len(row)
    gain = times(covariance, row)
    weight = share * (1.0 / (row @ gain + firm))
    scaled = weight * gain
    pairs = ((i, j) for i in range(k) for j in range(i, k))
    after = Column(p - scaled[i] * gain[j] for p, (i, j) in zip(covariance, pairs, strict=True))
    return miss * scaled, after


_updated = outlined(_update)


def times(covariance: Column, column: Column) -> Column:
    """A symmetric matrix, given by its upper triangle, times a column."""
    k = len(column)
    starts = [i * k - i * (i - 1) // 2 for i in range(k)]  # where row i begins, with its diagonal entry

    def row(i: int) -> Column:
        return Column(covariance[starts[min(i, j)] + max(i, j) - min(i, j)] for j in range(k))

    return Column(row(i) @ column for i in range(k))


def trace(covariance: Column, k: int) -> Any:
    """The sum of the diagonal of a symmetric matrix, given by its upper triangle."""
    diagonal = [covariance[i * k - i * (i - 1) // 2] for i in range(k)]
    return sum(diagonal[1:], diagonal[0])
