"""Independent rows and columns, chosen one after another by modified Gram-Schmidt.

There are two functions, for two questions. `removable` walks an order that a user gives, over null vectors of a whole
mechanism down to any tolerance, so it orthogonalises twice; only the choice counts. `independent_columns` falls back on
the largest column and gives directions to go on with. Neither needs SciPy, whose `qr` pivots by size alone and takes
0.1 s to import.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from adaptctl.arrays import Array, real_number
from adaptctl.errors import InputError

TOLERANCE = 1e-3
"""Length of the scaled null vectors' rows that counts as zero. Real robots leave nothing between 1e-4 and 0.1; tighter
tolerances take a rounded right angle for independence, as Table 5 of Sheu and Walker (1991) shows."""

CLEAR = 1e-8
"""Length of such a row that is more than round-off, and so independent beyond doubt."""


def require_tolerance(tolerance: float, parameters: int) -> None:
    """Raise `InputError` unless a `tolerance` is a number above 0 and below 1/sqrt(P), P the number of `parameters`. A
    row of the orthonormal null vectors (P, P-k), k the rank, counts as independent where it, less its projection on the
    rows taken before, is longer than the tolerance (no unit); a larger tolerance may not find all P-k independent
    rows."""
    most = 1.0 / np.sqrt(max(parameters, 1))
    if not 0.0 < real_number(tolerance, "tolerance") < most:
        raise InputError(f"tolerance: expected a number between 0 and {most:.2g}, got {tolerance:g}")


def removable(null_basis: Array, order: Iterable[int], tolerance: float) -> tuple[int, ...]:
    """Zero-based indices (P-k,) of the parameters to remove: of the rows of the orthonormal null vectors `null_basis`
    (P, P-k) that are independent, met in an `order` of row indices, the first removed first, and given in that order. A
    row is independent where it, less its projection on the rows taken before, is longer than `tolerance`, without a
    unit. Raises `InputError` for a tolerance that is not between 0 and 1/sqrt(P)."""
    return removed_and_passed_over(null_basis, order, tolerance)[0]


def removed_and_passed_over(
    null_basis: Array, order: Iterable[int], tolerance: float
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The pair of the P-k parameters to remove and of those passed over, as zero-based indices of rows of the
    orthonormal null vectors `null_basis` (P, P-k), met in an `order` of row indices and given in that order. Those to
    remove have independent rows; those passed over are independent, too, but only by more than round-off (1e-8), not by
    `tolerance`.

    A row is taken when it, less its projection on the rows already taken, is longer than `tolerance`, without a unit
    (Sheu and Walker 1991, theorem 4.1); the projection is subtracted twice, so that round-off cannot pass for
    independence. The columns are orthonormal, so that what is left of all rows together does not vanish before P-k are
    taken: a tolerance below 1/sqrt(P) always finds them all, if the order has all P. Raises `InputError` for any other
    tolerance.
    """
    rows, needed = null_basis.shape
    require_tolerance(tolerance, rows)
    left, directions, taken, passed = null_basis.copy(), np.zeros((0, needed)), list[int](), list[int]()
    for j in order:
        if len(taken) == needed:
            break
        again = left[j] - (left[j] @ directions.T) @ directions
        size = float(np.linalg.norm(again))
        if size > tolerance:
            direction = again / size
            left -= np.outer(left @ direction, direction)
            directions = np.vstack([directions, direction])
            taken.append(j)
        elif size > CLEAR:
            passed.append(j)
    return tuple(taken), tuple(passed)


def independent_columns(columns: Array, tolerance: float, negligible: float) -> tuple[list[int], Array]:
    """Zero-based indices (c,) of c independent ones of the n columns of `columns` (r, n), in the order in which they
    are taken, and orthonormal directions (c, r), without a unit, that they span, as a pair. Nothing is checked.

    At each step the first column is taken whose part orthogonal to those taken before is longer than `tolerance`, in
    the columns' unit; where there is none, the one whose orthogonal part is longest, if that is longer than
    `negligible`, in the same unit, and else no more are taken. With an infinite tolerance this is column pivoting
    (Businger and Golub 1965).
    """
    left, taken = columns.T.copy(), list[int]()
    directions = np.empty((min(columns.shape), len(columns)))
    for k in range(len(directions)):
        sizes = np.vecdot(left, left)
        best = int((sizes > tolerance**2).argmax())
        if not sizes[best] > tolerance**2:
            best = int(sizes.argmax())
            if sizes[best] <= negligible**2:
                break
        directions[k] = left[best] / math.sqrt(sizes[best])
        left -= (left @ directions[k])[:, None] * directions[k]
        left[best] = 0.0  # of what was taken nothing is left, whatever round-off says
        taken.append(best)
    return taken, directions[: len(taken)]
