"""The fundamental basis: parameters that are enough, and what the others add to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.errors import InputError, RankError
from adaptctl.identifiability.equations import regrouping_equations
from adaptctl.identifiability.essential_space import EssentialSpace
from adaptctl.identifiability.numerical_rank import NumericalRank
from adaptctl.identifiability.priority import Priority
from adaptctl.identifiability.selection import removable
from adaptctl.mechanism.pose import Array, frozen_array

TOLERANCE = 1e-3
"""Of the scaled null vectors' rows. Real robots leave nothing between 1e-4 and 0.1; tighter ones take a
rounded right angle for independence, as Table 5 of Sheu and Walker (1991) shows."""
LARGEST_CONDITION = 1e4
EXACT_ZERO = 1e-11
"""Regrouping coefficients below are round-off: left in, they would leak large parameters into small ones."""


@dataclass(frozen=True, eq=False)
class FundamentalBasis:
    """Which k of the P inertial parameters to keep, and how the others regroup onto them.

    For all states Y(p, v, a) D = Y[:, columns] beta with the fundamental parameters beta = K D, K the
    `regrouping` (k, P). `condition` is that of F2' V2 (Sheu and Walker 1991, equation 25), `scaled_condition`
    the same among scaled parameters, which does not depend on units. It depends on the mechanism's geometry
    and gravity only, named by `geometry_sha256`: its inertial values may change.
    """

    mechanism_name: str
    geometry_sha256: str
    parameter_names: tuple[str, ...]
    columns: tuple[int, ...]
    regrouping: Array
    condition: float
    scaled_condition: float
    gap: float
    """of the rank's certificate"""

    def __post_init__(self) -> None:
        P, columns = len(self.parameter_names), self.columns
        if list(columns) != sorted(set(columns)) or not columns or columns[0] < 0 or columns[-1] >= P:
            raise InputError(f"columns: expected rising indices in 0..{P - 1}, got {list(columns)}")
        K = frozen_array(self.regrouping, (len(columns), P), "regrouping")
        if not np.array_equal(K[:, columns], np.eye(len(columns))):
            raise InputError("regrouping: every kept parameter must count once for itself and for no other")
        object.__setattr__(self, "regrouping", K)

    @property
    def rank(self) -> int:
        """Number of fundamental parameters k."""
        return len(self.columns)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the kept parameters (k,)."""
        return tuple(self.parameter_names[j] for j in self.columns)

    def fundamental_parameters(self, parameters: ArrayLike) -> Array:
        """beta = K D (..., k) of inertial parameters D (..., P)."""
        D = np.asarray(parameters, dtype=np.float64)
        if D.ndim == 0 or D.shape[-1] != len(self.parameter_names):
            raise InputError(f"parameters: expected shape (..., {len(self.parameter_names)}), got {D.shape}")
        return D @ self.regrouping.T

    def equations(self) -> tuple[str, ...]:
        """The k regrouping equations as a person writes them."""
        return regrouping_equations(self.regrouping, self.columns, self.parameter_names)

    def save(self, path: str | Path) -> None:
        """Write the basis as JSON, whole or not at all."""
        from adaptctl.identifiability.basis_file import write_basis

        write_basis(path, self)

    @classmethod
    def load(cls, path: str | Path) -> FundamentalBasis:
        """Read a saved basis. Raises `FileError` when the file is not one, or has been damaged."""
        from adaptctl.identifiability.basis_file import read_basis

        return read_basis(path)


def fundamental_basis(
    space: EssentialSpace, priority: Priority | None = None, *, tolerance: float = TOLERANCE
) -> FundamentalBasis:
    """Keep k parameters by removing the others in the order of a priority (default: Table 4's rule).

    Raises `RankError` when the removed parameters determine the kept ones too poorly (condition above 1e4 among
    scaled parameters): the priority then removes parameters that very nearly depend on each other.
    """
    order = (priority or Priority()).indices(space.parameter_names)
    removed = removable(space.scaled_null_basis, order, tolerance)
    columns = tuple(sorted(set(range(len(order))) - set(removed)))
    scaled_condition = _condition(space.scaled_null_basis[list(removed)])
    _require_conditioned(space, removed, scaled_condition)
    _require_rank(space, columns)
    return FundamentalBasis(
        mechanism_name=space.mechanism_name,
        geometry_sha256=space.geometry_sha256,
        parameter_names=space.parameter_names,
        columns=columns,
        regrouping=_regrouping(space, columns, removed),
        condition=_condition(space.null_basis[list(removed)]),
        scaled_condition=scaled_condition,
        gap=space.certificate.gap,
    )


def _condition(block: Array) -> float:
    """The condition of a square block; 1 where nothing is removed."""
    return float(np.linalg.cond(block)) if block.size else 1.0


def _regrouping(space: EssentialSpace, columns: Sequence[int], removed: Sequence[int]) -> Array:
    """K = F1' (I - V2 (F2' V2)^-1 F2') (equation 25), found among scaled parameters and then unscaled."""
    Z, kept, gone = space.scaled_null_basis, list(columns), list(removed)
    scaled = -np.linalg.solve(Z[gone].T, Z[kept].T).T
    scaled[np.abs(scaled) < EXACT_ZERO] = 0.0
    K = np.zeros((len(kept), len(Z)))
    K[:, kept] = np.eye(len(kept))
    K[:, gone] = scaled * space.scales[kept, None] / space.scales[gone]
    return K


def _require_conditioned(space: EssentialSpace, removed: Sequence[int], condition: float) -> None:
    if condition <= LARGEST_CONDITION:
        return
    left, _, _ = np.linalg.svd(space.scaled_null_basis[list(removed)])
    names = [space.parameter_names[removed[i]] for i in np.argsort(-np.abs(left[:, -1]))[:3]]
    raise RankError(
        f"{space.mechanism_name}: this priority removes parameters that nearly depend on each other, {names[0]} and "
        f"{names[-1]} among them: the condition of F2' V2 is {condition:.1e}, at most {LARGEST_CONDITION:.0e} is "
        "allowed; keep one of them longer, or pass a larger tolerance"
    )


def _require_rank(space: EssentialSpace, columns: Sequence[int]) -> None:
    """H[:, columns] = U S V'[:, columns] must have rank k; scaled, and without U, which changes no rank."""
    kept = (space.scaled_vectors * space.scaled_singular_values)[list(columns)]
    found = NumericalRank.of(np.linalg.svd(kept, compute_uv=False))
    if found.rank != space.rank:
        raise RankError(
            f"{space.mechanism_name}: the kept columns have rank {found.rank}, not {space.rank}; "
            "pass a larger tolerance"
        )
