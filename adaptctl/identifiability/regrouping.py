"""Which parameters stay, and what each of the others adds to them, among scaled parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identifiability.selection import removable

EXACT_ZERO = 1e-11
"""Regrouping coefficients below are round-off: left in, they would leak large parameters into small ones."""
LARGEST_CONDITION = 1e4
"""of F2' V2 among scaled parameters"""


@dataclass(frozen=True, eq=False)
class Regrouping:
    """kept + coefficients @ removed says all that the parameters say."""

    kept: tuple[int, ...]
    """(k,), rising"""
    removed: tuple[int, ...]
    """(P - k,)"""
    coefficients: Array
    """(k, P - k)"""
    rank: int
    """of the kept columns of a regressor: k, if all is well"""

    @cached_property
    def condition(self) -> float:
        """The condition of F2' V2 (see `condition`)."""
        return condition(self.coefficients)

    @property
    def determined(self) -> bool:
        """Whether the removed parameters determine the kept ones well enough."""
        return self.bound <= LARGEST_CONDITION or self.condition <= LARGEST_CONDITION

    @cached_property
    def bound(self) -> float:
        """At least the condition, and at once: |C|^2 <= |C|_1 |C|_inf."""
        sizes = np.abs(self.coefficients)
        return float(np.sqrt(1.0 + sizes.sum(axis=0).max(initial=0.0) * sizes.sum(axis=1).max(initial=0.0)))

    def matrix(self, scales: Array) -> Array:
        """K (k, P) among unscaled parameters, which are the scaled ones times `scales` (P,)."""
        kept, removed = list(self.kept), list(self.removed)
        coefficients = np.where(np.abs(self.coefficients) < EXACT_ZERO, 0.0, self.coefficients)
        K = np.zeros((len(kept), len(scales)))
        K[:, removed] = coefficients * scales[kept, None] / scales[removed]
        K[range(len(kept)), kept] = 1.0
        return K


def by_null_vectors(null_basis: Array, order: Sequence[int], tolerance: float) -> Regrouping:
    """Remove parameters in an order, as long as their rows of the null basis Z (P, P-k) are independent.

    K = F1' (I - Z (F2' Z)^-1 F2'), equation 25 of Sheu and Walker (1991).
    """
    gone = list(removable(null_basis, order, tolerance))
    kept = sorted(set(order) - set(gone))
    coefficients = np.asarray(-np.linalg.solve(null_basis[gone].T, null_basis[kept].T).T, dtype=np.float64)
    return Regrouping(tuple(kept), tuple(gone), coefficients, len(kept))


def condition(coefficients: Array) -> float:
    """The condition of F2' V2 (Sheu and Walker 1991, equation 25) for regrouping coefficients C (k, n).

    The null vectors are [-C; 1], so F2' V2 = (1 + C'C)^-1/2 but for a rotation. 1 where nothing is removed.
    """
    k, n = coefficients.shape
    if n == 0:
        return 1.0
    values = np.linalg.svd(coefficients, compute_uv=False)
    smallest = values[-1] if k >= n else 0.0
    return float(np.sqrt((1.0 + values[0] ** 2) / (1.0 + smallest**2)))
