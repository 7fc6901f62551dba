"""Gradient adaptation: the law of Slotine and Li's theorem."""

from __future__ import annotations

from dataclasses import dataclass

from adaptctl.arrays import Array
from adaptctl.control.adaptation.gain import Descent
from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column


@dataclass(frozen=True, eq=False)
class Gradient(Descent[NoMemory]):
    """estimate' = -Gamma Y's (Slotine and Li 1987).

    Guarantees, without disturbance: V = s'Ms/2 + error' Gamma^-1 error/2 falls as -s'Ks, so the tracking
    error goes to zero and the estimate stays bounded. Sampled, the trapezium -T_c Gamma Y_k'(s_k + s_k+1)/2
    holds V where Euler's rule -T_c Gamma Y_k's_k (`euler=True`, for comparison) lets it rise, and needs
    T_c lambda_max(K^-1 Y Gamma Y') < 1 besides.

    Gives up: with any disturbance (friction, noise, saturation) and no persistent excitation the estimate
    drifts without bound; it need not become the true one; and nothing keeps it physically consistent.
    """

    tunable = ("gain",)

    euler: bool = False

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> NoMemory:
        """No memory."""
        return NoMemory()

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """The estimate a step down the gradient, by the trapezium or by Euler's rule."""
        s = period.elapsed * period.before if self.euler else period.integral
        return estimate - self.applied(period.gradient(s)), memory
