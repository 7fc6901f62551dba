"""Regrouping of parameters by independent rows of the null vectors."""

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

# Length of the scaled null vectors' rows that counts as zero. Real robots leave nothing between 1e-4 and 0.1; tighter
# tolerances take a rounded right angle for independence, as Table 5 of Sheu and Walker (1991) shows.
TOLERANCE = 1e-3

# Length of such a row that is more than round-off, and so independent beyond doubt.
CERTAIN_INDEPENDENCE = 1e-8


# Size below which regrouping coefficients are round-off: left in, they would leak large parameters into small ones.
COEFFICIENT_ROUND_OFF = 1e-11
# Relative distance from a whole number that is round-off.
WHOLE_NUMBER_TOLERANCE = 1e-13
# Largest condition number of the matrix that is inverted for the regrouping, among scaled parameters.
MAX_CONDITION = 1e4
# The same where exact arithmetic says that they are independent: torques keep seven digits.
MAX_EXACT_CONDITION = 1e8
# The same of an order that nobody asked for. Robots have at most 40; angles 3 mrad off right ones make 1e3, and the
# diagonal of a mapped gain up to 1e6 times what the gain is.
MAX_DEFAULT_CONDITION = 1e2
# Largest bound of that condition at which Cholesky's factor does not drown in round-off.
MAX_CONDITION_BOUND = 1e7
# Size below which coefficients are left out: they come from right angles that a file gives to nine digits.
MIN_SHOWN_COEFFICIENT = 1e-9
# Relative difference below which coefficients are the same one.
EQUAL_COEFFICIENT_TOLERANCE = 1e-9


def validate_tolerance(tolerance: float, parameters: int) -> None:
    """Raise `InputError` unless 0 < tolerance < 1/sqrt(P)."""
    most = 1.0 / np.sqrt(max(parameters, 1))
    if not 0.0 < real_number(tolerance, "tolerance") < most:
        raise InputError(f"tolerance: expected a number between 0 and {most:.2g}, got {tolerance:g}")


def removable(null_basis: Array, order: Iterable[int], tolerance: float) -> tuple[int, ...]:
    """Indices (P-k,) of the parameters to remove."""
    return removed_and_passed_over(null_basis, order, tolerance)[0]


def removed_and_passed_over(
    null_basis: Array, order: Iterable[int], tolerance: float
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Indices of the parameters to remove, and of those dependent on them within the tolerance."""
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
        elif size > CERTAIN_INDEPENDENCE:
            passed.append(j)
    return tuple(taken), tuple(passed)


def independent_columns(columns: Array, tolerance: float, negligible: float) -> tuple[list[int], Array]:
    """Indices (c,) of independent columns of (r, n), and their orthonormal directions (c, r)."""
    left, taken = columns.T.copy(), list[int]()
    directions = np.empty((min(columns.shape), len(columns)))
    for direction in directions:
        sizes = np.vecdot(left, left).tolist()
        best = next((i for i, size in enumerate(sizes) if size > tolerance**2), -1)
        if best < 0:
            best = sizes.index(max(sizes))
            if sizes[best] <= negligible**2:
                break
        np.divide(left[best], math.sqrt(sizes[best]), out=direction)
        left -= left.dot(direction)[:, None] * direction
        left[best] = 0.0  # of what was taken nothing is left, whatever round-off says
        taken.append(best)
    return taken, directions[: len(taken)]


@dataclass(frozen=True, eq=False)
class Regrouping:
    """Kept and removed parameters, with regrouping coefficients (k, P-k)."""

    kept: tuple[int, ...]
    removed: tuple[int, ...]
    coefficients: Array
    rank: int
    # Kept parameters that the order alone would remove: so little of their rows is left that others go instead.
    kept_despite_priority: tuple[int, ...] = ()
    # Chosen by exact arithmetic.
    exact: bool = False

    @cached_property
    def condition(self) -> float:
        """Condition number of the removed parameters' rows of the null space's basis."""
        return condition(self.coefficients)

    @property
    def condition_limit(self) -> float:
        """Largest condition number that is accepted."""
        return MAX_EXACT_CONDITION if self.exact else MAX_CONDITION

    @property
    def determined(self) -> bool:
        """True if the condition number is at most 1e4, or 1e8 if the choice is exact."""
        return self.conditioned_within(self.condition_limit)

    def conditioned_within(self, most: float) -> bool:
        """True if the condition number is at most this."""
        return self.bound <= most or self.condition <= most

    @cached_property
    def bound(self) -> float:
        """Upper bound on the condition number, which is cheap."""
        sizes = np.abs(self.coefficients)
        return float(np.sqrt(1.0 + sizes.sum(axis=0).max(initial=0.0) * sizes.sum(axis=1).max(initial=0.0)))

    def leaves_more_than(self, tolerance: float, order: Sequence[int]) -> bool:
        """True if the null space's basis at this tolerance removes the same parameters."""
        if self.bound * tolerance < 1.0 or self.bound > MAX_CONDITION_BOUND:
            return self.bound * tolerance < 1.0
        places = {parameter: place for place, parameter in enumerate(order)}
        backward = sorted(range(len(self.removed)), key=lambda i: -places[self.removed[i]])
        C = self.coefficients[:, backward]
        factor = np.linalg.cholesky(np.eye(len(backward)) + C.T @ C)
        return bool(np.diagonal(factor).max(initial=1.0) * tolerance < 1.0)

    def matrix(self, scales: Array) -> Array:
        """Regrouping matrix K (k, P) in SI units."""
        kept, removed = np.array(self.kept, dtype=np.intp), np.array(self.removed, dtype=np.intp)
        i, j = np.nonzero(np.abs(self.coefficients) >= COEFFICIENT_ROUND_OFF)
        rows, columns = kept[i], removed[j]
        values = self.coefficients[i, j] * scales[rows] / scales[columns]
        # Such as -1 and 1, by geometry: a product with them is left out, whatever the last bits are.
        whole = values.round()
        K = np.zeros((len(kept), len(scales)))
        K[i, columns] = np.where(np.abs(values - whole) <= WHOLE_NUMBER_TOLERANCE * np.abs(whole), whole, values)
        K[range(len(kept)), kept] = 1.0
        return K


def by_null_vectors(null_basis: Array, order: Sequence[int], tolerance: float) -> Regrouping:
    """Regrouping by an order of removal, from the rows of the null space's basis."""
    gone, passed_over = removed_and_passed_over(null_basis, order, tolerance)
    kept, removed = sorted(set(order) - set(gone)), list(gone)
    coefficients = np.asarray(-np.linalg.solve(null_basis[removed].T, null_basis[kept].T).T, dtype=np.float64)
    return Regrouping(tuple(kept), gone, coefficients, len(kept), passed_over)


def by_rows(null_basis: Array, removed: Sequence[int]) -> Regrouping | None:
    """Regrouping that removes the parameters of an exact choice; None where they are dependent in floats."""
    kept = sorted(set(range(len(null_basis))) - set(removed))
    rows = null_basis[list(removed)]
    if len(rows) != rows.shape[1] or np.linalg.matrix_rank(rows) < len(removed):
        return None
    coefficients = np.asarray(-np.linalg.solve(rows.T, null_basis[kept].T).T, dtype=np.float64)
    return Regrouping(tuple(kept), tuple(removed), coefficients, len(kept), exact=True)


def condition(coefficients: Array) -> float:
    """Condition number of the removed rows, from coefficients (k, n)."""
    k, n = coefficients.shape
    if n == 0:
        return 1.0
    values = np.linalg.svd(coefficients, compute_uv=False)
    smallest = values[-1] if k >= n else 0.0
    return float(np.sqrt((1.0 + values[0] ** 2) / (1.0 + smallest**2)))


def regrouping_equations(regrouping: Array, columns: Sequence[int], names: Sequence[str]) -> tuple[str, ...]:
    """Regrouping equations, such as ``link2.mc_x* = link2.mc_x + 0.4318 (link3.m + link4.m)``."""
    return tuple(_equation(row, column, names) for row, column in zip(regrouping, columns, strict=True))


def _equation(row: Array, column: int, names: Sequence[str]) -> str:
    own = names[column]
    return " ".join([f"{own}* = {own}", *(_group(row, group, names) for group in _groups(row, column))])


def _groups(row: Array, column: int) -> list[list[int]]:
    groups: list[list[int]] = []
    for j in np.flatnonzero(np.abs(row) > MIN_SHOWN_COEFFICIENT).tolist():
        if j == column:
            continue
        alike = [group for group in groups if _alike(row[group[0]], row[j])]
        if alike:
            alike[0].append(j)
        else:
            groups.append([j])
    return sorted(groups, key=lambda group: not _alike(row[group[0]], 1.0))


def _alike(a: float, b: float) -> bool:
    return abs(abs(a) - abs(b)) <= EQUAL_COEFFICIENT_TOLERANCE * abs(b)


def _group(row: Array, group: Sequence[int], names: Sequence[str]) -> str:
    first = row[group[0]]
    if _alike(first, 1.0):
        return " ".join(f"{_sign(row[j])} {names[j]}" for j in group)
    inner = names[group[0]] + "".join(f" {_sign(first * row[j])} {names[j]}" for j in group[1:])
    return f"{_sign(first)} {abs(first):.6g} " + (f"({inner})" if len(group) > 1 else inner)


def _sign(x: float) -> str:
    return "-" if x < 0.0 else "+"


class NullSpace(Protocol):
    """Protocol of a null space of energies."""

    @property
    def scales(self) -> Array:
        """Scales (P,) in SI units per J."""

    @property
    def rank(self) -> int:
        """Rank k, the number of directions that change energies."""

    @property
    def null_basis(self) -> Array:
        """Orthonormal basis (P, P-k) of changes of scaled parameters that change no energy."""

    def regrouping(self, order: Sequence[int], tolerance: float) -> Regrouping:
        """Regrouping that removes P-k parameters in an order."""


def unscaled_bases(scaled_null_basis: Array, scales: Array) -> tuple[Array, Array]:
    """Orthonormal bases of the null space (P, P-k) and its complement (P, k), SI."""
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
    """Largest torque of a parameter change in the null space, divided by the largest of any change of its size."""
    if null_basis.shape[1] == 0 or not regressor.any():
        return 0.0
    largest = np.abs(regressor * scales).max() * np.abs(null_basis / scales[:, None]).max(axis=0)
    return float((np.abs(regressor @ null_basis).max(axis=0) / largest).max())
