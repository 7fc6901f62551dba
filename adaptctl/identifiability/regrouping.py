"""Regrouping among scaled parameters: those that are kept, and what each of the removed ones adds to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.identifiability.selection import removed_and_passed_over

EXACT_ZERO = 1e-11
"""Size below which regrouping coefficients are round-off: left in, they would leak large parameters into small ones."""
ROUND_OFF = 1e-13
"""Relative distance from a whole number that is round-off."""
LARGEST_CONDITION = 1e4
"""Largest condition of F2' V2 among scaled parameters."""
LARGEST_BOUND = 1e7
"""Largest bound of that condition at which Cholesky's factor does not drown in round-off."""


@dataclass(frozen=True, eq=False)
class Regrouping:
    """A regrouping of P scaled parameters onto the kept ones: kept + coefficients @ removed gives the same torques as
    all."""

    kept: tuple[int, ...]
    """Indices (k,), rising."""
    removed: tuple[int, ...]
    """Indices (P - k,), in any order."""
    coefficients: Array
    """Coefficients C (k, P - k) of the removed parameters on the kept ones."""
    rank: int
    """Rank of a regressor's kept columns: k, if all is well."""
    passed_over: tuple[int, ...] = ()
    """Kept parameters that the order alone would remove: so little of their rows is left that others go instead."""

    @cached_property
    def condition(self) -> float:
        """The condition number of F2' V2 (see `condition`)."""
        return condition(self.coefficients)

    @property
    def determined(self) -> bool:
        """True if the condition number, or its bound, is at most LARGEST_CONDITION: the null vectors determine the
        coefficients well enough."""
        return self.bound <= LARGEST_CONDITION or self.condition <= LARGEST_CONDITION

    @cached_property
    def bound(self) -> float:
        """An upper bound of the condition that needs no factorisation: |C|^2 <= |C|_1 |C|_inf."""
        sizes = np.abs(self.coefficients)
        return float(np.sqrt(1.0 + sizes.sum(axis=0).max(initial=0.0) * sizes.sum(axis=1).max(initial=0.0)))

    def leaves_more_than(self, tolerance: float, order: Sequence[int]) -> bool:
        """True if each removed parameter's row of an orthonormal null basis leaves more than a tolerance beside those
        removed before it in the order (P,).

        With the null vectors [-C; 1] = Z B, the removed rows of Z are A = B^-1, and A A' = L L' = (1 + C'C)^-1: what is
        left of them is on the diagonal of L, from the last to the first that of Cholesky's factor of 1 + C'C.
        """
        if self.bound * tolerance < 1.0 or self.bound > LARGEST_BOUND:
            return self.bound * tolerance < 1.0
        places = {parameter: place for place, parameter in enumerate(order)}
        backward = sorted(range(len(self.removed)), key=lambda i: -places[self.removed[i]])
        C = self.coefficients[:, backward]
        factor = np.linalg.cholesky(np.eye(len(backward)) + C.T @ C)
        return bool(np.diagonal(factor).max(initial=1.0) * tolerance < 1.0)

    def matrix(self, scales: Array) -> Array:
        """The regrouping matrix K (k, P) among unscaled parameters, which are the scaled ones times `scales` (P,)."""
        kept, removed = np.array(self.kept, dtype=np.intp), np.array(self.removed, dtype=np.intp)
        i, j = np.nonzero(np.abs(self.coefficients) >= EXACT_ZERO)
        rows, columns = kept[i], removed[j]
        values = self.coefficients[i, j] * scales[rows] / scales[columns]
        whole = (
            values.round()
        )  # as -1 and 1 are by geometry: a product with them is left out, whatever the last bits are
        K = np.zeros((len(kept), len(scales)))
        K[i, columns] = np.where(np.abs(values - whole) <= ROUND_OFF * np.abs(whole), whole, values)
        K[range(len(kept)), kept] = 1.0
        return K


def by_null_vectors(null_basis: Array, order: Sequence[int], tolerance: float) -> Regrouping:
    """The regrouping that removes parameters in an order, as far as their rows of the null basis Z (P, P-k) allow.

    K = F1' (I - Z (F2' Z)^-1 F2'), equation 25 of Sheu and Walker (1991).
    """
    gone, passed_over = removed_and_passed_over(null_basis, order, tolerance)
    kept, removed = sorted(set(order) - set(gone)), list(gone)
    coefficients = np.asarray(-np.linalg.solve(null_basis[removed].T, null_basis[kept].T).T, dtype=np.float64)
    return Regrouping(tuple(kept), gone, coefficients, len(kept), passed_over)


def condition(coefficients: Array) -> float:
    """The condition number of F2' V2 (Sheu and Walker 1991, equation 25) for regrouping coefficients C (k, n).

    The null vectors are [-C; 1], so F2' V2 = (1 + C'C)^-1/2 but for a rotation, and the condition is the root of
    (1 + sigma_max^2) / (1 + sigma_min^2), with C's n singular values. 1 where nothing is removed.
    """
    k, n = coefficients.shape
    if n == 0:
        return 1.0
    values = np.linalg.svd(coefficients, compute_uv=False)
    smallest = values[-1] if k >= n else 0.0
    return float(np.sqrt((1.0 + values[0] ** 2) / (1.0 + smallest**2)))
