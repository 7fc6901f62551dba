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
    """The memory of integral action: the error's integral (r,) and the last error (r,)."""

    integral: Any
    """(r,) of the error so far, rad s"""
    error: Any
    """(r,) at the last tick"""


@dataclass(frozen=True, eq=False)
class PassivityIntegral(SlotineLi):
    """Slotine and Li's law with integral action (Slotine and Li 1991, section 9.2; the passivity of the family: Ortega
    and Spong 1989).

        e = p - p_d,  v_r = v_d - 2 Lambda e - Lambda^2 (integral of e),  s = v - v_r
        torque = Y_r(p, v, v_r, a_r) estimate - K s

    The integral is taken by the trapezium, exact to T_c^2.

    Guarantees: what `SlotineLi` does, V with this s; on s = 0 the error has both poles at -Lambda. A constant
    disturbance leaves a constant s and, at rest and without adaptation, no position error: friction and an unknown
    payload at rest are such.

    Gives up: more than that under disturbance. In motion, and while adapting, a constant load leaves an error: s that
    is not zero is integrated by the estimate, which drifts (a leak or `Projection` bounds it). The integral overshoots,
    and winds up while torques are limited. It stands still in a period whose `elapsed` is set to zero, as adaptation
    does.

    Arguments, their defaults and errors are those of `SlotineLi`: a model, `bandwidth` Lambda in 1/s, `damping` K in
    N m s/rad (N s/m for a prismatic joint), and so on; the period must carry twice the bandwidth.
    """

    tunable = SlotineLi.tunable

    def reference_velocity(
        self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> ReferenceVelocity:
        """The reference velocity v_r = v_d - 2 Lambda e - Lambda^2 (integral of e) (r,) in rad/s (m/s), its derivative
        a_r (r,) in rad/s^2 (m/s^2), and the integral's memory; at measured positions p in rad (m) and velocities v in
        rad/s (m/s), (r,), with the last tick's `memory`. The configuration q (n,) is not used."""
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
