"""Stability numbers and ringing of a run."""

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
    """
    Measures of how near a run of T samples is to instability by sampling.

    Parameters
    ----------
    adaptation_ratio : ndarray
        Largest eigenvalue (T,) of T_c K^-1 Y Gamma Y^T, without a unit, stable below 2; 0 with adaptation off.
    sampling_ratio : ndarray
        Sampling ratio (T,) of the held torque, stable below 2; infinite if the mass matrix is not positive definite.
    ringing : ndarray
        Correlation (T, r), -1 to 1, of each joint's sliding variable with itself one control period earlier. At -0.5
        the loop rings, at -0.9 it is about to diverge.

    Examples
    --------
    >>> adaptctl.control.monitor_stability(law, run, arm).ringing.shape
    (200, 2)
    """

    adaptation_ratio: Array
    sampling_ratio: Array
    ringing: Array


class _Run(LearningRun, SampledRun, Protocol):
    """Run with estimates and the reference's accelerations."""


def monitor_stability(controller: SlotineLi, run: _Run, mechanism: Mechanism, every: int = 1) -> StabilityMonitor:
    r"""
    Compute how near a run of Slotine and Li's law is to instability by sampling.

    Parameters
    ----------
    controller : SlotineLi
        Controller of the run, with r joints.
    run : Rollout
        Run with every control period as a sample, and the estimates.
    mechanism : Mechanism
        True mechanism.
    every : int, default 1
        Number of samples from one evaluation to the next. By default all are evaluated; each costs a regressor and a
        mass matrix.

    Returns
    -------
    StabilityMonitor
        Adaptation ratio, sampling ratio and ringing at T samples.

    Raises
    ------
    InputError
        If the law has another sliding variable or no constant gain, the run another number of joints, or `every` is no
        positive whole number.
    SingularityError
        If the arm is near a singularity of the kinematic loops.

    Notes
    -----
    .. math:: T_c\lambda_{\max}(K^{-1}Y\Gamma Y^\top),\quad T_c\lambda_{\max}(M^{-1}(K+\hat M\Lambda)).

    Examples
    --------
    >>> monitor = adaptctl.control.monitor_stability(law, run, arm, every=10)
    >>> bool(monitor.sampling_ratio.max() < 2.0)
    True
    """
    every = whole_count(every, "monitor_stability: every", 1)
    s = sliding_variable(controller, run)
    p, v, estimate = run.p[::every], run.v[::every], run.estimate[::every]
    parameters = controller.model.embed(estimate)
    hold = sampling_ratios(
        mechanism, p, controller.damping, controller.control_period, controller.bandwidth, estimate=parameters
    )
    correlations = ringing(s)[::every]
    law = controller.adaptation_law
    if law is None:
        return StabilityMonitor(np.zeros(len(p)), hold, correlations)
    if not isinstance(law, Descent):
        raise InputError(
            f"monitor_stability: {type(law).__name__} has no constant gain, which the normalised adaptation gain needs"
        )
    e, e_rate = p - run.reference_p[::every], v - run.reference_v[::every]
    v_r = run.reference_v[::every] - controller.bandwidth * e
    a_r = run.reference_a[::every] - controller.bandwidth * e_rate
    Y = controller.model.slotine_li_regressor(p, v, v_r, a_r) / np.sqrt(controller.damping)[:, None]
    root = np.sqrt(law.gain) * Y if law.gain.ndim == 1 else Y @ np.linalg.cholesky(law.gain)
    largest = np.linalg.norm(root, ord=2, axis=(-2, -1))
    return StabilityMonitor(np.asarray(controller.control_period * largest**2), hold, correlations)


AVERAGING_PERIODS = 100
MIN_SLIDING_VARIABLE = 0.01  # rad/s (m/s): the signs of a smaller average mean little
ALARM_CORRELATION, BRAKE_CORRELATION = -0.5, -0.9  # below the first the loop rings, below the second hardly all else
MIN_PERIODS = 25  # in a row, so that a single jump is no ringing


class Ringing(NamedTuple):
    """Moving averages of s times last s and squares, last s, counts."""

    lag_product: Any
    power: Any
    s: Any
    count: Any

    @classmethod
    def zero(cls, dof: int) -> Ringing:
        """Detector before the first period."""
        return cls(np.zeros(dof), np.zeros(dof), np.zeros(dof), np.zeros(2))

    def updated(self, s: Column) -> Ringing:
        """Detector after a period."""
        keep, new = 1.0 - 1.0 / AVERAGING_PERIODS, 1.0 / AVERAGING_PERIODS
        product = keep * self.lag_product + new * (self.s * s)
        square = keep * self.power + new * (self.s * self.s)
        worst = _minimum(correlation(product, square))
        pairs = zip(self.count, (ALARM_CORRELATION, BRAKE_CORRELATION), strict=True)
        return Ringing(product, square, s, Column(where(worst < bound, x + 1.0, 0.0) for x, bound in pairs))

    @property
    def alarm(self) -> Any:
        """1 if some joint rings."""
        return where(self.count[0] >= MIN_PERIODS, 1.0, 0.0)

    @property
    def brake(self) -> Any:
        """1 if ringing dominates."""
        return where(self.count[1] >= MIN_PERIODS, 1.0, 0.0)


def correlation(product: Column, square: Column) -> Column:
    """Correlation (r,) with the last period: 1 minus the sampling ratio, without disturbance."""
    return Column(x / (y + MIN_SLIDING_VARIABLE * MIN_SLIDING_VARIABLE) for x, y in zip(product, square, strict=True))


def _minimum(values: Column) -> Any:
    least = values[0]
    for x in values.of[1:]:
        least = minimum(least, x)
    return least


def ringing(s: Array) -> Array:
    """Correlation (T, r) with the last period along a run."""
    averages, found = Ringing(*map(Column, Ringing.zero(s.shape[-1]))), np.empty(s.shape)
    for k, row in enumerate(s):
        averages = averages.updated(Column(row.tolist()))
        found[k] = correlation(averages.lag_product, averages.power).of
    return found
