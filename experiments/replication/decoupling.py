"""Relations that make the off-diagonal inertias of an arm vanish in every configuration (section 5.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.replication.arms import SampledArm
from adaptctl.identifiability import FundamentalBasis

STATES = 200
NEGLIGIBLE = 1e-9
"""Of the largest: what lies below is round-off."""


@dataclass(frozen=True, eq=False)
class Decoupling:
    """Conditions that decouple an arm: the linear homogeneous relations among its k fundamental (base) parameters of
    `basis` under which all off-diagonal entries of the mass matrix are zero in every configuration (Sheu and Walker
    1991, section 5.3).

    `relations` (m, k) holds a relation a row, coefficients in SI units, each with one parameter that no other row has;
    `per_term` maps each off-diagonal entry's name, such as "M12" for row 1 and column 2, counted from 1, to the number
    of relations that it needs by itself. Nothing is checked at construction.
    """

    basis: FundamentalBasis
    per_term: dict[str, int]
    """independent relations that each off-diagonal inertia asks for alone"""
    relations: Array
    """(m, k), reduced: each has a parameter that no other has"""

    @classmethod
    def of(cls, arm: SampledArm, basis: FundamentalBasis) -> Decoupling:
        """Conditions that decouple an `arm`, a `Decoupling`: the relations among the fundamental (base) parameters of
        `basis` that make every off-diagonal entry of its mass matrix zero at 200 random positions within the arm's
        range, the same in every call. Singular values below 1e-9 of the largest count as zero."""
        rows = off_diagonal_rows(arm, basis.columns)
        everything = np.concatenate(list(rows.values()))
        _, values, right = np.linalg.svd(everything, full_matrices=False)
        needed = right[: np.count_nonzero(values > NEGLIGIBLE * values[0])]
        return cls(basis, {term: _rank(row) for term, row in rows.items()}, reduced_rows(needed))

    @property
    def left(self) -> int:
        """Number of independent parameters of the arm that are left when all relations hold: the number k of
        fundamental (base) parameters less that of the relations."""
        return self.basis.rank - len(self.relations)

    def lines(self) -> tuple[str, ...]:
        """Texts of the relations that decouple the arm, one each, such as "link5.mc_x* = 0.6667 link4.mc_x*", with
        coefficients in SI units; the star marks fundamental (base) parameters. Nothing is checked."""
        return tuple(_line(row, self.basis.names) for row in self.relations)

    def of_parameters(self) -> Array:
        """Coefficients (m, P) of the m relations that decouple the arm, among all its P inertial parameters, in SI
        units: the relations (m, k) among the k fundamental (base) ones times the matrix (k, P) that regroups all
        parameters into these. Nothing is checked."""
        return self.relations @ self.basis.regrouping


def off_diagonal_rows(arm: SampledArm, columns: Sequence[int]) -> dict[str, Array]:
    """Regressors (200, k) of the off-diagonal entries of an arm's mass matrix, a mapping from their names ("M12" for
    row 1 and column 2, counted from 1, "M13", ...): times the k inertial parameters whose zero-based indices are
    `columns`, in SI units, they give the entry, kg m^2, at each of 200 random positions within the arm's range, the
    same in every call."""
    weightless = Mechanism(replace(arm.mechanism.description, gravity=np.zeros(3)))
    p, _ = arm.states(np.random.default_rng(0), STATES, 1.0)
    rest, unit = np.zeros_like(p), np.eye(arm.mechanism.dof)
    forces = [weightless.torque_regressor(p, rest, rest + unit[j], columns) for j in range(len(unit))]
    return {f"M{i + 1}{j + 1}": forces[j][:, i] for i, j in combinations(range(len(unit)), 2)}


def reduced_rows(rows: Array) -> Array:
    """Reduced row echelon form (rank, n) of `rows` (m, n), m rows of n numbers, of the same row space, by Gauss-Jordan
    elimination with the columns taken from the last to the first: each of its rows has a 1 in a column that is zero in
    all others. Pivots and entries below 1e-9 in magnitude count as zero. Nothing is checked."""
    left, done = rows.copy(), 0
    for column in reversed(range(rows.shape[1])):
        if done == len(left):
            break
        pivot = done + int(np.abs(left[done:, column]).argmax())
        if abs(left[pivot, column]) < NEGLIGIBLE:
            continue
        left[[done, pivot]] = left[[pivot, done]]
        left[done] /= left[done, column]
        others = np.arange(len(left)) != done
        left[others] -= np.outer(left[others, column], left[done])
        done += 1
    left[np.abs(left) < NEGLIGIBLE] = 0.0
    return left[:done]


def _rank(rows: Array) -> int:
    values = np.linalg.svd(rows, compute_uv=False)
    return int(np.count_nonzero(values > NEGLIGIBLE * values[0]))


def _line(row: Array, names: Sequence[str]) -> str:
    """``link5.mc_x* = 0.6667 link4.mc_x*``: the row's own parameter on the left."""
    own = int(np.flatnonzero(row)[-1])
    right = [f"{-row[j]:+.4g} {names[j]}*" for j in np.flatnonzero(row)[:-1]]
    return f"{names[own]}* = {' '.join(right).removeprefix('+') or '0'}"
