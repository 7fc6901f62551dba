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
    """Protocol of a null space of a mechanism's energies: the directions of its P inertial parameters D (P,), all but
    friction, that change no energy and no torque, and regroupings of the parameters by them.

    An implementation has the properties `scales` (P,), by which parameters are divided so that those of different units
    are comparable, `rank` and `null_basis`, and the method `regrouping`. There are two: by singular value decomposition
    (`DecomposedNullSpace`), and from a tree's geometry (`TreeNullSpace`).
    """

    @property
    def scales(self) -> Array:
        """The scales (P,), positive, in SI units per J, that make a mechanism's P inertial parameters D comparable: D /
        scales are all in J."""

    @property
    def rank(self) -> int:
        """The rank k: the number of independent directions of a mechanism's P inertial parameters (all but friction)
        that change energies and torques."""

    @property
    def null_basis(self) -> Array:
        """Orthonormal null vectors (P, P-k), without a unit, k the rank: directions of a mechanism's P inertial
        parameters, divided by this object's `scales` (P,), that change no energy and no torque."""

    def regrouping(self, order: Sequence[int], tolerance: float) -> Regrouping:
        """The regrouping that removes P-k of P scaled parameters in an order of removal, k the rank, and adds them to
        the k that are kept.

        `order` (P,) has the parameters' zero-based indices, the first removed first. A parameter is removed where its
        row of the null vectors (P, P-k), less its projection on the rows of those removed before, is longer than
        `tolerance` (without a unit, between 0 and 1/sqrt(P)). An implementation raises `InputError` for another
        tolerance.
        """


def unscaled_bases(scaled_null_basis: Array, scales: Array) -> tuple[Array, Array]:
    """Orthonormal bases, a pair, of the null space of a regressor in P unscaled parameters, V2 (P, P-k), and of its
    orthogonal complement (P, k), k the rank. `scaled_null_basis` (P, P-k), of full column rank, spans the null space of
    the regressor whose columns are multiplied by `scales` (P,), that is, of parameters divided by `scales`. Nothing is
    checked.

    They come from Householder's QR of the vectors mapped back, rows sorted by size and columns pivoted, which keeps
    small rows as accurate as large ones (Cox and Higham 1998). On the PUMA with lengths in m, mm and um, null vectors
    make torques of 9e-16, 1e-15 and 1e-15 of what they could be; with V2 from the singular value decomposition of the
    unscaled matrix, 2e-14, 6e-13 and 6e-10.
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
    """The largest torque that any null vector makes, relative to the largest that a vector of its size could make,
    without a unit; round-off is about 1e-15.

    It is the largest, over the null vectors n_j, of max|Y n_j| / (max|Y S| max|S^-1 n_j|), where S is the diagonal
    matrix of the `scales`, and max|.| the largest entry in size. It is 0 where there are no null vectors, or Y is zero.
    `regressor` Y (n, P) has rows of the torque regressor, in N m per SI unit of each of P parameters; `null_basis` (P,
    P-k) has the n_j, null vectors of the unscaled parameters, as columns, k the rank; `scales` (P,) are in SI units per
    J. Nothing is checked.
    """
    if null_basis.shape[1] == 0 or not regressor.any():
        return 0.0
    largest = np.abs(regressor * scales).max() * np.abs(null_basis / scales[:, None]).max(axis=0)
    return float((np.abs(regressor @ null_basis).max(axis=0) / largest).max())
