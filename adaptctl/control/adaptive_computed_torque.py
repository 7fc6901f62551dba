"""Computed torque that learns its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_per_joint
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.control.adaptive import AdaptiveController, AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains.gains import typical_inertia
from adaptctl.control.gains.sampling_ratio import DEFINITE, MAX_SAMPLING_RATIO, worst_conditioned_configuration
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import GainError, InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column


@dataclass(frozen=True, eq=False)
class AdaptiveComputedTorque(AdaptiveController):
    """Adaptive computed-torque control law for r joints on a model's k parameters (Craig, Hsu and Sastry 1987).

        e = p - p_d,  s = e' + Lambda e
        torque = M^(p) (a_d - 2 Lambda e' - Lambda^2 e) + C^(p, v) v + g^(p)
        estimate' = -Gamma Y(p, v, a)' M^^-1 W s

    p, v and a (r,) are positions, velocities and accelerations in rad, rad/s and rad/s^2 (m, m/s and m/s^2), p_d and
    a_d the reference's, e is the tracking error and s, in rad/s (m/s for a prismatic joint), the sliding variable; M^,
    C^ and g^ are the estimate's mass matrix, Coriolis matrix and gravity torque, Y (r, k) is the torque regressor,
    `error` (k,) the estimate less the truth. A prime is a derivative in time, but the transpose of Y and, in V below,
    of s and error.

    With both poles of the error loop at -Lambda, s' + Lambda s = M^^-1 Y error, the strictly positive real filter of
    the paper. Guarantees, without disturbance and while M^ is positive definite: V = s'Ws/2 + error' Gamma^-1 error/2
    has the time derivative -s'W Lambda s, so the tracking error goes to zero.

    Gives up: it needs the acceleration a, which is taken from the difference of velocities over the period and so
    carries the noise of velocities over T_c: noise of deviation sigma moves an inertia by about Gamma sigma^2 a period,
    where `SlotineLi`'s regressor moves it by T_c Lambda of that, so Gamma must be as much smaller (a filtered a, which
    is delayed, did worse). It also needs M^^-1, so M^ must stay positive definite. For the initial estimate this is
    checked; later `Natural` guarantees it, `Projection` on narrow bounds makes it likely, and nothing else does. The
    paper resets parameters at their bounds, which is `Projection`.

    `model` has the k parameters; `bandwidth` is Lambda, the decay rate of errors in 1/s, one number or (r,); `initial`
    (k,) is the initial estimate in SI units, None for zero, whose mass matrix is not positive definite and which is
    refused; `adaptation` is an adaptation law, or Gamma for `Gradient`, its diagonal (k,) or whole (k, k), in units of
    the parameters squared per J, or None, the default, for no adaptation; `weight` is W, one number or (r,), in kg m^2
    (kg), None for the joints' typical inertias, the medians of the mass matrix's diagonal, which makes gains comparable
    to `SlotineLi`'s; `period` is the control period T_c in s, 1 ms by default; nothing is learned from a period whose
    torque is beyond `torque_limits`, one number or (r,), N m (N), None for the mechanism's own. Raises `GainError`
    where 2 Lambda T_c is above 1.5, and `InputError` on wrong shapes, on a period, bandwidths, weights or limits that
    are not positive, on an adaptation law that does not fit the model, and for an initial estimate whose mass matrix is
    not positive definite at some configuration that a local search from the worst of 200 finds.
    """

    tunable = ("bandwidth", "prediction_weight", "initial")

    model: ReducedModel
    bandwidth: Array
    initial: Array | None
    adaptation: AdaptationLaw[Any] | Array | None = None
    prediction_weight: Array | None = None
    control_period: float = 1e-3
    torque_limits: ArrayLike | None = None

    def __post_init__(self) -> None:
        self._validate_model()
        object.__setattr__(self, "bandwidth", positive_per_joint(self.bandwidth, self.dof, "bandwidth"))
        weight = typical_inertia(self.model.mechanism) if self.prediction_weight is None else self.prediction_weight
        object.__setattr__(self, "prediction_weight", positive_per_joint(weight, self.dof, "prediction_weight"))
        self._settle()
        self._validate_bandwidth()
        self._validate_inertia()

    def law(
        self, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> tuple[Column, AdaptiveState]:
        """The torque (r,) of r joints, N m (N for a prismatic joint), for one control period, and the internal state
        after learning from the period that has passed. Positions p in rad (m) and velocities v in rad/s (m/s), (r,),
        are measured; `reference` has the desired positions, velocities and accelerations (r,), in rad, rad/s and
        rad/s^2 (m, m/s and m/s^2 if prismatic); `memory` is the internal state of the last control period. Nothing is
        checked here."""
        equations, bandwidth = self.model.mechanism.equations, column(self.bandwidth)
        q = equations.closed(p, memory.q)
        e, e_rate = p - reference.p, v - reference.v
        s = e_rate + bandwidth * e

        def gradient(sliding: Column) -> Column:
            before: Column = memory.regressor_state
            acceleration = (1.0 / self.control_period) * (v - before)
            inertia = equations.mass_matrix(memory.q, self._parameters(memory.estimate))
            weighted = solve_symmetric(inertia, column(self.prediction_weight) * sliding)
            return equations.motion(memory.q, before, before, acceleration).regressor_transpose_product(
                weighted, self.model.columns
            )

        damping = column(self.prediction_weight) * bandwidth
        passed = Period(gradient, memory.s, s, memory.torque, q, v, self.control_period, memory.dt[0], damping)
        estimate, learning = self._learned(memory, passed)
        a = reference.a - bandwidth * (e_rate + s)
        torque = equations.inverse_dynamics(q, v, v, a, self._parameters(estimate))
        return torque, AdaptiveState(estimate, q, v, s, *self._held(torque), learning, NoMemory())

    @property
    def _motion_size(self) -> int:
        """Number of remembered velocities, r: accelerations are known at the next tick only."""
        return self.dof

    def _validate_bandwidth(self) -> None:
        """Raise `GainError` where a hold would overshoot: it multiplies velocity errors by 1 - 2 Lambda T_c."""
        gain = 2.0 * self.control_period * float(self.bandwidth.max())
        if gain > MAX_SAMPLING_RATIO:
            raise GainError(
                f"bandwidth: 2 Lambda T_c = {gain:.3g}, at most {MAX_SAMPLING_RATIO} is allowed: use at most "
                f"{MAX_SAMPLING_RATIO / (2.0 * self.control_period):g} 1/s for a control period of "
                f"{self.control_period:g} s"
            )

    def _validate_inertia(self) -> None:
        """Raise `InputError` where the initial estimate's mass matrix is not positive definite."""
        smallest, p = worst_conditioned_configuration(self.model.mechanism, self.model.embed(np.asarray(self.initial)))
        if not smallest > DEFINITE:
            raise InputError(
                "adaptive computed torque: needs a first estimate whose mass matrix is positive definite everywhere, "
                f"this one's, its diagonal scaled to 1, has the eigenvalue {smallest:.3g} at "
                f"p = {np.round(p, 3).tolist()}: start from a rough model of the arm, or use SlotineLi, which can "
                "start from zero"
            )
