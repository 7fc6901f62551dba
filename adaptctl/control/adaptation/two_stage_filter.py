"""Torque prediction through two equal low-pass filters."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.adaptation.composite import (
    Filtered,
    TorqueFilter,
    decayed,
    momentum_columns,
    nonzero,
    spread_rows,
)
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.low_pass import low_pass
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column

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
    second = low_pass(nonzero(rows, model), memory.second.regressor, keep)
    torque = keep * memory.second.torque + (1.0 - keep) * torque
    speed = keep * memory.speed + (1.0 - keep) * period.v
    after = FilteredTwice(first, Filtered(second, torque), speed, sliding)
    return FilteredPrediction(spread_rows(second, model), torque, speed, rubbing, after)
