"""Selection of the control periods of a long run that are kept as samples: some of them, or the last."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adaptctl.errors import InputError

MOST = 2**62
"""Greatest number of samples that are kept, however long the time asked for: no run has as many."""


@dataclass(frozen=True)
class KeptSamples:
    """Rule for the control periods of a run that are kept as samples: those of indices 0, `every`, 2 `every`, ..., all
    by default (`every` 1). Of these only the latest `most` are kept, or all where that is None, the default.

    Samples are kept in the rows of an array, which is filled from row 0; when all `most` rows are filled, the oldest is
    overwritten. Nothing is checked at construction; `KeptSamples.of` checks.
    """

    every: int = 1
    most: int | None = None

    @classmethod
    def of(cls, every: int, last: float | None, period: float) -> KeptSamples:
        """The `KeptSamples`, a rule for keeping the control periods of indices 0, `every`, 2 `every`, ... of a run as
        samples: those of its last `last` seconds, at least one sample, or all where `last` is None. `period` (s) is the
        control period, which is not checked. Raises `InputError` for an `every` that is not an int of at least 1, and
        for a `last` that is not a positive finite number."""
        if isinstance(every, bool) or not isinstance(every, int) or every < 1:
            raise InputError(f"every: expected a whole number of control periods, at least 1, got {every!r}")
        if last is None:
            return cls(every)
        if isinstance(last, bool) or not isinstance(last, int | float) or not 0.0 < last < np.inf:
            raise InputError(f"last: expected a positive time in s, got {last!r}")
        return cls(every, max(1, round(min(last / (every * period), MOST))))

    def room(self, steps: int) -> int:
        """Number of rows, one for each kept sample, that the array of samples of a run of `steps` control periods
        needs: `steps` divided by the rule's `every`, rounded up, and at most its `most`. Nothing is checked."""
        needed = -(-steps // self.every)
        return needed if self.most is None else min(needed, self.most)

    def row(self, period: int) -> int | None:
        """The index of the row in which the sample of control period `period`, counted from 0, is kept; None where it
        is not kept, since `period` is no multiple of the rule's `every`. Nothing is checked."""
        sample, rest = divmod(period, self.every)
        return None if rest else sample if self.most is None else sample % self.most

    def among(self, first: int, count: int) -> slice:
        """The slice that selects the control periods to be kept from an array with a row for each of `count` successive
        control periods: those whose zero-based index in the run is a multiple of the rule's `every`. `first` is the
        index of the first period in the run. Nothing is checked."""
        return slice(-first % self.every, count, self.every)

    def rows(self, first: int, count: int) -> NDArray[np.int64]:
        """The zero-based indices (s,) of the rows, in the array of samples, for the s samples that are kept of `count`
        successive control periods; `first` is the index of the first period in the run, from 0. Where s is more than
        the rule's `most`, the number of rows, indices repeat, and the later sample is the one to keep. Nothing is
        checked."""
        samples = np.arange(-(-first // self.every), -(-(first + count) // self.every))
        return samples if self.most is None else samples % self.most

    def order(self, count: int) -> slice | NDArray[np.int64]:
        """The rows of the array of samples that are filled after `count` control periods of a run, the oldest sample
        first. They are a slice or, where older samples have been overwritten, an array (s,) of the zero-based indices
        of all s rows. Nothing is checked."""
        samples = -(-count // self.every)
        if self.most is None or samples <= self.most:
            return slice(0, samples)
        return np.arange(samples - self.most, samples) % self.most
