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
    """A regrouping of P scaled parameters onto k kept ones, by which these, with the removed ones times `coefficients`
    added, give the same energies and torques as all P.

    Scaled parameters are those of a mechanism divided by scales (P,) that make them comparable, all in J. `kept` (k,),
    in ascending order, and `removed` (P-k,), in any order, are zero-based indices; `coefficients` C (k, P-k) are
    without a unit; `rank` is the rank of a regressor's kept columns, k if they are independent, or if no regressor was
    looked at; `passed_over` has the indices of kept parameters that the order of removal would remove, but that those
    removed before determine up to the tolerance. Nothing is checked at construction.
    """

    kept: tuple[int, ...]
    """Indices (k,), in ascending order."""
    removed: tuple[int, ...]
    """Indices (P - k,), in any order."""
    coefficients: Array
    """Coefficients C (k, P - k) of the removed parameters on the kept ones."""
    rank: int
    """Rank of a regressor's kept columns: k, if they are independent."""
    passed_over: tuple[int, ...] = ()
    """Kept parameters that the order alone would remove: so little of their rows is left that others go instead."""

    @cached_property
    def condition(self) -> float:
        """The condition number, without a unit, of the removed parameters' rows (P-k, P-k) of the orthonormal null
        vectors (P, P-k), k of P scaled parameters being kept; 1 where none is removed. The larger, the more poorly the
        null vectors determine the coefficients."""
        return condition(self.coefficients)

    @property
    def determined(self) -> bool:
        """True if the null vectors determine the regrouping's coefficients: if the condition number of the removed
        parameters' rows (P-k, P-k) of the null vectors, or its upper bound that the property `bound` gives, is at most
        1e4, without a unit."""
        return self.bound <= LARGEST_CONDITION or self.condition <= LARGEST_CONDITION

    @cached_property
    def bound(self) -> float:
        """An upper bound, without a unit, on the condition number of the removed parameters' rows of the null vectors
        that needs no factorisation: sqrt(1 + |C|_1 |C|_inf). |C|_1 is the largest sum of sizes in a column of the
        coefficients C (k, P-k), |C|_inf that in a row; the bound is 1 where nothing is removed."""
        sizes = np.abs(self.coefficients)
        return float(np.sqrt(1.0 + sizes.sum(axis=0).max(initial=0.0) * sizes.sum(axis=1).max(initial=0.0)))

    def leaves_more_than(self, tolerance: float, order: Sequence[int]) -> bool:
        """True if the regrouping can also be found by rows of the null vectors with a `tolerance` (without a unit): if
        each removed parameter's row of the orthonormal null vectors (P, P-k), less its projection on the rows of those
        removed before it, is longer than that. `order` (P,) has all parameters' zero-based indices, the first removed
        first; it is not checked.

        With the regrouping's coefficients C (k, P-k), the null vectors are [-C; 1] = Z B, Z orthonormal, and the
        removed rows of Z are A = B^-1, so that A A' = L L' = (1 + C'C)^-1: what is left of the rows is on the diagonal
        of L, whose inverses, from the last to the first, are on that of the Cholesky factor of 1 + C'C. Where the
        condition number's upper bound (property `bound`) times the tolerance is below 1, or that bound is above 1e7,
        the bound alone decides.
        """
        if self.bound * tolerance < 1.0 or self.bound > LARGEST_BOUND:
            return self.bound * tolerance < 1.0
        places = {parameter: place for place, parameter in enumerate(order)}
        backward = sorted(range(len(self.removed)), key=lambda i: -places[self.removed[i]])
        C = self.coefficients[:, backward]
        factor = np.linalg.cholesky(np.eye(len(backward)) + C.T @ C)
        return bool(np.diagonal(factor).max(initial=1.0) * tolerance < 1.0)

    def matrix(self, scales: Array) -> Array:
        """The regrouping matrix K (k, P) among unscaled parameters, in SI units: K times all P parameters gives the k
        kept ones with the others added. `scales` (P,), positive, in SI units per J, times the regrouping's scaled
        parameters are the unscaled ones. Coefficients C, of scaled parameters, below 1e-11 in size become 0, entries
        within a relative 1e-13 of a whole number that number. Raises `IndexError` for too few scales."""
        kept, removed = np.array(self.kept, dtype=np.intp), np.array(self.removed, dtype=np.intp)
        i, j = np.nonzero(np.abs(self.coefficients) >= EXACT_ZERO)
        rows, columns = kept[i], removed[j]
        values = self.coefficients[i, j] * scales[rows] / scales[columns]
        # Such as -1 and 1, by geometry: a product with them is left out, whatever the last bits are.
        whole = values.round()
        K = np.zeros((len(kept), len(scales)))
        K[i, columns] = np.where(np.abs(values - whole) <= ROUND_OFF * np.abs(whole), whole, values)
        K[range(len(kept)), kept] = 1.0
        return K


def by_null_vectors(null_basis: Array, order: Sequence[int], tolerance: float) -> Regrouping:
    """The regrouping that removes P-k of P scaled parameters in an `order`, as far as their rows of the null vectors Z
    (P, P-k) are independent. It is K = F1' (I - Z (F2' Z)^-1 F2'), equation 25 of Sheu and Walker (1991), where F1' and
    F2' pick the kept and the removed parameters' rows.

    `null_basis` is Z, orthonormal; `order` (P,) has all zero-based indices, the first removed first; a row counts as
    independent where it, less its projection on the rows taken before, is longer than `tolerance` (without a unit).
    Raises `InputError` for a tolerance that is not between 0 and 1/sqrt(P).
    """
    gone, passed_over = removed_and_passed_over(null_basis, order, tolerance)
    kept, removed = sorted(set(order) - set(gone)), list(gone)
    coefficients = np.asarray(-np.linalg.solve(null_basis[removed].T, null_basis[kept].T).T, dtype=np.float64)
    return Regrouping(tuple(kept), gone, coefficients, len(kept), passed_over)


def condition(coefficients: Array) -> float:
    """The condition number, without a unit, of the removed parameters' rows F2' V2 (n, n) of orthonormal null vectors
    V2 (Sheu and Walker 1991, equation 25); 1 where nothing is removed. It is found from the `coefficients` C (k, n) by
    which n removed parameters are added to k kept ones.

    The null vectors span [-C; 1], so that F2' V2 is (1 + C'C)^-1/2 but for a rotation, and the condition number the
    root of (1 + sigma_max^2) / (1 + sigma_min^2), with the largest and the smallest of C's n singular values (0 where k
    is below n). Raises `numpy.linalg.LinAlgError` for NaN.
    """
    k, n = coefficients.shape
    if n == 0:
        return 1.0
    values = np.linalg.svd(coefficients, compute_uv=False)
    smallest = values[-1] if k >= n else 0.0
    return float(np.sqrt((1.0 + values[0] ** 2) / (1.0 + smallest**2)))
