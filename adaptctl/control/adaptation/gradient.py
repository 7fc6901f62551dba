"""Gradient adaptation: the law of Slotine and Li's theorem."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.adaptation.gain import Descent
from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column

TINY = 1e-300
"""Added to a power, so that nothing is divided by zero where s is zero."""


@dataclass(frozen=True, eq=False)
class Gradient(Descent[NoMemory]):
    """Gradient adaptation of the estimate (k,) of k parameters, estimate' = -Gamma Y' s (Slotine and Li 1987), once a
    control period.

        estimate -= T_c n Gamma x,  x = Y_j' s,  s = s_j + theta (s_(j+1) - s_j) from tick j to j + 1
        n = s'Ks/(s'Ks + cap T_c x'Gamma x)

    j counts the control periods. `theta`, without a unit, is 1 for the backward rule, which is the default, 1/2 for the
    trapezium and 0 for Euler's. With the factor n, of `cap` without a unit, 2 by default, the step's power T_c n
    x'Gamma x is at most s'Ks/cap, s'Ks being what the damping takes out; a cap of 0 leaves n out. s (r,) is the sliding
    variable of r joints in rad/s (m/s for a prismatic joint), Y (r, k) the torque regressor, K (r,) the control law's
    damping in N m s/rad (N s/m), T_c the period in s; `gain` is Gamma, (k,) its diagonal or (k, k), in units of the
    parameters squared per J. A prime is the transpose, but on estimate a derivative in time. Raises `InputError` for a
    gain that is not finite, symmetric and positive definite, a theta outside [0, 1] and a cap that is negative or not
    finite.

    Guarantees, in continuous time and without disturbance: V = s'Ms/2 + error' Gamma^-1 error/2, M the mass matrix and
    error the estimate less the truth, has the time derivative -s'Ks, so the tracking error goes to zero and the
    estimate stays bounded. Sampled, with M constant and without the factor n, let h = T_c lambda_max(M^-1 K), the hold
    number, and a = T_c lambda_max(K^-1 Y Gamma Y'), both without a unit, lambda_max being the largest eigenvalue. By
    the backward rule V falls where a + h < 2; by the trapezium s'(M - T_c K/2)s/2 + error' Gamma^-1 error/2 falls where
    a < 2 and h < 2; Euler's rule has no such function and serves for comparison. With n there is no theorem, only
    experience: it is there for a beyond these bounds. `ReleasedGradient` has one for every a. The derivations:
    docs/discrete_adaptation.md.

    Gives up: with any disturbance (friction, noise, saturation) and no persistent excitation the estimate drifts
    without bound; it need not become the true one; and nothing keeps it physically consistent.
    """

    tunable = ("gain",)

    theta: float = 1.0
    cap: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.theta <= 1.0:
            raise InputError(f"gradient: theta: expected a number from 0 (Euler) to 1 (backward), got {self.theta}")
        if not (np.isfinite(self.cap) and self.cap >= 0.0):
            raise InputError(f"gradient: cap: expected a finite number of at least 0, got {self.cap}")

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> NoMemory:
        """The empty internal state, a `NoMemory`, of an adaptation law that keeps nothing besides the estimate. All
        arguments are ignored: the `model`, the initial estimate `initial` (k,) of its k parameters, positions q (...,
        n) of the spanning tree's n joints in rad (m for a prismatic joint), velocities v (..., r) of the r primary
        (independent) joints in rad/s (m/s), leading axes for arms, and the control `period` in s."""
        return NoMemory()

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """The estimate (k,) of the `model`'s k parameters after the step -T_c n Gamma Y' s, T_c being the control
        period in s, and the empty internal state. Gamma is the adaptation gain, Y' the transpose of the torque
        regressor Y (r, k) at the period's start.

        s (r,) is the sliding variable of r joints, rad/s (m/s if prismatic): s_0 + theta (s_1 - s_0), s_0 and s_1 those
        at the period's start and end, so that it is s_1 for the default, 1, of the law's attribute `theta`. n is 1
        where the law's attribute `cap` is 0; else it is a factor of at most 1, s'Ks/(s'Ks + cap T_c x'Gamma x) with x =
        Y' s and the control law's damping K, which limits the power of the step.

        `estimate` (k,), in the parameters' SI units, and the internal state `memory` are those before the control
        period that `period` describes. Nothing is checked here.
        """
        s = period.after if self.theta == 1.0 else period.before + self.theta * (period.after - period.before)
        slope = period.gradient(s)
        step = self.applied(slope)
        return estimate - (period.elapsed * self._share(period, s, slope @ step)) * step, memory

    def _share(self, period: Period, s: Column, square: Any) -> Any:
        """n, for x'Gamma x."""
        if self.cap == 0.0:
            return 1.0
        power = s @ (period.damping * s)
        return power / (power + (self.cap * period.length) * square + TINY)
