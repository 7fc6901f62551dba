"""Slotine and Li's law with integral action."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.slotine_li import ReferenceVelocity, SlotineLi
from adaptctl.scalars import Column, column


class Integral(NamedTuple):
    """Internal state of integral action on r joints: `integral` (r,), the integral in time of the tracking error
    (measured less desired positions) so far, rad s (m s if prismatic), and `error` (r,), that error in the last control
    period, rad (m). Nothing is checked."""

    integral: Any
    """(r,) of the error so far, rad s"""
    error: Any
    """(r,) in the last control period"""


@dataclass(frozen=True, eq=False)
class PassivityIntegral(SlotineLi):
    """Slotine and Li's law with integral action (Slotine and Li 1991, section 9.2; the passivity of the family: Ortega
    and Spong 1989).

        e = p - p_d,  v_r = v_d - 2 Lambda e - Lambda^2 (integral of e),  s = v - v_r
        torque = Y_r(p, v, v_r, a_r) estimate - K s

    p and v (r,) are measured positions and velocities of r joints, p_d and v_d the reference's, e is the tracking error
    and s, in rad/s (m/s), the sliding variable; a_r = v_r', and Y_r (r, k) is the torque regressor. A prime is a
    derivative in time, but in V below the transpose. The integral is taken by the trapezium rule, with an error of the
    order of T_c^2.

    Guarantees: what `SlotineLi` does, V = s'Ms/2 + error' Gamma^-1 error/2 with the derivative V' = -s'Ks, with this s,
    M the mass matrix and error the estimate less the true parameters; on s = 0 the tracking error has both poles at
    -Lambda. A constant disturbance leaves a constant s and, at rest and without adaptation, no position error: friction
    and an unknown payload at rest are such.

    Gives up: convergence under other disturbances. In motion, and while adapting, a constant load leaves an error: s
    that is not zero is integrated by the estimate, which drifts (a leak or `Projection` bounds it). The integral
    overshoots, and winds up where torques are limited after the controller. Like adaptation, it stands still in a
    period whose torque is beyond `torque_limits` or whose `elapsed`, the time in the internal state, is set to zero.

    Arguments and defaults are those of `SlotineLi`: `model`, with its k parameters, `bandwidth` Lambda in 1/s and
    `damping` K in N m s/rad (N s/m for a prismatic joint), one number or (r,); `adaptation`, a law, or Gamma (k,) or
    (k, k) in units of the parameters squared per J, or None, the default, for none; `initial` (k,), SI units, None for
    zero; `period` T_c, 1e-3 s; `workspace`, the set of joint positions for which the gains are checked, None for all
    that the joints' limits allow; `torque_limits`, one number or (r,), N m (N), beyond which nothing is learned, None
    for the mechanism's; `prior` (k,), SI units, the greatest errors of `initial`, for a `StabilityWarning` where
    estimates could ring, None for none. Raises `GainError` where T_c lambda_max(M^-1 (K + 2 M Lambda)), lambda_max the
    largest eigenvalue, is above 1.5, and `InputError` on wrong shapes, for gains, limits or a period that are not
    positive, and for an adaptation law that does not fit the model.
    """

    tunable = SlotineLi.tunable

    def reference_velocity(
        self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> ReferenceVelocity:
        """The reference velocity v_r = v_d - 2 Lambda e - Lambda^2 (integral of e) (r,) of r joints, in rad/s (m/s if
        prismatic), its derivative in time a_r (r,) in rad/s^2 (m/s^2), and the state of the integral action. That is
        the integral (r,) in rad s (m s) and the last e (r,).

        e = p - p_d is the tracking error and Lambda the bandwidth (1/s); `reference` has the desired p_d, v_d and a_d
        (r,). p in rad (m) and v in rad/s (m/s), (r,), are measured, `memory` is the internal state of the last control
        period. The positions q (n,) of all n joints of the spanning tree are not used. Nothing is checked here.
        """
        bandwidth = column(self.bandwidth)
        twice, square = 2.0 * bandwidth, bandwidth * bandwidth
        before: Integral = memory.more
        e, e_rate = p - reference.p, v - reference.v
        integral = before.integral + (0.5 * memory.elapsed[0]) * (before.error + e)
        v_r = reference.v - twice * e - square * integral
        return ReferenceVelocity(v_r, reference.a - twice * e_rate - square * e, Integral(integral, e))

    @property
    def _velocity_feedback(self) -> Array:
        return 2.0 * self.bandwidth

    def _more(self, p: Array, v: Array) -> Integral:
        return Integral(np.zeros(self.dof), np.zeros(self.dof))
