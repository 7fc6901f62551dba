"""Vertical forces at fixed points of links, each a line in time: weights without inertia."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from adaptctl.compilation import trace
from adaptctl.control.adaptation.composite import decayed
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.symmetric import joined, rank_update, solve
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, maximum, minimum, spread, where

LONGEST = 10.0
"""s for which they may rise or fall: a line of a longer time is ill-conditioned, and the window far shorter"""


class FilteredWeight(NamedTuple):
    """Nonzero torques (e,) of weights, by the parameters that have one, after one filter and after two."""

    first: Any
    second: Any


class WeightSums(NamedTuple):
    """Normal equations of the parameters that have a weight, each with its slope, and the time (1,) in s."""

    normal: Any
    right: Any
    time: Any

    @classmethod
    def zero(cls, model: ReducedModel) -> WeightSums:
        """No data."""
        k = 2 * len(_weighing(model)[0])
        return cls(np.zeros(k * (k + 1) // 2), np.zeros(k), np.zeros(1))


def start(model: ReducedModel) -> FilteredWeight:
    """Initial state, with zero output."""
    none = np.zeros(sum(map(len, _weighing(model)[1])))
    return FilteredWeight(none, none)


def predicted(
    model: ReducedModel, period: Period, memory: FilteredWeight, cutoff: Any
) -> tuple[list[Column], FilteredWeight]:
    """Rows of each joint through two low-pass filters, and their next state."""
    (keep, mean), (heavy, places) = decayed(cutoff * period.period), _weighing(model)
    now = [row[heavy[j]] for row, at in zip(_torques(model, period.q), places, strict=True) for j in at]
    # An input that is linear in between, as that of the regressor's first filter; then one that is held.
    once = [last + (1.0 - mean) * x for last, x in zip(memory.first, now, strict=True)]
    first = Column(keep * x + (mean - keep) * y for x, y in zip(once, now, strict=True))
    twice = [keep * last + (1.0 - keep) * x for last, x in zip(memory.second, once, strict=True)]
    entries = iter(twice)
    rows = [spread(Column(next(entries) for _ in at), at, len(heavy)) for at in places]
    return rows, FilteredWeight(first, Column(twice))


def left(
    rows: Sequence[Column], missed: Column, shares: Column, kept: tuple[Any, float], whole: Scalar, sums: WeightSums
) -> tuple[Scalar, WeightSums]:
    """Squared misses that weights leave of all, and their sums, of which a share is kept after a period in s."""
    keep, T = kept
    if not len(sums.right):
        return whole, sums
    time = where(keep > 0.0, minimum(sums.time[0] + T, LONGEST), 0.0)
    lines = [joined([row, time * row]) for row in rows]
    normal, right = rank_update(sums.normal, lines, shares, keep, 0.0), keep * sums.right
    for line, share, miss in zip(lines, shares, missed, strict=True):
        right = right - (share * miss) * line
    return maximum(whole - solve(normal, right) @ right, 0.0), WeightSums(normal, right, Column((time,)))


def _torques(model: ReducedModel, q: Column) -> list[Column]:
    """Torques (k,) of each joint for each parameter, of an arm at rest."""
    still = Column.zeros(model.mechanism.dof)
    return model.mechanism.equations.torque_regressor(q, still, still, still, model.columns)


@lru_cache(maxsize=32)
def _weighing(model: ReducedModel) -> tuple[list[int], list[list[int]]]:
    """Parameters that have a weight, and those of them, by their places, that have a torque at each joint."""
    entries = trace(lambda q: [joined(_torques(model, q))], {"q": model.mechanism.equations.num_joints}).outputs
    k, zero = len(model.columns), [isinstance(x, float) and x == 0.0 for x in entries]
    at = [[j for j in range(k) if not zero[k * i + j]] for i in range(model.mechanism.dof)]
    heavy = sorted({j for places in at for j in places})
    return heavy, [[heavy.index(j) for j in places] for places in at]
