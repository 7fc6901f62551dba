"""Which parameters can be removed without losing anything, by modified Gram-Schmidt."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError

TOLERANCE = 1e-3
"""Of the scaled null vectors' rows. Real robots leave nothing between 1e-4 and 0.1; tighter ones take a
rounded right angle for independence, as Table 5 of Sheu and Walker (1991) shows."""


def require_tolerance(tolerance: float, parameters: int) -> None:
    """Refuse a tolerance that could not find all of P - k rows."""
    most = 1.0 / np.sqrt(parameters)
    if not 0.0 < tolerance < most:
        raise InputError(f"tolerance: expected a number between 0 and {most:.2g}, got {tolerance:g}")


def removable(null_basis: Array, order: Iterable[int], tolerance: float) -> tuple[int, ...]:
    """Rows of `null_basis` (P, P-k) that are independent, met in this order: the parameters to remove.

    A row is taken when what is left of it beside the rows already taken is longer than `tolerance` (Sheu and
    Walker 1991, theorem 4.1), orthogonalised twice so that round-off cannot pass for independence. The columns
    are orthonormal, so what is left of all rows together never vanishes before P-k are taken: a tolerance
    below 1/sqrt(P) always finds them all.
    """
    rows, needed = null_basis.shape
    require_tolerance(tolerance, rows)
    left, directions, taken = null_basis.copy(), np.zeros((0, needed)), list[int]()
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
    return tuple(taken)
