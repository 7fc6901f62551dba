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
    """(r,) of s now times s a tick ago"""
    square: Any
    """(r,) of s a tick ago, squared"""
    s: Any
    """(r,) the last"""
    lasting: Any
    """(2,) ticks in a row in which some joint's rho was below ALARM and below BRAKE: a single jump is neither"""

    @classmethod
    def silent(cls, dof: int) -> Ringing:
        """The detector of ringing of `dof` joints before the first control period: all its averages and counts are
        zero."""
        return cls(np.zeros(dof), np.zeros(dof), np.zeros(dof), np.zeros(2))

    def heard(self, s: Column) -> Ringing:
        """The detector of ringing after one more control period, in which the sliding variable was `s`, a `Column` (r,)
        of r joints in rad/s (m/s if prismatic). The detector's own fields must be Columns too. Nothing is checked."""
        keep, new = 1.0 - 1.0 / SPAN, 1.0 / SPAN
        product = keep * self.product + new * (self.s * s)
        square = keep * self.square + new * (self.s * self.s)
        worst = _least(correlation(product, square))
        pairs = zip(self.lasting, (ALARM, BRAKE), strict=True)
        return Ringing(product, square, s, Column(where(worst < bound, x + 1.0, 0.0) for x, bound in pairs))

    @property
    def alarm(self) -> Any:
        """Alarm of ringing, one scalar for all joints: 1 where for 25 control periods in a row some joint's sliding
        variable had a correlation with itself one control period ago below -0.5 (it mostly changed its sign), else
        0."""
        return where(self.lasting[0] >= LASTING, 1.0, 0.0)

    @property
    def brake(self) -> Any:
        """Signal to brake the arm, one scalar for all joints: 1 where for 25 control periods in a row some joint's
        sliding variable had a correlation with itself one control period ago below -0.9 (hardly anything but ringing
        was left), else 0."""
        return where(self.lasting[1] >= LASTING, 1.0, 0.0)


def correlation(product: Column, square: Column) -> Column:
    """Correlation rho (r,), without a unit, of the sliding variables s of r joints with themselves one control period
    ago: rho = product/(square + 1e-4), which goes to 0 where s is below 0.01 rad/s (m/s).

    `product` (r,) is the moving average of s_j s_(j-1) and `square` (r,) that of s_(j-1)^2, j counting the control
    periods, both in rad^2/s^2 (m^2/s^2 if prismatic). In a loop that nothing disturbs rho is 1 - h, h its hold number,
    which must be below 2: the control period times the rate at which the held torque damps s. Raises `ValueError` for
    columns of different lengths.
    """
    return Column(x / (y + FAINT * FAINT) for x, y in zip(product, square, strict=True))


def _least(values: Column) -> Any:
    least = values[0]
    for x in values.of[1:]:
        least = minimum(least, x)
    return least


def ringing(s: Array) -> Array:
    """The correlation rho (T, r), without a unit, of the sliding variables of r joints with themselves one control
    period ago, averaged over about 100 control periods, in the T control periods of a run, the averages starting at 0.
    -0.5 is an alarm: s mostly changes its sign from one control period to the next, the loop rings. At -0.9 it is about
    to be lost. `s` (T, r) has the sliding variables in every control period, in rad/s (m/s if prismatic). Nothing is
    checked."""
    averages, found = Ringing(*map(Column, Ringing.silent(s.shape[-1]))), np.empty(s.shape)
    for k, row in enumerate(s):
        averages = averages.heard(Column(row.tolist()))
        found[k] = correlation(averages.product, averages.square).of
    return found
