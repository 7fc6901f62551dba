"""Scale of a log's times at which inertia and gravity agree: that of stamps that run too fast or too slowly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from adaptctl.identification.hypothesis_rows import HypothesisRows, relative_error
from adaptctl.identification.momentum_balance import PackedRegressor
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.uncertainty import INTERVAL

# In times k times as long, torques of inertia are 1/k^2 of what they were, those of gravity stay, and parameters of
# friction follow: the same equations as with k^2 times the gravity and the torques. So the sums under three sizes of
# gravity give those under any.
GRAVITIES = (0.0, 1.0, -1.0)
# Octaves of k that are tried, halvings of the step around the best, blocks of a jackknife, deviations that a k beyond
# doubt is from 1, and the least such k.
OCTAVES, HALVINGS, BLOCKS, SURE, LEAST_SCALE = 4, 5, 6, 8.0, 1.25


class TimeScale(NamedTuple):
    """True times over those of a log, and the deviation of its natural logarithm."""

    value: float
    deviation: float

    @property
    def counts(self) -> bool:
        """True if the times are wrong beyond doubt."""
        return abs(np.log(self.value)) > max(SURE * self.deviation, np.log(LEAST_SCALE))

    @property
    def words(self) -> str:
        """Scale in words, with its interval."""
        low, high = (self.value * np.exp(sign * INTERVAL * self.deviation) for sign in (-1.0, 1.0))
        return f"true times are {self.value:.3g} times the log's (95 % within {low:.3g} to {high:.3g})"


class ScaledTimes(NamedTuple):
    """Normal equations of rows, by blocks, as functions of the scale of their times."""

    rows: HypothesisRows
    sums: NormalEquations

    @classmethod
    def of(cls, rows: HypothesisRows, pulled: Callable[[float], PackedRegressor]) -> ScaledTimes:
        """Equations of rows, by a regressor under a multiple of the file's gravity."""
        torque, parameters = rows.rows.torque, rows.packed.shape[1]
        sums = NormalEquations.zero(len(GRAVITIES) * BLOCKS, torque.shape[1], parameters)
        block = np.arange(len(torque)) * BLOCKS // len(torque)
        for k, multiple in enumerate(GRAVITIES):
            sums.add(pulled(multiple), torque, block + k * BLOCKS, rows.used)
        return cls(rows, sums)

    def equations(self, scale: float, blocks: Sequence[int] = range(BLOCKS)) -> NormalEquations:
        """Normal equations of blocks with times of a scale."""
        g = scale**2
        multiples = np.array([1.0 - g**2, 0.5 * (g**2 + g), 0.5 * (g**2 - g)])  # Lagrange's at 0, 1 and -1
        found = self.sums.weighted(np.outer(multiples, np.isin(range(BLOCKS), blocks)).ravel())
        return NormalEquations(found.normal, g * found.moment, g**2 * found.square, found.count)

    def best(self) -> TimeScale:
        """Scale at which least squares fits best, or 1 if none of half an octave or more is better."""
        error = self._error(range(BLOCKS))
        first = min((0.0, *range(-OCTAVES, OCTAVES + 1)), key=error)
        first = min((first, first - 0.5, first + 0.5), key=error)
        if first == 0.0:
            return TimeScale(1.0, 0.0)
        octave = _near(first, error)
        each = [_near(octave, self._error([b for b in range(BLOCKS) if b != left])) for left in range(BLOCKS)]
        return TimeScale(2.0**octave, float(np.log(2.0) * np.sqrt((BLOCKS - 1.0) * np.var(each))))

    def _error(self, blocks: Sequence[int]) -> Callable[[float], float]:
        """Relative error of least squares on blocks as a function of octaves of the scale."""

        @cache
        def error(octave: float) -> float:
            equations = self.equations(2.0**octave, blocks)
            return relative_error(equations, self.rows.least(equations)[0])

        return error


def _near(octave: float, error: Callable[[float], float]) -> float:
    """Octaves, near some, of the least error."""
    for k in range(1, HALVINGS + 1):
        octave = min((octave, octave - 0.5**k, octave + 0.5**k), key=error)
    return octave
