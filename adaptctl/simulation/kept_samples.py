"""Selection of the control periods of a long run that are kept as samples: some of them, or the last."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adaptctl.errors import InputError


@dataclass(frozen=True)
class KeptSamples:
    """Rule for the samples that a run keeps: one of `every` so many control periods, the first included, and of these
    the `most` latest.

    Rows are those of a ring, which is as long as the run where all are kept.
    """

    every: int = 1
    most: int | None = None

    @classmethod
    def of(cls, every: int, last: float | None, period: float) -> KeptSamples:
        """Rule for the samples of the `last` so many seconds. Raises `InputError` for what is no number of periods and
        no time."""
        if isinstance(every, bool) or not isinstance(every, int) or every < 1:
            raise InputError(f"every: expected a whole number of control periods, at least 1, got {every!r}")
        if last is None:
            return cls(every)
        if isinstance(last, bool) or not isinstance(last, int | float) or not 0.0 < last < np.inf:
            raise InputError(f"last: expected a positive time in s, got {last!r}")
        return cls(every, max(1, round(last / (every * period))))

    def room(self, steps: int) -> int:
        """Number of rows for a run of so many control periods."""
        needed = -(-steps // self.every)
        return needed if self.most is None else min(needed, self.most)

    def row(self, period: int) -> int | None:
        """The row of a control period, counted from 0; None where it is not kept."""
        sample, rest = divmod(period, self.every)
        return None if rest else sample if self.most is None else sample % self.most

    def among(self, first: int, count: int) -> slice:
        """Slice of the samples among `count` control periods from the `first` on."""
        return slice(-first % self.every, count, self.every)

    def rows(self, first: int, count: int) -> NDArray[np.int64]:
        """Row numbers (count,) of these samples; more than `most` at once overwrite each other in order."""
        samples = np.arange(-(-first // self.every), -(-(first + count) // self.every))
        return samples if self.most is None else samples % self.most

    def order(self, count: int) -> slice | NDArray[np.int64]:
        """Row numbers (n,) of a run of `count` control periods, in order of time."""
        samples = -(-count // self.every)
        if self.most is None or samples <= self.most:
            return slice(0, samples)
        return np.arange(samples - self.most, samples) % self.most
