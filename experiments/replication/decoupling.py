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
    """Decoupling relations of an arm among fundamental parameters, linear and homogeneous."""

    basis: FundamentalBasis
    per_term: dict[str, int]
    """independent relations that each off-diagonal inertia asks for alone"""
    relations: Array
    """(m, k), reduced: each has a parameter that no other has"""

    @classmethod
    def of(cls, arm: SampledArm, basis: FundamentalBasis) -> Decoupling:
        """The relations that make every off-diagonal inertia zero wherever the arm works."""
        rows = off_diagonal_rows(arm, basis.columns)
        everything = np.concatenate(list(rows.values()))
        _, values, right = np.linalg.svd(everything, full_matrices=False)
        needed = right[: np.count_nonzero(values > NEGLIGIBLE * values[0])]
        return cls(basis, {term: _rank(row) for term, row in rows.items()}, reduced_rows(needed))

    @property
    def left(self) -> int:
        """Number of independent parameters left under all relations."""
        return self.basis.rank - len(self.relations)

    def lines(self) -> tuple[str, ...]:
        """Texts of the relations, the star marking fundamental parameters."""
        return tuple(_line(row, self.basis.names) for row in self.relations)

    def of_parameters(self) -> Array:
        """Coefficients (m, P) of the same relations among all inertial parameters."""
        return self.relations @ self.basis.regrouping


def off_diagonal_rows(arm: SampledArm, columns: Sequence[int]) -> dict[str, Array]:
    """Rows (states, k) whose products with parameters are M12, M13, ... at random positions."""
    weightless = Mechanism(replace(arm.mechanism.description, gravity=np.zeros(3)))
    p, _ = arm.states(np.random.default_rng(0), STATES, 1.0)
    rest, unit = np.zeros_like(p), np.eye(arm.mechanism.dof)
    forces = [weightless.torque_regressor(p, rest, rest + unit[j], columns) for j in range(len(unit))]
    return {f"M{i + 1}{j + 1}": forces[j][:, i] for i, j in combinations(range(len(unit)), 2)}


def reduced_rows(rows: Array) -> Array:
    """Rows (m, n) reduced by Gauss and Jordan from the last column: the same row space, a column for every row that is
    its own."""
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
