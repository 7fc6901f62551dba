"""Regrouping: independent rows and columns, parameters kept and removed by them, and null vectors.

Rows and columns are chosen one after another by modified Gram-Schmidt, for two questions. `removable` walks an order
that a user gives, over null vectors of a whole mechanism down to any tolerance, so it orthogonalises twice; only the
choice counts. `independent_columns` falls back on the largest column and gives directions to go on with. Neither needs
SciPy, whose `qr` pivots by size alone and takes 0.1 s to import.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from adaptctl.arrays import Array, real_number
from adaptctl.caching import cached_property
from adaptctl.errors import InputError
from adaptctl.identifiability.factorisation import triangle

TOLERANCE = 1e-3
"""Length of the scaled null vectors' rows that counts as zero. Real robots leave nothing between 1e-4 and 0.1; tighter
tolerances take a rounded right angle for independence, as Table 5 of Sheu and Walker (1991) shows."""

CLEAR = 1e-8
"""Length of such a row that is more than round-off, and so independent beyond doubt."""


EXACT_ZERO = 1e-11
"""Size below which regrouping coefficients are round-off: left in, they would leak large parameters into small ones."""
ROUND_OFF = 1e-13
"""Relative distance from a whole number that is round-off."""
LARGEST_CONDITION = 1e4
"""Largest condition of F2' V2 among scaled parameters."""
LARGEST_BOUND = 1e7
"""Largest bound of that condition at which Cholesky's factor does not drown in round-off."""
NEGLIGIBLE = 1e-9
"""Size below which coefficients are left out: they come from right angles that a file gives to nine digits."""
ALIKE = 1e-9
"""Relative difference below which coefficients are the same one."""


def validate_tolerance(tolerance: float, parameters: int) -> None:
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
    validate_tolerance(tolerance, rows)
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
    removed: tuple[int, ...]
    coefficients: Array
    rank: int
    kept_despite_priority: tuple[int, ...] = ()
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


def regrouping_equations(regrouping: Array, columns: Sequence[int], names: Sequence[str]) -> tuple[str, ...]:
    """The regrouping equations, k texts such as ``link2.mc_x* = link2.mc_x + 0.4318 (link3.m + link4.m)``, in SI units,
    one for each kept parameter: its name with a star is the sum of itself and of what is regrouped onto it.

    `regrouping` is the matrix K (k, P), in SI units, that maps all P parameters to the k kept ones with the others
    added, `columns` (k,) the kept ones' zero-based indices, `names` (P,) all names. Coefficients below 1e-9 in size are
    left out; those of one size (to a relative 1e-9), unless it is 1, are put before brackets. Raises `ValueError`
    unless there are k columns.
    """
    return tuple(_equation(row, column, names) for row, column in zip(regrouping, columns, strict=True))


def _equation(row: Array, column: int, names: Sequence[str]) -> str:
    own = names[column]
    return " ".join([f"{own}* = {own}", *(_group(row, group, names) for group in _groups(row, column))])


def _groups(row: Array, column: int) -> list[list[int]]:
    """Groups of parameters whose coefficients have the same size; size 1 first, then in the parameters' order."""
    groups: list[list[int]] = []
    for j in np.flatnonzero(np.abs(row) > NEGLIGIBLE).tolist():
        if j == column:
            continue
        alike = [group for group in groups if _alike(row[group[0]], row[j])]
        if alike:
            alike[0].append(j)
        else:
            groups.append([j])
    return sorted(groups, key=lambda group: not _alike(row[group[0]], 1.0))


def _alike(a: float, b: float) -> bool:
    return abs(abs(a) - abs(b)) <= ALIKE * abs(b)


def _group(row: Array, group: Sequence[int], names: Sequence[str]) -> str:
    """A group such as ``- 0.5 (a - b)``: the first sign outside, the others within; sizes of 1 are signs alone."""
    first = row[group[0]]
    if _alike(first, 1.0):
        return " ".join(f"{_sign(row[j])} {names[j]}" for j in group)
    inner = names[group[0]] + "".join(f" {_sign(first * row[j])} {names[j]}" for j in group[1:])
    return f"{_sign(first)} {abs(first):.6g} " + (f"({inner})" if len(group) > 1 else inner)


def _sign(x: float) -> str:
    return "-" if x < 0.0 else "+"


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
