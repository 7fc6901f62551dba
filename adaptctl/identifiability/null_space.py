"""The null space of energies, whichever way it was found: what it offers, its unscaled bases, and its residual."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identifiability.factorisation import triangle
from adaptctl.identifiability.regrouping import Regrouping
from adaptctl.identifiability.selection import independent_columns


class NullSpace(Protocol):
    """Protocol of a null space: the combinations of P scaled parameters D / scales that change no energy, and the
    regrouping through them."""

    @property
    def scales(self) -> Array:
        """Scales (P,) that make parameters of different units comparable."""

    @property
    def rank(self) -> int:
        """The number of independent parameters k."""

    @property
    def null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k) among the scaled parameters."""

    def regrouping(self, order: Sequence[int], tolerance: float) -> Regrouping:
        """The regrouping that removes parameters in an order (P,), as long as their rows exceed a tolerance."""


def unscaled_bases(scaled_null_basis: Array, scales: Array) -> tuple[Array, Array]:
    """Orthonormal bases of the null space among the unscaled parameters, V2 (P, P-k), and of its complement (P, k).

    `scaled_null_basis` (P, P-k) is a null space of (regressor * scales). Householder QR of its vectors mapped
    back, rows sorted by size and columns pivoted, which keeps small rows as accurate as large ones (Cox and
    Higham 1998). Measured on the PUMA with lengths in m, mm and um: torques of null vectors 9e-16, 1e-15 and
    1e-15 of what they could be, against 2e-14, 6e-13 and 6e-10 when V2 comes from the singular value
    decomposition of the unscaled H.
    """
    if scaled_null_basis.shape[1] == 0:
        return scaled_null_basis, np.eye(len(scales))
    vectors = scaled_null_basis * scales[:, None]
    order = np.argsort(-np.abs(vectors).max(axis=1), kind="stable")
    vectors = vectors[order]
    pivots, _ = independent_columns(triangle(vectors), np.inf, 0.0)
    sorted_basis, _ = np.linalg.qr(vectors[:, pivots], mode="complete")
    orthonormal = np.empty(sorted_basis.shape)
    orthonormal[order] = sorted_basis
    size = vectors.shape[1]
    return orthonormal[:, :size], orthonormal[:, size:]


def null_residual(regressor: Array, null_basis: Array, scales: Array) -> float:
    """The largest torque of any null vector, relative to the largest that a vector of its size could make.

    The torque regressor (rows, P) and the null basis (P, P-k) are unscaled; zero where nothing is null, or all is.
    """
    if null_basis.shape[1] == 0 or not regressor.any():
        return 0.0
    largest = np.abs(regressor * scales).max() * np.abs(null_basis / scales[:, None]).max(axis=0)
    return float((np.abs(regressor @ null_basis).max(axis=0) / largest).max())
