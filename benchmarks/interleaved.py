"""Timing of calls that do the same, taken in turns, so that what slows the machine slows them all."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from timeit import Timer

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array

Clock = Callable[[], float]


@dataclass(frozen=True)
class Spread:
    """A median, and the quartiles below and above it."""

    median: float
    lower: float
    upper: float

    @classmethod
    def of(cls, values: ArrayLike) -> Spread:
        """Spread of some values (n,)."""
        lower, median, upper = np.quantile(np.asarray(values, dtype=np.float64), (0.25, 0.5, 0.75)).tolist()
        return cls(median, lower, upper)


@dataclass(frozen=True)
class Effort:
    """Number of turns of each statement, and the seconds of each at least."""

    rounds: int = 15
    seconds: float = 0.02


@dataclass(frozen=True)
class Statement:
    """Python statement to be timed, with the names it uses; it does `work` units of the work in question.

    Only the statement itself is timed, as `timeit` does it: nobody pays for a call of the harness.
    """

    statement: str | Callable[[], object]
    names: Mapping[str, object] | None = None
    work: int = 1

    def timer(self, clock: Clock) -> Timer:
        """Timer of the statement by a clock."""
        return Timer(self.statement, globals=dict(self.names or {}), timer=clock)


@dataclass(frozen=True)
class Race:
    """Seconds (rounds,) that each statement needed for one unit of work."""

    seconds: Mapping[str, Array]

    def time(self, name: str) -> Spread:
        """Spread of one statement's seconds."""
        return Spread.of(self.seconds[name])

    def ratio(self, slow: str, fast: str) -> Spread:
        """Spread of the ratio of two statements' seconds in the same round."""
        return Spread.of(self.seconds[slow] / self.seconds[fast])


def race(contenders: Mapping[str, Statement], effort: Effort, clock: Clock = time.process_time) -> Race:
    """Race of statements that take turns, forwards in one round and backwards in the next.

    Seconds are the processor's, of all threads: while another process has the core, the clock stands.
    """
    timers = {name: contender.timer(clock) for name, contender in contenders.items()}
    loops = {name: _loops(timer, effort.seconds) for name, timer in timers.items()}
    seconds = {name: np.zeros(effort.rounds) for name in contenders}
    for k in range(effort.rounds):
        for name in list(timers)[:: 1 if k % 2 == 0 else -1]:
            seconds[name][k] = timers[name].timeit(loops[name]) / (loops[name] * contenders[name].work)
    return Race(seconds)


def _loops(timer: Timer, seconds: float) -> int:
    """Number of calls that take that long. The first call, which may compile something, does not count."""
    timer.timeit(1)
    loops = 1
    while (taken := timer.timeit(loops)) < seconds:
        loops = max(2 * loops, int(loops * min(1.1 * seconds / max(taken, 1e-9), 100.0)))
    return loops
