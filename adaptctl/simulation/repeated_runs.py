"""Runs of one arm that are kept, so that the same run need not be computed again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import perf_counter
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import Ensemble, LaneArray, Stepper
from adaptctl.compilation.stepper import Signals


class RecordedRun(NamedTuple):
    """Outputs and last state of a native run, with all that they follow from, and its computing time."""

    stepper: Stepper
    given: list[Array]
    outputs: LaneArray
    last: Array
    seconds: float


KEPT = 2
"""runs that are kept: the last, with and without adaptation"""

_RUNS: ContextVar[list[RecordedRun] | None] = ContextVar("_RUNS", default=None)


@contextmanager
def kept_runs() -> Iterator[None]:
    """Keep the runs of single arms last recorded within this context, each until it is repeated."""
    token = _RUNS.set([])
    try:
        yield
    finally:
        _RUNS.reset(token)


def keeps(arms: Ensemble) -> bool:
    """True if a run of these arms is kept."""
    return _RUNS.get() is not None and arms.members == 1


def recorded(arms: Ensemble, room: LaneArray, steps: int, signals: Signals) -> None:
    """Record the first steps of a run; where it is kept, the buffer is, too."""
    given, started = _given(arms, steps, signals), perf_counter()
    arms.record_into(room, 0, steps, signals)
    if keeps(arms) and (runs := _RUNS.get()) is not None:
        last = arms.state.blocks.copy()
        runs[:] = [*runs, RecordedRun(arms.stepper, given, room, last, perf_counter() - started)][-KEPT:]


def is_kept(arms: Ensemble, steps: int) -> bool:
    """True if a run of this code is kept that is as long."""
    return any(run.stepper is arms.stepper and len(run.outputs.blocks) == steps + 1 for run in _RUNS.get() or ())


def repeated(arms: Ensemble, steps: int, signals: Signals) -> RecordedRun | None:
    """Kept run with this code, first state, constants and inputs, which is not kept any longer."""
    runs, given = _RUNS.get() or [], _given(arms, steps, signals)
    for k, run in enumerate(runs):
        if run.stepper is arms.stepper and all(map(np.array_equal, run.given, given)):
            return runs.pop(k)
    return None


def _given(arms: Ensemble, steps: int, signals: Signals) -> list[Array]:
    """First state and constants, as copies, and inputs."""
    return [arms.state.blocks.copy(), arms.held.blocks.copy(), *(part.blocks[:steps] for part in signals)]
