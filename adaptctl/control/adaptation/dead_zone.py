"""Adaptation that stops where errors are no larger than disturbances make them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.control.adaptation.gain import Descent
from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.control.gains.gains import positive_per_joint
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, each, where


@dataclass(frozen=True, eq=False)
class DeadZone(Descent[NoMemory]):
    """Gradient adaptation with a dead zone (Peterson and Narendra 1982).

        estimate' = -Gamma Y's outside the ellipsoid sum (s_i / width_i)^2 <= 1, and 0 within

    `width` (r,) is in rad/s (m/s), one number for all joints or one each.

    Guarantees: within the zone the estimate stands still, so nothing that keeps s there makes it drift. Outside
    V' = -s'Ks + s'd is not positive where the zone holds {s: s'Ks <= d'K^-1d} for the disturbance d;
    `DeadZone.against` makes that zone.

    Gives up: tracking better than the zone; and, M varying with p, a bound over infinitely many ways in and
    out: s may leave the zone with more kinetic energy than it came in with. `Projection` of this law has one.
    """

    tunable = ("gain", "width")

    width: Array = 0.05  # type: ignore[assignment]  # a number becomes an array for the model's joints

    def __post_init__(self) -> None:
        super().__post_init__()
        positive_per_joint(self.width, np.size(self.width), "dead zone: width")

    @classmethod
    def against(cls, gain: ArrayLike, damping: ArrayLike, torque: ArrayLike) -> DeadZone:
        """The law with the dead zone for disturbance torques of at most `torque` (r,) N m under a damping K (r,) in N m
        s/rad; `gain` (k,) is Gamma."""
        d = np.atleast_1d(np.asarray(torque, dtype=np.float64))
        K = positive_per_joint(damping, len(d), "damping")
        return cls(np.asarray(gain), np.sqrt((d**2 / K).sum() / K))

    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """Raise `InputError` without a gain for each parameter and a width for each joint."""
        super().require(model, initial, period)
        positive_per_joint(self.width, model.mechanism.dof, "dead zone: width")

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> NoMemory:
        """The empty memory: this law remembers nothing."""
        return NoMemory()

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """The estimate (k,) after a step down the gradient, or unchanged where s is within the zone; and no memory."""
        scaled = Column(1.0 / width for width in each(self.width, model.mechanism.dof)) * period.mean
        outside = where(scaled @ scaled > 1.0, 1.0, 0.0)
        return estimate - self.applied(period.gradient(outside * period.integral)), memory
