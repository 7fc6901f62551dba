"""Adaptation that stops where errors are no larger than disturbances make them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, per_joint
from adaptctl.control.adaptation.gain import Descent
from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.control.gains.gains import positive_per_joint
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, each, where


@dataclass(frozen=True, eq=False)
class DeadZone(Descent[NoMemory]):
    """Gradient adaptation of the estimate (k,) with a dead zone for the sliding variable s (Peterson and Narendra
    1982).

        estimate' = -Gamma Y's outside the ellipsoid sum (s_i / width_i)^2 <= 1, and 0 within

    s (r,) is in rad/s (m/s), Y (r, k) the torque regressor; `gain` is Gamma, (k,) its diagonal or (k, k), in units of
    the parameters squared per J. `width` is the zone's half-width in rad/s (m/s), one number for all joints, as the
    default is, or (r,). Raises `InputError` for a gain that is not finite, symmetric and positive definite and a width
    that is not positive and finite.

    Guarantees: within the zone the estimate stands still, so nothing that keeps s there makes it drift. Outside,
    V = s'Ms/2 + error' Gamma^-1 error/2 has V' = -s'Ks + s'd, M the mass matrix, K the control law's damping, d (r,)
    the disturbance torque: not positive where the zone holds {s: s'Ks <= d'K^-1d}. `DeadZone.against` makes that zone.

    Gives up: tracking better than the zone; and a bound on the estimate where s enters and leaves the zone infinitely
    often: as M varies with the positions, s may leave with more energy s'Ms/2 than it came in with. `Projection` of
    this law has that bound.
    """

    tunable = ("gain", "width")

    width: Array = 0.05  # type: ignore[assignment]  # a number becomes an array for the model's joints

    def __post_init__(self) -> None:
        super().__post_init__()
        positive_per_joint(self.width, np.size(self.width), "dead zone: width")

    @classmethod
    def against(cls, gain: ArrayLike, damping: ArrayLike, torque: ArrayLike) -> DeadZone:
        """The law with the dead zone for disturbance torques of at most `torque`, in N m (N for a prismatic joint),
        under a damping K in N m s/rad (N s/m), each one number for all joints or (r,).

        At least one of the two is (r,), which says how many joints there are: of two numbers, or (1,), the zone is that
        of an arm of one joint, which laws of other arms refuse. `gain` is Gamma, (k,) or (k, k), in units of the
        parameters squared per J. Raises `InputError` for a damping that is not positive, torques and dampings of
        different sizes, a gain that is not positive definite, and torques that are negative, all zero or not finite.
        """
        joints = max(np.size(torque), np.size(damping))
        d, K = per_joint(torque, joints, "dead zone: torque"), positive_per_joint(damping, joints, "damping")
        if np.any(d < 0.0):
            raise InputError(f"dead zone: torque: expected numbers of at least 0, got {d.tolist()}")
        return cls(np.asarray(gain), np.sqrt((d**2 / K).sum() / K))

    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """Raise `InputError` unless there is a gain for each of the model's k parameters, and one positive width or one
        for each joint.

        `initial`, the first estimate (k,), and `period`, T_c in s, are not looked at.
        """
        super().require(model, initial, period)
        positive_per_joint(self.width, model.mechanism.dof, "dead zone: width")

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> NoMemory:
        """The empty memory: this law remembers nothing, whatever the first estimate `initial` (k,), in SI units, the
        configuration q (n,) of the tree's joints in rad (m), the velocities v (r,) in rad/s (m/s) and the control
        period T_c (s)."""
        return NoMemory()

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """The estimate (k,) after a step down the gradient Y's, Y (r, k) the torque regressor and s (r,) the sliding
        variable, or unchanged where the mean of s over the period is within the zone; and the empty memory.

        `estimate` (k,), in the parameters' SI units, and `memory` are those before the control period `period`.
        """
        scaled = Column(1.0 / width for width in each(self.width, model.mechanism.dof)) * period.mean
        outside = where(scaled @ scaled > 1.0, 1.0, 0.0)
        return estimate - self.applied(period.gradient(outside * period.integral)), memory
