"""Ranks and independent columns of matrices in sixty digits, by Gaussian elimination."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from adaptctl.identifiability.proof.digits import BITS, floats

NOTHING, EXACTLY_NOTHING = 1e-10, 1e-40
"""Sizes of what is left, relative to what was there, that count as zero. Relations that hold exactly leave 1e-50; those
that a file's floats hold to round-off leave 1e-12; those that nearly hold, by a miss e, leave e or its square."""
LEAST_COLUMN = 1e-3
"""Floor under the sizes of columns, relative to the largest."""


def pivots(matrix: Any) -> tuple[float, ...]:
    """The sizes, as floats, of the pivots of a `matrix` (m, n) of m rows and n columns by Gaussian elimination with
    complete pivoting, in the order in which they are found. The matrix is an array of Python ints (dtype object), its
    entries times 2^200. Pivots beyond the matrix's rank are round-off or zero, and the first that is below 1e-40 of the
    first pivot, the largest entry, is the last. Empty for an empty matrix. Raises `OverflowError` for entries beyond a
    double."""
    left, found = matrix, list[float]()
    while left.size:
        sizes = np.abs(floats(left))
        row, column = np.unravel_index(int(sizes.argmax()), sizes.shape)
        found.append(float(sizes[row, column]))
        if found[-1] <= EXACTLY_NOTHING * found[0]:
            break
        left = np.delete(_eliminated(left, int(row), int(column)), column, axis=1)
    return tuple(found)


def rank(matrix: Any, nothing: float) -> int:
    """The numerical rank of a `matrix` (m, n) of m rows and n columns: the number of its pivots whose size is above
    `nothing` (no unit) times that of the first, by Gaussian elimination with complete pivoting. The matrix is an array
    of Python ints (dtype object), its entries times 2^200. The rank of an empty or zero matrix is 0. Raises
    `OverflowError` for entries beyond a double."""
    sizes = pivots(matrix)
    return sum(size > nothing * sizes[0] for size in sizes)


def independent_columns(matrix: Any, order: Sequence[int], nothing: float) -> tuple[int, ...]:
    """The zero-based indices of those columns of a `matrix` (m, n) of m rows and n columns that are independent of the
    columns before them in an `order` of column indices, given in that order. The matrix is an array of Python ints
    (dtype object), its entries times 2^200.

    A column is independent where its largest entry, once those taken before are eliminated, is above `nothing` (without
    a unit) times max(a, 1e-3 b), a being the largest entry of the given column and b that of the given matrix, in size.
    Raises `OverflowError` for entries beyond a double, `IndexError` for an index of n or more.
    """
    left, found = matrix, list[int]()
    sizes = np.abs(floats(matrix)).max(axis=0, initial=0.0)
    least = nothing * np.maximum(sizes, LEAST_COLUMN * sizes.max(initial=0.0))
    for column in order:
        rest = np.abs(floats(left[:, column]))
        row = int(rest.argmax()) if rest.size else 0
        if rest.size and rest[row] > least[column]:
            left = _eliminated(left, row, column)
            found.append(column)
    return tuple(found)


def _eliminated(left: Any, row: int, column: int) -> Any:
    """The other rows, less as much of this one that they lose the column."""
    scaled = (left[row] << BITS) // left[row, column]
    rest = np.delete(left, row, axis=0)
    return rest - (rest[:, column, None] * scaled >> BITS)
