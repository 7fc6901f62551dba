"""Choice of the base parameters' columns by an order of removal, checked against exact arithmetic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from adaptctl.errors import InputError, RankError
from adaptctl.identifiability.essential_space import EssentialSpace
from adaptctl.identifiability.regrouping import MAX_DEFAULT_CONDITION, TOLERANCE, Regrouping, by_rows

# What a proof of the same rank separates by less than this may be its reading of the file's numbers, which is to 1e-12.
READING = 1e-11


class ChosenColumns(NamedTuple):
    """Cached choice of a basis, as lists."""

    columns: tuple[int, ...]
    regrouping: list[list[float]]
    scales: list[float]
    kept_despite_priority: tuple[str, ...]


def chosen_columns(
    space: EssentialSpace, order: Sequence[int], tolerance: float, prove: bool, wider: float | None = None
) -> ChosenColumns:
    """Columns that an order leaves, by a wider tolerance where those that it removes are nearly dependent."""
    found = space.null_space.regrouping(order, tolerance)
    if tolerance <= TOLERANCE:
        found = _exactly_in_order(space, found, order) or found
    if wider is not None and not (found.determined and found.conditioned_within(MAX_DEFAULT_CONDITION)):
        return chosen_columns(space, order, wider, prove)
    _validate_conditioned(space, found)
    passed_over = {*found.kept_despite_priority, *_kept_against_the_order(space, found, order, prove, tolerance)}
    if found.rank != space.rank:
        raise RankError(
            f"{space.mechanism.name}: the kept columns have rank {found.rank}, not {space.rank}; "
            "pass a larger tolerance"
        )
    names = tuple(space.parameter_names[j] for j in sorted(passed_over))
    return ChosenColumns(found.kept, found.matrix(space.scales).tolist(), space.scales.tolist(), names)


def _exactly_in_order(space: EssentialSpace, found: Regrouping, order: Sequence[int]) -> Regrouping | None:
    """Regrouping onto exactly those that the order keeps, if they are others, and it is well conditioned."""
    sets = () if space.proof is None else tuple(space.proof.kept_in_any_way(order))
    if found.kept in sets:
        return replace(found, exact=True)
    removed = ([j for j in order if j not in set(kept)] for kept in sets if len(kept) == space.rank)
    exact = (by_rows(space.scaled_null_basis, rows) for rows in removed)
    return next((one for one in exact if one is not None and one.determined), None)


def _kept_against_the_order(
    space: EssentialSpace, found: Regrouping, order: Sequence[int], prove: bool, tolerance: float
) -> tuple[int, ...]:
    """Kept parameters that exact geometry removes."""
    if space.proof is None:
        if prove:
            raise InputError(f"{space.mechanism.name}: to prove the basis, prove the essential space (prove=True)")
        return ()
    if space.proof.keeps(found.kept, order):
        return ()
    exact = set(space.proof.kept(order))
    rows = space.scaled_null_basis[[j for j in order if j not in exact]]
    others = sorted(set(found.kept) - exact)
    apart = np.abs(np.diag(np.linalg.qr(rows.T, mode="r"))).min(initial=1.0)
    if apart <= READING and len(exact) == len(found.kept) and not space.proof.strict:
        return ()
    if apart > tolerance:
        raise RankError(
            f"{space.mechanism.name}: in exact arithmetic, over {space.proof.method}, this priority removes "
            f"{', '.join(space.parameter_names[j] for j in others[:4])}, but in floating point it does not"
        )
    return tuple(others)


def _validate_conditioned(space: EssentialSpace, found: Regrouping) -> None:
    if found.determined:
        return
    weights = np.linalg.svd(found.coefficients)[2][0]
    names = [space.parameter_names[found.removed[i]] for i in np.argsort(-np.abs(weights))[:3]]
    raise RankError(
        f"{space.mechanism.name}: the priority removes {names[0]} and {names[-1]}, which almost depend on each other "
        f"(condition number {found.condition:.1e}, limit {found.condition_limit:.0e}); change the priority so that "
        "one of them is kept, or pass a larger tolerance"
    )
