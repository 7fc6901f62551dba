"""Torque prediction through two equal low-pass filters."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.adaptation.composite import Filtered, TorqueFilter, decayed, momentum_columns
from adaptctl.control.adaptation.law import Period
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, spread

SLIDING_CUTOFF = 100.0
"""rad/s of the filter of the sliding variable, for the speeds at which friction acts"""


class FilteredTwice(NamedTuple):
    """State of both stages, each nonzero regressor entries (e,) and torques (r,), speeds (r,) after one, and the
    sliding variable (r,) after its own."""

    first: Filtered
    second: Filtered
    speed: Any
    sliding: Any


class FilteredPrediction(NamedTuple):
    """Regressor by rows, torques (r,), speeds (r,), speeds (r,) at which friction acts, and the filters' next state."""

    rows: list[Column]
    torque: Column
    speed: Column
    rubbing: Column
    after: FilteredTwice


def start(model: ReducedModel, q: Array, v: Array, cutoff: float, control_period: float) -> FilteredTwice:
    """Initial state, with zero output."""
    first, rest = TorqueFilter(cutoff, control_period).start(model, q, v), np.zeros(model.mechanism.dof)
    return FilteredTwice(first, Filtered(np.zeros(sum(map(len, momentum_columns(model)))), rest), rest, rest)


def predicted(model: ReducedModel, period: Period, memory: FilteredTwice, cutoff: Any) -> FilteredPrediction:
    """
    FilteredPrediction at the end of a control period.

    One stage passes noise of velocities into the regressor with the gain `cutoff`; a second one takes it out. The sign
    of a noisy velocity is no friction's, so friction acts at the reference velocity plus the filtered sliding variable.
    """
    share = decayed(min(SLIDING_CUTOFF * period.period, 0.5))[0]
    sliding = share * memory.sliding + (1.0 - share) * period.s
    rubbing = period.v - period.s + sliding
    rows, torque, first = TorqueFilter(cutoff, period.period).predicted(model, period, memory.first, rubbing)
    keep = decayed(cutoff * period.period)[0]
    places, last, k = momentum_columns(model), iter(memory.second.regressor), len(model.columns)
    kept = [[keep * next(last) + (1.0 - keep) * row[j] for j in at] for row, at in zip(rows, places, strict=True)]
    torque = keep * memory.second.torque + (1.0 - keep) * torque
    speed = keep * memory.speed + (1.0 - keep) * period.v
    twice = [spread(Column(entries), at, k) for entries, at in zip(kept, places, strict=True)]
    second = Filtered(Column(x for entries in kept for x in entries), torque)
    return FilteredPrediction(twice, torque, speed, rubbing, FilteredTwice(first, second, speed, sliding))
