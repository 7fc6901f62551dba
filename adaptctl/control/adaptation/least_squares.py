"""Least squares with a gain that follows the information: settings of those that forget, and symmetric matrices."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from adaptctl.arrays import Array, frozen_array, numbers
from adaptctl.control.adaptation.gain import require_size
from adaptctl.control.adaptation.law import AdaptationLaw
from adaptctl.control.adaptation.prediction import require_cutoff, require_positive
from adaptctl.control.gains.gains import positive_per_joint
from adaptctl.control.memory import Memory
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column, sqrt


@dataclass(frozen=True, eq=False)
class ForgettingLeastSquares(AdaptationLaw[Memory]):
    """Base class of least squares that forget, from a first covariance P = Gamma = diag(`gain`) (k,).

    `weight` is R in 1/(N m s), one number or one a joint (r,), `cutoff` the torque filter's in rad/s and `forgetting`
    the rate at which the past is forgotten in 1/s.
    """

    called: ClassVar[str]

    gain: Array
    weight: Array = 1.0  # type: ignore[assignment]  # a number becomes an array for the model's joints
    cutoff: float = 20.0
    forgetting: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if (gain := numbers(self.gain, f"{self.called}: gain", "(k,)")).ndim != 1:
            raise InputError(f"{self.called}: gain: expected Gamma's diagonal (k,), got shape {gain.shape}")
        gain = frozen_array(gain, gain.shape, f"{self.called}: gain")
        if np.any(gain <= 0.0):
            raise InputError(f"{self.called}: gain: expected positive numbers (k,)")
        object.__setattr__(self, "gain", gain)
        self._require_weights(np.size(self.weight))
        require_positive(self.cutoff)
        if not (np.isfinite(self.forgetting) and self.forgetting >= 0.0):
            raise InputError(f"{self.called}: forgetting: expected at least 0 1/s, got {self.forgetting}")

    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """Raise `InputError` unless gain, weight and cutoff fit the parameters, the joints and the period (s)."""
        require_size(self.gain, model, f"{self.called}: gain")
        self._require_weights(model.mechanism.dof)
        require_cutoff(self.cutoff, period)

    def _require_weights(self, dof: int) -> None:
        positive_per_joint(self.weight, dof, f"{self.called}: weight")

    @property
    def _scale(self) -> Column:
        """Gamma^1/2 (k,): in its units P and the parameters' errors are near 1."""
        return Column(map(sqrt, column(self.gain)))


def first_triangle(k: int) -> Array:
    """The identity (k, k), as the upper triangle of a symmetric matrix, row by row (k (k + 1)/2,)."""
    return np.eye(k)[np.triu_indices(k)]


def from_triangle(entries: Array, k: int) -> Array:
    """The symmetric matrix (k, k) with an upper triangle (k (k + 1)/2,), row by row."""
    upper = np.zeros((k, k))
    upper[np.triu_indices(k)] = entries
    return upper + np.triu(upper, 1).T


def upper_rows(entries: Column, k: int) -> list[list[Scalar]]:
    """Rows of a symmetric matrix's upper triangle, each from its diagonal entry on."""
    return [list(entries.of[a:b]) for a, b in pairwise(_starts(k))]


def full_rows(upper: list[list[Scalar]]) -> list[list[Scalar]]:
    """The rows (k, k) of a symmetric matrix, from those of its upper triangle."""
    k = len(upper)
    return [[upper[min(i, j)][max(i, j) - min(i, j)] for j in range(k)] for i in range(k)]


def symmetric_product(entries: Column, vector: Column) -> Column:
    """The product (k,) of a symmetric matrix, given by its upper triangle, and a vector (k,)."""
    rows = full_rows(upper_rows(entries, len(vector)))
    return Column(Column(row) @ vector for row in rows)


def symmetric_trace(entries: Column, k: int) -> Scalar:
    """The trace of a symmetric matrix, given by its upper triangle."""
    diagonal = [entries[start] for start in _starts(k)[:-1]]
    return sum(diagonal[1:], diagonal[0])


def _starts(k: int) -> list[int]:
    """Indices in an upper triangle's entries at which each row begins, and at which the last ends."""
    return [i * k - i * (i - 1) // 2 for i in range(k + 1)]
