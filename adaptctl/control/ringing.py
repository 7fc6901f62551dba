"""Ringing: a sliding variable that changes its sign from tick to tick, as it does where a held torque overshoots."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from adaptctl.arrays import Array, whole_count
from adaptctl.control.adaptation.gradient import Descent
from adaptctl.control.gains.sampling_ratio import sampling_ratios
from adaptctl.control.lyapunov import LearningRun, SampledRun, sliding_variable
from adaptctl.control.slotine_li import SlotineLi
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.scalars import Column, minimum, where


class StabilityMonitor(NamedTuple):
    """Stability numbers, without units, at T samples of a run: of the adaptation, of the held torque, and of ringing.

    `adaptation_ratio` (T,) is T_c lambda_max(K^-1 Y Gamma Y'), 0 with adaptation off: theorems of discrete adaptation
    ask for less than 2, or 2 - h. `hold` (T,) is h = T_c lambda_max(M^-1 (K + M^ Lambda)): velocities ring above 2;
    infinite where M is not positive definite. `ringing` (T, r) is the correlation rho of each joint's sliding variable
    s = e' + Lambda e with itself one control period ago, averaged over about 100 control periods: at -0.5 the loop
    rings, at -0.9 it is about to diverge.

    T_c is the control period (s), r the number of primary (independent) joints, lambda_max the largest eigenvalue, K
    the damping, Lambda the bandwidth, Gamma the adaptation gain, Y the torque regressor and Y' its transpose, M the
    true mass matrix, M^ the estimate's, e = p - p_d the tracking error of the joints' positions and e' its derivative
    in time. Nothing is checked.
    """

    adaptation_ratio: Array
    sampling_ratio: Array
    ringing: Array


class _Run(LearningRun, SampledRun, Protocol):
    """A run with estimates and its reference's accelerations."""


def monitor_stability(controller: SlotineLi, run: _Run, mechanism: Mechanism, every: int = 1) -> StabilityMonitor:
    """The stability numbers, a `StabilityMonitor` without units, of a `run` of Slotine and Li's law, `controller`, at T
    of its samples: every `every`-th from the first on, by default all.

    Its fields are `adaptation_ratio` (T,), T_c lambda_max(K^-1 Y Gamma Y'), 0 with adaptation off, and `hold` (T,), T_c
    lambda_max(M^-1 (K + M^ Lambda)) of the held torque, both stable below 2; and `ringing` (T, r), the correlation of
    the sliding variable of each of the r primary (independent) joints with itself one control period ago. T_c is the
    control period, lambda_max the largest eigenvalue, K the damping, Lambda the bandwidth, Gamma the adaptation gain, Y
    the torque regressor and Y' its transpose, M the mass matrix of the true `mechanism` and M^ the estimated one. The
    run must have every control period as a sample: positions, velocities, the reference's and its accelerations, and
    the estimates. `adaptation` and `hold` cost a regressor and a mass matrix a sample. Raises `InputError` for an
    `every` that is not a whole number of at least 1, for relatives of Slotine and Li's law with another sliding
    variable, such as `TaskSpaceSlotineLi`, for a run of another number of joints than the controller's, and for an
    adaptation law without a constant gain; `SingularityError` near a singularity of the kinematic loops.
    """
    every = whole_count(every, "monitor_stability: every", 1)
    s = sliding_variable(controller, run)
    p, v, estimate = run.p[::every], run.v[::every], run.estimate[::every]
    parameters = controller.model.embed(estimate)
    hold = sampling_ratios(
        mechanism, p, controller.damping, controller.control_period, controller.bandwidth, estimate=parameters
    )
    heard = ringing(s)[::every]
    law = controller.adaptation_law
    if law is None:
        return StabilityMonitor(np.zeros(len(p)), hold, heard)
    if not isinstance(law, Descent):
        raise InputError(
            f"monitor_stability: {type(law).__name__} has no constant gain, which the adaptation number is of"
        )
    e, e_rate = p - run.reference_p[::every], v - run.reference_v[::every]
    v_r = run.reference_v[::every] - controller.bandwidth * e
    a_r = run.reference_a[::every] - controller.bandwidth * e_rate
    Y = controller.model.slotine_li_regressor(p, v, v_r, a_r) / np.sqrt(controller.damping)[:, None]
    root = np.sqrt(law.gain) * Y if law.gain.ndim == 1 else Y @ np.linalg.cholesky(law.gain)
    largest = np.linalg.norm(root, ord=2, axis=(-2, -1))
    return StabilityMonitor(np.asarray(controller.control_period * largest**2), hold, heard)


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

    `lag_product` (r,) is the average of s_j s_(j-1) and `power` (r,) that of s_(j-1)^2, j counting the control periods,
    both in rad^2/s^2 (m^2/s^2 if prismatic); `s` (r,) is the last s, in rad/s (m/s). The correlation of s with itself
    is rho = lag_product/(power + 1e-4). `count` (2,) counts the control periods in a row in which some joint's rho was
    below -0.5 (first number) and below -0.9 (second). All are arrays or Columns. Nothing is checked.
    """

    lag_product: Any
    power: Any
    s: Any
    count: Any
    """(2,) control periods in a row in which some joint's rho was below ALARM and below BRAKE: a single jump is
    neither"""

    @classmethod
    def zero(cls, dof: int) -> Ringing:
        """Detector of ringing for `dof` joints before the first control period: all its averages and counts are zero.
        Nothing is checked."""
        return cls(np.zeros(dof), np.zeros(dof), np.zeros(dof), np.zeros(2))

    def updated(self, s: Column) -> Ringing:
        """Detector of ringing after one more control period, in which the sliding variable was `s`, a `Column` (r,) of
        r joints in rad/s (m/s if prismatic). The detector's own fields must be Columns too. Nothing is checked."""
        keep, new = 1.0 - 1.0 / SPAN, 1.0 / SPAN
        product = keep * self.lag_product + new * (self.s * s)
        square = keep * self.power + new * (self.s * self.s)
        worst = _least(correlation(product, square))
        pairs = zip(self.count, (ALARM, BRAKE), strict=True)
        return Ringing(product, square, s, Column(where(worst < bound, x + 1.0, 0.0) for x, bound in pairs))

    @property
    def alarm(self) -> Any:
        """Alarm of ringing, one scalar for all joints: 1 where some joint rings, else 0. A joint rings where, for 25
        control periods in a row, its sliding variable had a correlation with itself one control period ago below -0.5,
        that is, mostly changed its sign."""
        return where(self.count[0] >= LASTING, 1.0, 0.0)

    @property
    def brake(self) -> Any:
        """Signal to brake the arm, one scalar for all joints: 1 where ringing dominates, else 0. It does where, for 25
        control periods in a row, some joint's sliding variable had a correlation with itself one control period ago
        below -0.9."""
        return where(self.count[1] >= LASTING, 1.0, 0.0)


def correlation(product: Column, square: Column) -> Column:
    """Correlation rho (r,), without a unit, of the sliding variables s of r joints with themselves one control period
    ago: rho = product/(square + 1e-4), which goes to 0 where s is below 0.01 rad/s (m/s).

    `product` (r,) is the moving average of s_j s_(j-1) and `power` (r,) that of s_(j-1)^2, j counting the control
    periods, both in rad^2/s^2 (m^2/s^2 if prismatic). In a loop without disturbance rho is 1 - h. h is its sampling
    ratio, the control period times the rate at which the held torque damps s; the loop is stable for h below 2. Raises
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
    averages, found = Ringing(*map(Column, Ringing.zero(s.shape[-1]))), np.empty(s.shape)
    for k, row in enumerate(s):
        averages = averages.updated(Column(row.tolist()))
        found[k] = correlation(averages.lag_product, averages.power).of
    return found
