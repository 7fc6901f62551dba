"""Least squares with a gain that follows the information: settings of those that forget, and symmetric matrices."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from adaptctl.arrays import Array, frozen_array, numbers
from adaptctl.control.adaptation.gain import require_size
from adaptctl.control.adaptation.law import AdaptationLaw
from adaptctl.control.adaptation.prediction import require_cutoff, require_no_known_share, require_positive
from adaptctl.control.gains.gains import positive_numbers, positive_per_joint
from adaptctl.control.memory import Memory
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column, sqrt


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
    weight: Array = 1.0  # type: ignore[assignment]  # a number becomes an array for the model's joints
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
        positive_numbers(self.weight, f"{self.called}: weight")
        require_positive(self.cutoff)
        if not (np.isfinite(self.forgetting) and self.forgetting >= 0.0):
            raise InputError(f"{self.called}: forgetting: expected at least 0 1/s, got {self.forgetting}")

    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """Raise `InputError` unless the adaptation law fits the `model`, of k parameters and r joints, and the control
        `period` T_c (s). Required are an adaptation gain of k numbers, one positive weight of prediction errors or one
        for each joint, a cutoff of the torque filter (rad/s) of at most 1/T_c, and no linear constraint that fixes a
        parameter of the mechanism at a value other than zero.

        `initial`, the initial estimate (k,), is not used. The controller, not this method, checks that T_c is positive.
        """
        require_size(self.gain, model, f"{self.called}: gain")
        require_no_known_share(model, self.called)
        self._require_weights(model.mechanism.dof)
        require_cutoff(self.cutoff, period)

    def _require_weights(self, dof: int) -> None:
        positive_per_joint(self.weight, dof, f"{self.called}: weight")

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
