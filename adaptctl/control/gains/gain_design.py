"""Gains of a whole arm, with their margins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from adaptctl.arrays import Array, positive_per_joint, whole_number
from adaptctl.control.gains.error_feedback import ErrorFeedback, Margins, margins
from adaptctl.control.gains.gains import Gains, sampled_gain
from adaptctl.control.gains.sampling_ratio import MAX_SAMPLING_RATIO, sampled_inertia, sampling_ratio
from adaptctl.control.gains.workspace import Workspace, everywhere
from adaptctl.dynamics import Mechanism
from adaptctl.errors import GainError, InputError

SEARCHED = (1e-3, 30.0)
"""rad a period: where the fastest pole is sought that a period carries"""


@dataclass(frozen=True, eq=False)
class GainDesign:
    """Gain design for a `mechanism`: linear feedback of the error of each of its r joints, for a control `period` (s)
    and a `delay` of the torque in whole control periods, 0 by default.

    `from_bandwidth`, `from_poles`, `from_lqr` and `of_gains` make one; the constructor itself checks nothing. `method`
    is "bandwidth", "poles", "lqr" or "rule"; `feedback` and `margins` have an `ErrorFeedback` and a `Margins` a joint.
    `inertia` (r,), in kg m^2 (kg if prismatic), is each joint's typical inertia, for which its loop is designed: the
    median of its entry of the mass matrix's diagonal over 200 random configurations. The margins are those of each
    joint's sampled loop alone, with the delay. `least_inertia` (r,), without a unit, is a ratio: the least inertia, in
    these configurations, that a joint has while all others are free, divided by its typical inertia. 1/`least_inertia`
    is the factor by which the loop's gain grows there, and the loop's gain margin must be above it. With a `workspace`,
    a set of joint positions, its samples stand for the random configurations. `given` are Slotine and Li's gains that
    the design was made of, None where they follow from the feedback.
    """

    mechanism: Mechanism
    method: str
    feedback: tuple[ErrorFeedback, ...]
    inertia: Array
    least_inertia: Array
    margins: tuple[Margins, ...]
    control_period: float
    delay: int = 0
    workspace: Workspace | None = None
    given: Gains | None = None

    @classmethod
    def of_gains(
        cls, mechanism: Mechanism, gains: Gains, workspace: Workspace, *, control_period: float = 1e-3, delay: int = 0
    ) -> GainDesign:
        """Gain design, a `GainDesign`, of Slotine and Li's `gains` given for the r joints of a `mechanism`, such as
        those that `adaptctl.tune` finds, judged in a `workspace`, the set of joint positions for which they are meant.
        `period` is the control period in s, 1 ms by default, `delay` that of the torque in whole periods, 0 by default.

        With the bandwidth Lambda (1/s), the damping K and the inertia m of a joint its error loop has the poles
        -Lambda and -K/m: the stiffness is Lambda K/m, the rate Lambda + K/m. m is the median of the joint's entry of
        the diagonal of what a held torque feels as inertia (`sampled_inertia`) over the workspace's samples: the mass
        matrix's, and more with viscous friction. Raises `InputError` for gains and a period that are not positive, a
        delay other than a whole number from 0 to 1000, and where m is not positive; `GainError` where a loop alone
        cannot be carried by a hold of the period.
        """
        delay = whole_number(delay, "delay", 0, 1000)
        Lambda, K = (
            positive_per_joint(values, mechanism.dof, what)
            for values, what in ((gains.bandwidth, "bandwidth"), (gains.damping, "damping"))
        )
        inertia, least = _inertias(
            mechanism, sampled_inertia(mechanism, workspace.samples, workspace.mass_matrices, control_period)
        )
        pairs = zip((Lambda * K / inertia).tolist(), (Lambda + K / inertia).tolist(), strict=True)
        feedback = tuple(ErrorFeedback(stiffness, rate, control_period) for stiffness, rate in pairs)
        found = _margins(feedback, delay)
        return cls(
            mechanism, "rule", feedback, inertia, least, found, control_period, delay, workspace, Gains(Lambda, K)
        )

    @classmethod
    def from_bandwidth(
        cls,
        mechanism: Mechanism,
        bandwidth: ArrayLike,
        damping_ratio: ArrayLike = 1.0,
        *,
        control_period: float = 1e-3,
        delay: int = 0,
    ) -> GainDesign:
        """Gain design for a `mechanism`, a `GainDesign`, in which each joint's sampled error loop has the poles of a
        second-order loop. Its undamped natural frequency is `bandwidth` (rad/s), its damping ratio `damping_ratio` (no
        unit; 1, the default, is critical), each one number or one for each of r joints (r,). `period` is the control
        period in s, 1 ms by default, `delay` that of the torque in whole periods, 0 by default.

        Raises `InputError` for numbers that are not positive or of another shape, for a delay other than a whole number
        from 0 to 1000, and where a joint's typical inertia, the median of its entry of the mass matrix's diagonal over
        200 random configurations, is not positive.
        """
        rates, ratios = (
            positive_per_joint(values, mechanism.dof, what)
            for values, what in ((bandwidth, "bandwidth"), (damping_ratio, "damping ratio"))
        )
        pairs = zip(rates.tolist(), ratios.tolist(), strict=True)
        feedback = [ErrorFeedback.from_bandwidth(rate, ratio, control_period) for rate, ratio in pairs]
        return _design(mechanism, "bandwidth", feedback, control_period, delay)

    @classmethod
    def from_poles(
        cls, mechanism: Mechanism, poles: Sequence[complex], *, control_period: float = 1e-3, delay: int = 0
    ) -> GainDesign:
        """Gain design for a `mechanism`, a `GainDesign`, with the same two continuous-time `poles` (1/s) at each
        joint's error loop, real or a conjugate pair, with negative real parts. `period` is the control period in s, 1
        ms by default, `delay` that of the torque in whole periods, 0 by default.

        Raises `InputError` for other poles, a period that is not positive, a delay other than a whole number from 0 to
        1000, and where a joint's typical inertia, the median of its entry of the mass matrix's diagonal over 200 random
        configurations, is not positive.
        """
        feedback = ErrorFeedback.from_poles(poles, control_period)
        return _design(mechanism, "poles", [feedback] * mechanism.dof, control_period, delay)

    @classmethod
    def from_lqr(
        cls,
        mechanism: Mechanism,
        position: float,
        velocity: float = 0.0,
        effort: float = 1.0,
        *,
        control_period: float = 1e-3,
        delay: int = 0,
    ) -> GainDesign:
        """Gain design for a `mechanism`, a `GainDesign`, by the linear-quadratic regulator (infinite horizon) at each
        joint. The weights are `position` of e^2 in 1/rad^2, `velocity` of e'^2 in s^2/rad^2, 0 by default, and `effort`
        of e''^2 in s^4/rad^2, 1 by default (m for rad at a prismatic joint), e the joint's error and primes derivatives
        in time; only their ratios count. `period` is the control period in s, 1 ms by default, `delay` that of the
        torque in whole periods, 0 by default.

        Raises `InputError` for a `position` or `effort` that is not positive, a negative `velocity`, weights too far
        apart for the Riccati equation to be solved at this period, a period that is not positive, a delay other than a
        whole number from 0 to 1000, and where a joint's typical inertia, the median of its entry of the mass matrix's
        diagonal over 200 random configurations, is not positive.
        """
        feedback = ErrorFeedback.from_lqr(position, velocity, effort, control_period)
        return _design(mechanism, "lqr", [feedback] * mechanism.dof, control_period, delay)

    @property
    def gains(self) -> Gains:
        """Slotine and Li's gains of this design for r joints, a `Gains`. Its bandwidth Lambda (r,) in 1/s is the slower
        of the two decay rates of each joint's error loop; its damping K (r,) in N m s/rad (N s/m if prismatic) is the
        faster one times the joint's typical inertia, for which the loop is designed. Raises `InputError` where a
        joint's poles are complex, that is, where the property `damped_enough` is False. For a design that was made of
        gains they are these."""
        if self.given is not None:
            return self.given
        rates = np.array([feedback.cascaded for feedback in self.feedback])
        return Gains(rates[:, 0], rates[:, 1] * self.inertia)

    @property
    def is_well_damped(self) -> bool:
        """True if every joint's error loop counts as one of two real poles, so that the property `gains`, Slotine and
        Li's gains, exists. The criterion is 1/zeta^2 - 1 <= 0.02 + omega T_c, with a loop's damping ratio zeta, its
        undamped natural frequency omega (rad/s) and the control period T_c (s)."""
        return self.given is not None or all(feedback.is_cascade for feedback in self.feedback)

    @property
    def bandwidth(self) -> Array:
        """Undamped natural frequencies (r,), rad/s, of this design's continuous-time error loops of r joints: the
        argument `bandwidth` of `ComputedTorque`."""
        return np.array([feedback.bandwidth for feedback in self.feedback])

    @property
    def damping_ratio(self) -> Array:
        """Damping ratios (r,), without a unit, of this design's continuous-time error loops of r joints; 1 is
        critical."""
        return np.array([feedback.damping_ratio for feedback in self.feedback])

    @property
    def damping(self) -> Array:
        """Velocity gains (r,), N m s/rad (N s/m for a prismatic joint), of this design's error loops of r joints. Each
        is the rate (1/s) of the feedback e'' = -stiffness e - rate e' of a joint's error e, primes being derivatives in
        time, times the joint's typical inertia, for which the loop is designed."""
        return self.inertia * np.array([feedback.rate for feedback in self.feedback])

    @property
    def sampled_gain(self) -> float:
        """The greatest sampled gain T_c lambda_max(M^-1 K), without a unit, that a local search over all positions
        within the joints' limits finds. T_c is the control period, lambda_max the largest eigenvalue, M the mass matrix
        and K the velocity gains, the property `damping`: a torque held over T_c is stable below 2, and below 1 with a
        delay of one period. The search starts from the worst of 200 random positions."""
        if (own := self.given) is not None:
            return sampling_ratio(
                self.mechanism, own.damping, self.control_period, own.bandwidth, workspace=self.workspace
            ).value
        return sampled_gain(self.mechanism, self.damping, self.control_period)

    @property
    def largest_sampled_gain(self) -> float:
        """The largest sampled gain T_c lambda_max(M^-1 K), without a unit, that is allowed: three quarters of the limit
        of stability of a held torque. It is 1.5 without delay, 0.75 with a delay of one period, less with more. T_c is
        the control period, lambda_max the largest eigenvalue, M the mass matrix and K the damping."""
        return largest_with_delay(self.delay)

    @property
    def max_gain(self) -> float:
        """The greatest magnitude (1/s) of the continuous-time poles of all joints' error loops."""
        return max(abs(pole) for feedback in self.feedback for pole in feedback.poles)

    @property
    def max_bandwidth(self) -> float:
        """The largest factor, without a unit, by which all poles may be multiplied with the sampled gain still allowed:
        below 1 where it is too large already.

        The sampled gain T_c lambda_max(M^-1 K), with the control period T_c, the largest eigenvalue lambda_max, the
        mass matrix M and the damping K, is allowed up to the property `largest_sampled_gain`, 1.5 without delay. The
        factor is infinite where even a deadbeat loop is allowed, 0 where none is, as where M is not positive definite.
        """
        if self.given is not None:  # the sampling ratio is in proportion to both gains
            return self.largest_sampled_gain / self.sampled_gain

        def excess(logarithm: float) -> float:
            rates = np.array(
                [feedback.with_bandwidth_factor(float(np.exp(logarithm))).rate for feedback in self.feedback]
            )
            return sampled_gain(self.mechanism, self.inertia * rates, self.control_period) - self.largest_sampled_gain

        slowest, quickest = (float(np.log(angle / (self.max_gain * self.control_period))) for angle in SEARCHED)
        if excess(quickest) <= 0.0:
            return np.inf
        if excess(slowest) > 0.0:
            return 0.0
        return float(np.exp(brentq(excess, slowest, quickest, xtol=1e-6)))

    def check_sample_time(self) -> GainDesign:
        """This gain design itself, if its sampled gain T_c lambda_max(M^-1 K), without a unit, is allowed: at most the
        property `largest_sampled_gain`, 1.5 without delay. T_c is the control period, lambda_max the largest
        eigenvalue, M the mass matrix and K the damping; the gain is the property `sampled_gain`. Raises `GainError`
        otherwise, whose message says which gains the period allows."""
        if not self.sampled_gain <= self.largest_sampled_gain:
            late = f" and a delay of {self.delay} periods" if self.delay else ""
            raise GainError(
                f"{self.mechanism.name}: the gains are too stiff for a control period of {self.control_period:g} "
                f"s{late}: "
                f"T_c lambda_max(M^-1 K) = {self.sampled_gain:.3g}, at most {self.largest_sampled_gain:.3g} is "
                f"allowed. The largest gains that it carries have all poles at {self.max_bandwidth:.3g} times these, "
                f"the "
                f"fastest at {self.max_bandwidth * self.max_gain:.4g} 1/s instead of {self.max_gain:.4g}; or shorten "
                f"the period"
            )
        return self


def largest_with_delay(delay: int) -> float:
    """The largest sampled gain T_c lambda_max(M^-1 K), without a unit, that is allowed where the torque comes `delay`
    whole control periods late, 0 or more. It is three quarters of the limit of stability: 1.5 without delay, 0.75 with
    one period. T_c is the control period, M the mass matrix, K the velocity gains, lambda_max the largest eigenvalue.
    Nothing is checked.

    A velocity that is held and fed back d periods late, with the characteristic equation z^(d+1) - z^d + g = 0, is
    stable for sampled gains g below 2 sin(pi/(2(2d + 1))): 2, 1, 0.62, ... (Levin and May 1976).
    """
    limit = 2.0 * float(np.sin(np.pi / (2.0 * (2.0 * delay + 1.0))))
    return 0.5 * MAX_SAMPLING_RATIO * limit


def _design(
    mechanism: Mechanism, method: str, feedback: Sequence[ErrorFeedback], control_period: float, delay: int
) -> GainDesign:
    """The design with each joint's feedback. Raises `InputError` for a wrong delay and where an inertia is none."""
    delay = whole_number(delay, "delay", 0, 1000)
    found = _margins(feedback, delay)
    inertia, least = _inertias(mechanism, everywhere(mechanism).mass_matrices)
    return GainDesign(mechanism, method, tuple(feedback), inertia, least, found, control_period, delay)


def _inertias(mechanism: Mechanism, M: Array) -> tuple[Array, Array]:
    """Typical inertia (r,) of each joint in mass matrices (S, r, r), and the least with all others free, over it."""
    inertia = np.median(np.diagonal(M, axis1=-2, axis2=-1), axis=0)
    if np.any(inertia <= 0.0):
        raise InputError(f"{mechanism.name}: gains need a positive inertia at every joint, got {inertia}")
    free = 1.0 / np.diagonal(np.linalg.inv(M), axis1=1, axis2=2)
    return inertia, free.min(axis=0) / inertia


def _margins(feedback: Sequence[ErrorFeedback], delay: int) -> tuple[Margins, ...]:
    """Margins of each loop, found once for equal ones."""
    known = {one: margins(one.loop(delay)) for one in dict.fromkeys(feedback)}
    return tuple(known[one] for one in feedback)
