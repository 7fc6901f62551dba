"""Gain design with margins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_per_joint, whole_number
from adaptctl.control.gains.error_feedback import MAX_DELAY, ErrorFeedback, Margins, margins
from adaptctl.control.gains.gains import Gains, sampled_gain
from adaptctl.control.gains.sampling_ratio import MAX_SAMPLING_RATIO, sampled_inertia, sampling_ratio, stable_below
from adaptctl.control.gains.workspace import Workspace, everywhere
from adaptctl.dynamics import Mechanism
from adaptctl.errors import GainError, InputError
from adaptctl.optional_packages import needed

POLE_ANGLE_RANGE = (1e-3, 30.0)  # rad per period, in which the largest allowed pole is sought


@dataclass(frozen=True, eq=False)
class GainDesign:
    """
    Linear error feedback of every joint, with stability margins.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    method : str
        Design method: "bandwidth", "poles", "lqr" or "rule".
    feedback : tuple of ErrorFeedback
        Feedback of each joint.
    inertia : ndarray
        Typical inertia (r,) in kg m^2 (kg), for which each loop is designed.
    least_inertia : ndarray
        Least inertia (r,) that each joint moves while the others are free, divided by its typical inertia, without a
        unit. The gain margin of the loop must exceed the inverse.
    margins : tuple of Margins
        Margins of each sampled loop alone, with the delay.
    control_period : float
        Time in s for which a torque is held.
    delay : int, default 0
        Delay of the torque in whole control periods. Zero for a torque that acts at once.
    workspace : Workspace, optional
        Joint positions for which the sampled gain is computed. Default: 200 random ones within the limits.
    given : Gains, optional
        Gains of Slotine and Li's law that `from_gains` was called with. Default: None, other methods.

    Examples
    --------
    >>> design = adaptctl.control.GainDesign.from_bandwidth(arm, 6.0)
    >>> design.gains.damping.shape, len(design.margins)
    ((2,), 2)
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

    def __repr__(self) -> str:
        return f"<GainDesign of {self.mechanism.name!r} by {self.method}>"

    @classmethod
    def from_gains(
        cls, mechanism: Mechanism, gains: Gains, workspace: Workspace, *, control_period: float = 1e-3, delay: int = 0
    ) -> GainDesign:
        """
        Return the design, with its stability margins, of given gains.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with r joints.
        gains : Gains
            Gains of Slotine and Li's law, as `tune` finds them.
        workspace : Workspace
            Joint positions for which they are meant.
        control_period : float, default 0.001
            Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
        delay : int, default 0
            Delay of the torque in whole control periods, 0 to 100. Zero for a torque that acts at once.

        Returns
        -------
        GainDesign
            Design whose joints have error poles at minus the bandwidth and minus the damping divided by the inertia.

        Raises
        ------
        InputError
            If a gain, period or inertia is not positive, or the delay out of range.
        GainError
            If the period is too long for a joint's loop alone.

        Examples
        --------
        >>> gains, workspace = adaptctl.Gains.from_bandwidth(arm, 5.0), adaptctl.control.Workspace.within_limits(arm)
        >>> len(adaptctl.control.GainDesign.from_gains(arm, gains, workspace).margins)
        2
        """
        delay = whole_number(delay, "delay", 0, MAX_DELAY)
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
        """
        Design the feedback by bandwidth and damping ratio.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with r joints.
        bandwidth : array_like
            Undamped natural frequency in rad/s, one number or (r,).
        damping_ratio : array_like, default 1.0
            Damping ratio, one number or (r,); 1 is critical.
        control_period : float, default 0.001
            Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
        delay : int, default 0
            Delay of the torque in whole control periods, 0 to 100. Zero for a torque that acts at once.

        Returns
        -------
        GainDesign
            Design whose sampled loops have the poles of these second-order loops.

        Raises
        ------
        InputError
            If a number or a typical inertia is not positive, a shape is wrong, or the delay out of range.

        Examples
        --------
        >>> adaptctl.control.GainDesign.from_bandwidth(arm, 6.0, delay=1).bandwidth.round(0)
        array([6., 6.])
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
        """
        Design the feedback by two poles of every joint.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with r joints.
        poles : sequence of complex
            Two continuous-time poles in 1/s, real or conjugate, with negative real parts.
        control_period : float, default 0.001
            Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
        delay : int, default 0
            Delay of the torque in whole control periods, 0 to 100. Zero for a torque that acts at once.

        Returns
        -------
        GainDesign
            Design whose sampled loops have these poles.

        Raises
        ------
        InputError
            If the poles are not such a pair, a period or typical inertia is not positive, or the delay out of range.

        Examples
        --------
        >>> adaptctl.control.GainDesign.from_poles(arm, [-8.0, -12.0]).is_well_damped
        True
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
        """
        Design the feedback as a linear-quadratic regulator.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with r joints.
        position : float
            Weight of the squared error in 1/rad^2 (1/m^2).
        velocity : float, default 0.0
            Weight of the squared error rate in s^2/rad^2 (s^2/m^2). Zero weighs the position alone; more damps more.
        effort : float, default 1.0
            Weight of the squared acceleration in s^4/rad^2 (s^4/m^2). Only ratios of weights count, so 1 sets the
            scale.
        control_period : float, default 0.001
            Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
        delay : int, default 0
            Delay of the torque in whole control periods, 0 to 100. Zero for a torque that acts at once.

        Returns
        -------
        GainDesign
            Design with the regulator of an infinite horizon at every joint.

        Raises
        ------
        InputError
            If a weight is out of range or weights are too far apart, a period or typical inertia is not positive, or
            the delay out of range.

        Examples
        --------
        >>> adaptctl.control.GainDesign.from_lqr(arm, position=4096.0).method
        'lqr'
        """
        feedback = ErrorFeedback.from_lqr(position, velocity, effort, control_period)
        return _design(mechanism, "lqr", [feedback] * mechanism.dof, control_period, delay)

    @property
    def gains(self) -> Gains:
        """Gains for Slotine and Li's law; `InputError` where poles of a joint are complex."""
        if self.given is not None:
            return self.given
        rates = np.array([feedback.cascaded for feedback in self.feedback])
        return Gains(rates[:, 0], rates[:, 1] * self.inertia)

    @property
    def is_well_damped(self) -> bool:
        """True if every joint has real poles, as `gains` requires."""
        return self.given is not None or all(feedback.is_cascade for feedback in self.feedback)

    @property
    def bandwidth(self) -> Array:
        """Undamped natural frequencies (r,), rad/s."""
        return np.array([feedback.bandwidth for feedback in self.feedback])

    @property
    def damping_ratio(self) -> Array:
        """Damping ratios (r,)."""
        return np.array([feedback.damping_ratio for feedback in self.feedback])

    @property
    def damping(self) -> Array:
        """Velocity gains (r,), N m s/rad (N s/m)."""
        return self.inertia * np.array([feedback.rate for feedback in self.feedback])

    @property
    def sampled_gain(self) -> float:
        """Control period times the largest eigenvalue of damping divided by mass matrix; stable below 2."""
        if (own := self.given) is not None:
            return sampling_ratio(
                self.mechanism, own.damping, self.control_period, own.bandwidth, workspace=self.workspace
            ).value
        return sampled_gain(self.mechanism, self.damping, self.control_period)

    @property
    def largest_sampled_gain(self) -> float:
        """Largest allowed `sampled_gain`, three quarters of the stability limit."""
        return largest_with_delay(self.delay)

    @property
    def max_pole_magnitude(self) -> float:
        """Greatest magnitude of a pole of any joint, 1/s."""
        return max(abs(pole) for feedback in self.feedback for pole in feedback.poles)

    @property
    def max_bandwidth_factor(self) -> float:
        """Largest factor, 0 to infinity, by which all poles may be multiplied at this control period."""
        if self.given is not None:  # the sampling ratio is in proportion to both gains
            return self.largest_sampled_gain / self.sampled_gain

        if not self.max_pole_magnitude:  # lost in round-off: any factor that is a number keeps them slow
            return np.inf

        def excess(logarithm: float) -> float:
            rates = np.array(
                [feedback.with_bandwidth_factor(float(np.exp(logarithm))).rate for feedback in self.feedback]
            )
            return sampled_gain(self.mechanism, self.inertia * rates, self.control_period) - self.largest_sampled_gain

        slowest, quickest = (
            float(np.log(angle / (self.max_pole_magnitude * self.control_period))) for angle in POLE_ANGLE_RANGE
        )
        if excess(quickest) <= 0.0:
            return np.inf
        if excess(slowest) > 0.0:
            return 0.0
        with needed("a largest bandwidth"):
            from scipy.optimize import brentq  # takes longer to load than many an experiment that never needs it

        return float(np.exp(brentq(excess, slowest, quickest, xtol=1e-6)))

    def check_sample_time(self) -> GainDesign:
        """
        Return this design, or raise `GainError` if its sampled gain is too large.

        Returns
        -------
        GainDesign
            The design itself.

        Raises
        ------
        GainError
            If the gain is too large; the message says which gains the period allows.

        Examples
        --------
        >>> adaptctl.control.GainDesign.from_bandwidth(arm, 6.0).check_sample_time().method
        'bandwidth'
        """
        if not self.sampled_gain <= self.largest_sampled_gain:
            late = f" and a delay of {self.delay} periods" if self.delay else ""
            raise GainError(
                f"{self.mechanism.name}: the gains are too stiff for a control period of {self.control_period:g} "
                f"s{late}: T_c lambda_max(M^-1 K) = {self.sampled_gain:.3g}, above the limit of "
                f"{self.largest_sampled_gain:.3g}. The largest stable gains have all poles at "
                f"{self.max_bandwidth_factor:.3g} times these, the fastest at "
                f"{self.max_bandwidth_factor * self.max_pole_magnitude:.4g} 1/s instead of "
                f"{self.max_pole_magnitude:.4g}; or shorten the period"
            )
        return self


def largest_with_delay(delay: int) -> float:
    """Largest sampled gain with a delay, 3/4 of the limit."""
    return 0.5 * MAX_SAMPLING_RATIO * stable_below(delay)


def _design(
    mechanism: Mechanism, method: str, feedback: Sequence[ErrorFeedback], control_period: float, delay: int
) -> GainDesign:
    delay = whole_number(delay, "delay", 0, MAX_DELAY)
    found = _margins(feedback, delay)
    inertia, least = _inertias(mechanism, everywhere(mechanism).mass_matrices)
    return GainDesign(mechanism, method, tuple(feedback), inertia, least, found, control_period, delay)


def _inertias(mechanism: Mechanism, M: Array) -> tuple[Array, Array]:
    """Typical inertias (r,), and the least with other joints free over these."""
    inertia = np.median(np.diagonal(M, axis1=-2, axis2=-1), axis=0)
    if np.any(inertia <= 0.0):
        raise InputError(f"{mechanism.name}: gains need a positive inertia at every joint, got {inertia}")
    free = 1.0 / np.diagonal(np.linalg.inv(M), axis1=1, axis2=2)
    return inertia, free.min(axis=0) / inertia


def _margins(feedback: Sequence[ErrorFeedback], delay: int) -> tuple[Margins, ...]:
    known = {one: margins(one.loop(delay)) for one in dict.fromkeys(feedback)}
    return tuple(known[one] for one in feedback)
