"""Ringing: a sliding variable that changes its sign from tick to tick, as it does where a held torque overshoots."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.scalars import Column, minimum, where

SPAN = 100
"""ticks that the moving averages remember"""
FAINT = 0.01
"""rad/s (m/s): where s is no larger on average, its signs say little"""
ALARM, BRAKE = -0.5, -0.9
"""of rho: below the first the loop rings, below the second hardly anything else happens"""
LASTING = 25
"""ticks in a row that it takes"""


class Ringing(NamedTuple):
    """Detector of ringing by moving averages of a sliding variable s (r,)."""

    product: Any
    """(r,) of s now times s a tick ago"""
    square: Any
    """(r,) of s a tick ago, squared"""
    s: Any
    """(r,) the last"""
    lasting: Any
    """(2,) ticks in a row in which some joint's rho was below ALARM and below BRAKE: a single jump is neither"""

    @classmethod
    def silent(cls, dof: int) -> Ringing:
        """The detector before the first tick, of `dof` joints."""
        return cls(np.zeros(dof), np.zeros(dof), np.zeros(dof), np.zeros(2))

    def heard(self, s: Column) -> Ringing:
        """The detector after one more tick, with a sliding variable s (r,)."""
        keep, new = 1.0 - 1.0 / SPAN, 1.0 / SPAN
        product = keep * self.product + new * (self.s * s)
        square = keep * self.square + new * (self.s * self.s)
        worst = _least(correlation(product, square))
        pairs = zip(self.lasting, (ALARM, BRAKE), strict=True)
        return Ringing(product, square, s, Column(where(worst < bound, x + 1.0, 0.0) for x, bound in pairs))

    @property
    def alarm(self) -> Any:
        """Alarm: 1 where a joint has rung for a while, else 0."""
        return where(self.lasting[0] >= LASTING, 1.0, 0.0)

    @property
    def brake(self) -> Any:
        """Signal to brake: 1 where a joint has hardly done anything but ring for a while, else 0."""
        return where(self.lasting[1] >= LASTING, 1.0, 0.0)


def correlation(product: Column, square: Column) -> Column:
    """Correlation rho (r,) of s with itself a tick ago: 1 - h in a free loop of hold number h; towards 0 where s is
    FAINT."""
    return Column(x / (y + FAINT * FAINT) for x, y in zip(product, square, strict=True))


def _least(values: Column) -> Any:
    least = values[0]
    for x in values.of[1:]:
        least = minimum(least, x)
    return least


def ringing(s: Array) -> Array:
    """The correlation rho (T, r) along a run, from its sliding variable s (T, r) at every tick."""
    averages, found = Ringing(*map(Column, Ringing.silent(s.shape[-1]))), np.empty(s.shape)
    for k, row in enumerate(s):
        averages = averages.heard(Column(row.tolist()))
        found[k] = correlation(averages.product, averages.square).of
    return found
