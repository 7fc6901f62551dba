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
    """Detector of ringing, a sliding variable s (r,) of r joints that changes its sign from one control period to the
    next, by exponential moving averages over about 100 control periods.

    `product` (r,) is the average of s_j s_(j-1) and `square` (r,) that of s_(j-1)^2, j counting the control periods,
    both in rad^2/s^2 (m^2/s^2 if prismatic); `s` (r,) is the last s, in rad/s (m/s). The correlation of s with itself
    is rho = product/(square + 1e-4). `lasting` (2,) counts the control periods in a row in which some joint's rho was
    below -0.5 (first number) and below -0.9 (second). All are arrays or Columns. Nothing is checked.
    """

    product: Any
    """(r,) of s now times s one control period ago"""
    square: Any
    """(r,) of s one control period ago, squared"""
    s: Any
    """(r,) the last"""
    lasting: Any
    """(2,) control periods in a row in which some joint's rho was below ALARM and below BRAKE: a single jump is
    neither"""

    @classmethod
    def silent(cls, dof: int) -> Ringing:
        """Detector of ringing for `dof` joints before the first control period: all its averages and counts are zero.
        Nothing is checked."""
        return cls(np.zeros(dof), np.zeros(dof), np.zeros(dof), np.zeros(2))

    def heard(self, s: Column) -> Ringing:
        """Detector of ringing after one more control period, in which the sliding variable was `s`, a `Column` (r,) of
        r joints in rad/s (m/s if prismatic). The detector's own fields must be Columns too. Nothing is checked."""
        keep, new = 1.0 - 1.0 / SPAN, 1.0 / SPAN
        product = keep * self.product + new * (self.s * s)
        square = keep * self.square + new * (self.s * self.s)
        worst = _least(correlation(product, square))
        pairs = zip(self.lasting, (ALARM, BRAKE), strict=True)
        return Ringing(product, square, s, Column(where(worst < bound, x + 1.0, 0.0) for x, bound in pairs))

    @property
    def alarm(self) -> Any:
        """Alarm of ringing, one scalar for all joints: 1 where some joint rings, else 0. A joint rings where, for 25
        control periods in a row, its sliding variable had a correlation with itself one control period ago below -0.5,
        that is, mostly changed its sign."""
        return where(self.lasting[0] >= LASTING, 1.0, 0.0)

    @property
    def brake(self) -> Any:
        """Signal to brake the arm, one scalar for all joints: 1 where ringing dominates, else 0. It does where, for 25
        control periods in a row, some joint's sliding variable had a correlation with itself one control period ago
        below -0.9."""
        return where(self.lasting[1] >= LASTING, 1.0, 0.0)


def correlation(product: Column, square: Column) -> Column:
    """Correlation rho (r,), without a unit, of the sliding variables s of r joints with themselves one control period
    ago: rho = product/(square + 1e-4), which goes to 0 where s is below 0.01 rad/s (m/s).

    `product` (r,) is the moving average of s_j s_(j-1) and `square` (r,) that of s_(j-1)^2, j counting the control
    periods, both in rad^2/s^2 (m^2/s^2 if prismatic). In a loop without disturbance rho is 1 - h. h is its hold number,
    the control period times the rate at which the held torque damps s; the loop is stable for h below 2. Raises
    `ValueError` for columns of different lengths.
    """
    return Column(x / (y + FAINT * FAINT) for x, y in zip(product, square, strict=True))


def _least(values: Column) -> Any:
    least = values[0]
    for x in values.of[1:]:
        least = minimum(least, x)
    return least


def ringing(s: Array) -> Array:
    """The correlation rho (T, r), without a unit, of the sliding variables of r joints with themselves one control
    period ago, in the T control periods of a run. It is taken of exponential moving averages over about 100 control
    periods, which start at 0. At -0.5 the loop rings: the sliding variable changes its sign in most control periods. At
    -0.9 it is about to diverge. `s` (T, r) has the sliding variables in every control period, in rad/s (m/s if
    prismatic). Nothing is checked."""
    averages, found = Ringing(*map(Column, Ringing.silent(s.shape[-1]))), np.empty(s.shape)
    for k, row in enumerate(s):
        averages = averages.heard(Column(row.tolist()))
        found[k] = correlation(averages.product, averages.square).of
    return found
