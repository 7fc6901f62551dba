"""The null space of a regressor, found among scaled parameters and brought back to unscaled ones."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identifiability.numerical_rank import triangle


def unscaled_bases(scaled_null_basis: Array, scales: Array) -> tuple[Array, Array]:
    """Orthonormal bases of the null space among the unscaled parameters, V2, and of its complement.

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
    sorted_basis, _ = np.linalg.qr(_pivoted(vectors[order]), mode="complete")
    orthonormal = np.empty(sorted_basis.shape)
    orthonormal[order] = sorted_basis
    size = vectors.shape[1]
    return orthonormal[:, :size], orthonormal[:, size:]


def _pivoted(matrix: Array) -> Array:
    """The columns, each time the one farthest from the span of those before (Businger and Golub 1965).

    What remains of them is followed by modified Gram-Schmidt on the triangle. (scipy.linalg.qr can pivot, but takes
    0.1 s to import.)
    """
    rest = triangle(matrix).copy()
    order: list[int] = []
    for _ in range(matrix.shape[1]):
        sizes = np.einsum("ij,ij->j", rest, rest)
        sizes[order] = -1.0
        order.append(int(np.argmax(sizes)))
        direction = rest[:, order[-1]] / np.sqrt(sizes[order[-1]])
        rest -= np.outer(direction, direction @ rest)
    return matrix[:, order]


def null_residual(regressor: Array, null_basis: Array, scales: Array) -> float:
    """The largest torque of any null vector, over the largest that a vector of its size could make."""
    if null_basis.shape[1] == 0:
        return 0.0
    largest = np.abs(regressor * scales).max() * np.abs(null_basis / scales[:, None]).max(axis=0)
    return float((np.abs(regressor @ null_basis).max(axis=0) / largest).max())
