"""Slotine and Li's controller with a leaky integral."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from adaptctl.arrays import Array, positive_number, real_number
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.passivity_based import Instant
from adaptctl.control.slotine_li import SlotineLi
from adaptctl.errors import InputError
from adaptctl.scalars import Column, absolute, clip, column, where

MAX_RATE = 0.2
"""rate times the control period: with three fifths of an adaptation ratio of 1/2, V still does not rise"""
AGREEMENT = 0.125
"""share of a speed's change within which it agrees with positions: exact speeds do, filtered differences, which are
late, and noisy speeds do not"""


class FastTorque(NamedTuple):
    """Torques (r,) beside the model's in N m (N), shares (r,) of the time in which speeds agreed, and speeds (r,)."""

    torque: Any
    agreed: Any
    v: Any


@dataclass(frozen=True, eq=False)
class LeakyIntegral(SlotineLi):
    r"""
    Slotine and Li's controller with a leaky integral of the sliding variable.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    bandwidth : array_like
        Decay rate Lambda of the tracking error in 1/s, one number or (r,).
    damping : array_like
        Damping K in N m s/rad (N s/m for a prismatic joint), one number or (r,).
    adaptation : AdaptationLaw or array_like, optional
        Adaptation law, or the gain of `Gradient`: its diagonal (k,) or the whole matrix (k, k), in units of the
        parameters squared per J. None switches adaptation off.
    initial : array_like, optional
        Initial estimate (k,) in SI units, zero unless given.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    workspace : Workspace, optional
        Joint positions for which the gains are checked. Unless given, all that the joints' limits allow.
    torque_limits : array_like, optional
        Limits in N m (N), one number or (r,). Nothing is learned from a period whose torque exceeds them; the
        mechanism's own limits unless given.
    prior : array_like, optional
        Largest plausible error (k,) of each initial parameter in SI units. With it, gains for which the estimates could
        make the sampled loop ring give a `StabilityWarning`.
    integral_rate : float, default 40.0
        Rate in 1/s at which the integral follows what the model misses, at most 0.2 divided by the control period. At
        40 it is faster than friction changes within a swing.
    leak : float, default 1.0
        Rate in 1/s at which it fades. At 1 what wound up at rest is gone within seconds.
    integral_share : float, default 0.1
        Share of the torque limits that it has at most: more than friction that is in no model.
    added_rate : float, default 0.0
        Rate in 1/s that is added for joints whose measured speeds agree with their positions, at most what
        `integral_rate` leaves of 0.2 divided by the control period. Noise and filters of speeds make light arms
        diverge with it. `tune` takes all that is left.

    Raises
    ------
    GainError
        If the sampling ratio of the gains is above 1.5 or the mass matrix not positive definite.
    InputError
        If a number is out of range, a shape is wrong, or the adaptation law does not fit the model.

    Notes
    -----
    .. math::

        \tau=Y\hat\beta-Ks+z,\quad \dot z=-\rho Ks-\mu z,

    where z estimates a constant torque that is truly zero: :math:`V+\tfrac12z^\top(\rho K)^{-1}z` falls [1]_, also
    while the rate does, by 2 mu at most. The integral of s is corrected by what positions moved and measured speeds do
    not tell, so that noise of speeds does not add up. A law that predicts torques learns from those applied, with z
    among them, so that z biases no estimate.

    References
    ----------
    .. [1] Slotine and Li, Applied Nonlinear Control, 1991, section 9.2.

    Examples
    --------
    >>> controller = adaptctl.control.LeakyIntegral(model, bandwidth=5.0, damping=[6.0, 2.0])
    >>> controller.init(p, v).controller_state.torque
    array([0., 0.])
    """

    tunable: ClassVar[tuple[str, ...]] = (*SlotineLi.tunable, "integral_rate", "leak", "integral_share", "added_rate")

    integral_rate: float = 40.0
    leak: float = 1.0
    integral_share: float = 0.1
    added_rate: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, unit in (("integral_rate", " in 1/s"), ("leak", " in 1/s"), ("integral_share", "")):
            positive_number(getattr(self, name), f"leaky integral: {name}: expected a positive number{unit}")
        if real_number(self.added_rate, "leaky integral: added_rate") < 0.0:
            raise InputError(f"leaky integral: added_rate: expected at least 0 1/s, got {self.added_rate:g}")
        if (self.integral_rate + self.added_rate) * self.control_period > MAX_RATE * (1.0 + 1e-9):
            raise InputError(
                f"leaky integral: integral_rate: {self.integral_rate + self.added_rate:g} 1/s, with what is added, is "
                f"too fast for a control period of {self.control_period:g} s; use at most "
                f"{MAX_RATE / self.control_period:g} 1/s"
            )

    def _feedback(self, at: Instant, memory: AdaptiveState) -> tuple[Column, FastTorque]:
        damping, period, before = column(self.damping), self.control_period, memory.controller_state
        missed = self._missed(at, memory)
        keep = 1.0 / (1.0 + self.leak * period)
        rates = Column(self.integral_rate + self.added_rate * x for x in before.agreed)
        grown = Column(before.torque) - (memory.dt[0] * rates) * damping * (at.s + (1.0 / period) * missed)
        torque = self._bounded(keep * grown)
        return damping * at.s - torque, FastTorque(torque, self._agreed(at, missed, before), at.v)

    def _missed(self, at: Instant, memory: AdaptiveState) -> Column:
        """Moves (r,) of the past period in rad (m) less those by the measured speeds: these drift with noise."""
        moved = at.p - Column(memory.q[i] for i in self.model.mechanism.description.primary)
        return moved - (0.5 * self.control_period) * (at.v + memory.controller_state.v)

    def _agreed(self, at: Instant, missed: Column, before: FastTorque) -> Column:
        """Shares (r,) of the time, which fall at twice the leak: the energy of a slower integral is larger."""
        changed, fresh = (AGREEMENT * self.control_period) * (at.v - before.v), 2.0 * self.leak * self.control_period
        agrees = (where(absolute(x) < absolute(y), fresh, 0.0) for x, y in zip(missed, changed, strict=True))
        return (1.0 / (1.0 + fresh)) * (before.agreed + Column(agrees))

    def _bounded(self, torque: Column) -> Column:
        """Torque (r,) within its share of finite limits."""
        pairs = zip(torque, np.asarray(self.torque_limits).tolist(), strict=True)
        share = self.integral_share
        return Column(clip(x, -share * most, share * most) if np.isfinite(most) else x for x, most in pairs)

    def _controller_state(self, p: Array, v: Array) -> FastTorque:
        return FastTorque(*np.zeros((3, self.dof)))
