"""Adaptation that stops where errors are no larger than disturbances make them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, per_joint
from adaptctl.control.adaptation.gain import Descent
from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.control.gains.gains import positive_numbers, positive_per_joint
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, each, where


@dataclass(frozen=True, eq=False)
class DeadZone(Descent[NoMemory]):
    """Gradient adaptation of the estimate (k,) of k parameters with a dead zone for the sliding variable s (Peterson
    and Narendra 1982).

        estimate' = -Gamma Y' s outside the ellipsoid sum (s_i / width_i)^2 <= 1, and 0 within

    s (r,), of r joints, is in rad/s (m/s for a prismatic joint), Y (r, k) is the torque regressor; `gain` is Gamma,
    (k,) its diagonal or (k, k), in units of the parameters squared per J. `width` is the zone's half-width in rad/s
    (m/s), one number for all joints, 0.05 by default, or (r,). A prime is the transpose, but on estimate and V a
    derivative in time. Raises `InputError` for a gain that is not finite, symmetric and positive definite and a width
    that is not positive and finite, and, with a controller, for a gain or width that does not fit its model's k
    parameters or r joints.

    Guarantees: within the zone the estimate stands still, so nothing that keeps s there makes it drift. Outside, V =
    s'Ms/2 + error' Gamma^-1 error/2 has V' = -s'Ks + s'd, error the estimate less the truth, M the mass matrix, K the
    control law's damping, d (r,) the disturbance torque: not positive where the zone holds {s: s'Ks <= d'K^-1d}.
    `DeadZone.against` makes that zone.

    Gives up: tracking better than the zone; and a bound on the estimate where s enters and leaves the zone infinitely
    often: as M varies with the positions, s may leave with a larger s'Ms/2 than it came in with. `Projection` of this
    law has that bound.
    """

    tunable = ("gain", "width")

    width: Array = 0.05  # type: ignore[assignment]  # a number becomes an array for the model's joints

    def __post_init__(self) -> None:
        super().__post_init__()
        positive_numbers(self.width, "dead zone: width")

    @classmethod
    def against(cls, gain: ArrayLike, damping: ArrayLike, torque: ArrayLike) -> DeadZone:
        """Dead-zone adaptation law, a `DeadZone`, for disturbance torques d of at most `torque` under a control law of
        `damping` K: the zone is {s: s'Ks <= d'K^-1 d} for sliding variables s (r,). A prime is the transpose.

        `torque`, in N m (N for a prismatic joint), and `damping`, in N m s/rad (N s/m), are one number for all joints
        or (r,), one a joint. The number r of joints is taken from them: where both are one number, the zone is that of
        an arm of one joint, which models of other arms refuse. `gain` is the adaptation gain Gamma of k parameters,
        (k,) its diagonal or (k, k), in units of the parameters squared per J. Raises `InputError` for a damping that is
        not positive, torques and dampings of different sizes, a gain that is not symmetric and positive definite, and
        torques that are negative, all zero or not finite.
        """
        joints = max(np.size(torque), np.size(damping))
        d, K = per_joint(torque, joints, "dead zone: torque"), positive_per_joint(damping, joints, "damping")
        if np.any(d < 0.0):
            raise InputError(f"dead zone: torque: expected numbers of at least 0, got {d.tolist()}")
        return cls(np.asarray(gain), np.sqrt((d**2 / K).sum() / K))

    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """Raise `InputError` unless the adaptation gain is for the `model`'s k parameters, and the half-width of the
        dead zone is one positive number or one for each of its r joints. `initial`, the initial estimate (k,), and
        `period`, the control period in s, are not used."""
        super().require(model, initial, period)
        positive_per_joint(self.width, model.mechanism.dof, "dead zone: width")

    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> NoMemory:
        """The empty internal state, a `NoMemory`, of an adaptation law that keeps nothing besides the estimate. All
        arguments are ignored: the `model`, the initial estimate `initial` (k,) of its k parameters, positions q (...,
        n) of the spanning tree's n joints in rad (m for a prismatic joint), velocities v (..., r) of the r primary
        (independent) joints in rad/s (m/s), leading axes for arms, and the control `period` in s."""
        return NoMemory()

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """The estimate (k,) of the `model`'s k parameters after a control period, and the empty internal state. Within
        the dead zone the estimate is unchanged; outside, it has taken the step -Gamma Y' times the integral of s over
        the period (trapezium rule).

        Gamma is the adaptation gain, Y' the transpose of the torque regressor Y (r, k) at the period's start, s (r,)
        the sliding variable of r joints, rad/s (m/s if prismatic). The zone is one ellipsoid for all joints together:
        sum (m_i/width_i)^2 <= 1, m (r,) the mean of s at the period's start and end, and the law's attribute `width`
        the zone's half-widths, rad/s (m/s).

        `estimate` (k,), in the parameters' SI units, and the internal state `memory` are those before the control
        period that `period` describes. Nothing is checked here.
        """
        scaled = Column(1.0 / width for width in each(self.width, model.mechanism.dof)) * period.mean
        outside = where(scaled @ scaled > 1.0, 1.0, 0.0)
        return estimate - self.applied(period.gradient(outside * period.integral)), memory
