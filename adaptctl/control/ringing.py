"""Ringing: a sliding variable that changes its sign from tick to tick, as it does where a held torque overshoots."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.scalars import Column, minimum

SPAN = 100
"""ticks that the moving averages remember"""
FAINT = 0.01
"""rad/s (m/s): where s is no larger on average, its signs say little"""
ALARM, BRAKE = -0.5, -0.9
"""of rho: below the first the loop rings, below the second hardly anything else happens"""


class Ringing(NamedTuple):
    """Moving averages of a sliding variable s (r,)."""

    product: Any
    """(r,) of s now times s a tick ago"""
    square: Any
    """(r,) of s a tick ago, squared"""
    s: Any
    """(r,) the last"""

    @classmethod
    def silent(cls, dof: int) -> Ringing:
        """The averages before the first tick."""
        return cls(np.zeros(dof), np.zeros(dof), np.zeros(dof))

    def heard(self, s: Column) -> Ringing:
        """The averages a tick later."""
        keep, new = 1.0 - 1.0 / SPAN, 1.0 / SPAN
        return Ringing(keep * self.product + new * (self.s * s), keep * self.square + new * (self.s * self.s), s)

    @property
    def rho(self) -> Column:
        """(r,) the correlation of s with itself a tick ago, 1 - h in a free loop of hold number h; towards 0 where s is
        FAINT."""
        return Column(x / (y + FAINT * FAINT) for x, y in zip(self.product, self.square, strict=True))

    @property
    def worst(self) -> Any:
        """The least rho of all joints."""
        rho = self.rho
        least = rho[0]
        for x in rho.of[1:]:
            least = minimum(least, x)
        return least


def ringing(s: Array) -> Array:
    """rho (T, r) along a run whose sliding variable was s (T, r) at every tick."""
    averages, found = Ringing(*map(Column, Ringing.silent(s.shape[-1]))), np.empty(s.shape)
    for k, row in enumerate(s):
        averages = averages.heard(Column(row.tolist()))
        found[k] = averages.rho.of
    return found
