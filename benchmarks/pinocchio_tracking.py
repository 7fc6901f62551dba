"""Slotine and Li's law and the arm under it as one writes them with NumPy and Pinocchio, as fast as that goes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio

from adaptctl.arrays import Array
from adaptctl.control.gains.sampling_ratio import MAX_SAMPLING_RATIO

CAP = 2.0
"""Least ratio of the energy that damping takes out to that of a step of the estimate that may let V rise: `Gradient`'s
own."""


def slotine_li_regressor(
    model: pinocchio.Model, data: pinocchio.Data, p: Array, v: Array, v_r: Array, a_r: Array
) -> Array:
    """Y_r (r, 10N) of M a_r + C v_r + g: three torque regressors Y(p, v, a), since C(p, v) w is bilinear in v and w."""

    def Y(v: Array, a: Array) -> Array:
        return pinocchio.computeJointTorqueRegressor(model, data, p, v, a).copy()

    rest = np.zeros_like(v)
    return Y(0.5 * (v + v_r), a_r) - Y(0.5 * (v - v_r), rest) + Y(rest, rest)


class PinocchioTracker:
    """`adaptctl.SlotineLi` with the gradient law, for a tree.

    It is fast because a model without weight saves the third regressor, because parameters that are not learned have
    a gain of zero instead of being picked out, and because no memory is asked for that is there already.
    """

    def __init__(
        self,
        model: pinocchio.Model,
        columns: Sequence[int],
        bandwidth: float,
        damping: Array,
        gain: Array,
        period: float,
    ) -> None:
        self.model, self.weightless = model, model.copy()
        self.weightless.gravity = pinocchio.Motion.Zero()
        self.data, self.weightless_data = model.createData(), self.weightless.createData()
        self.bandwidth, self.damping, self.rest = bandwidth, damping, np.zeros(model.nv)
        self.rate = np.zeros(10 * model.nv)
        self.rate[list(columns)] = period * gain
        self.estimate = np.zeros(10 * model.nv)
        self.Y, self.s = np.zeros((model.nv, 10 * model.nv)), np.zeros(model.nv)

    def step(self, p: Array, v: Array, p_d: Array, v_d: Array, a_d: Array) -> Array:
        """One tick: learn from the period that has passed, as `Gradient` does, then the torque (r,)."""
        v_r = v_d - self.bandwidth * (p - p_d)
        a_r = a_d - self.bandwidth * (v - v_d)
        s = v - v_r
        braking = self.damping * s
        if (power := s @ braking) > 0.0:
            slope = s @ self.Y
            step = self.rate * slope
            square, change = slope @ step, s - self.s
            taken = (2.0 * s - change / MAX_SAMPLING_RATIO) @ (self.damping * change)
            share = 1.0 if square <= 2.0 * power - max(taken, 0.0) else power / (power + CAP * square)
            self.estimate -= share * step
        self.s = s
        half, difference = 0.5 * (v + v_r), 0.5 * s
        Y = pinocchio.computeJointTorqueRegressor(self.model, self.data, p, half, a_r)
        C = pinocchio.computeJointTorqueRegressor(self.weightless, self.weightless_data, p, difference, self.rest)
        np.subtract(Y, C, out=self.Y)
        return self.Y @ self.estimate - braking


class PinocchioArm:
    """A tree under torques, each held for `period` s: one step of Runge and Kutta's method."""

    def __init__(self, model: pinocchio.Model, period: float) -> None:
        self.model, self.data, self.period = model, model.createData(), period

    def step(self, p: Array, v: Array, torque: Array) -> tuple[Array, Array]:
        """Positions and velocities (r,) a period later."""
        model, data, h = self.model, self.data, self.period
        half = 0.5 * h
        # Results are Pinocchio's own memory, written over by the next call: copies.
        a1 = pinocchio.aba(model, data, p, v, torque).copy()
        v2 = v + half * a1
        a2 = pinocchio.aba(model, data, p + half * v, v2, torque).copy()
        v3 = v + half * a2
        a3 = pinocchio.aba(model, data, p + half * v2, v3, torque).copy()
        v4 = v + h * a3
        a4 = pinocchio.aba(model, data, p + h * v3, v4, torque)
        return p + h / 6.0 * (v + 2.0 * (v2 + v3) + v4), v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
