"""Slotine and Li's adaptive controller on fundamental parameters."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, positive_per_joint
from adaptctl.control.adaptation.gradient import Descent
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.control.adaptation.prior_ranges import estimate_sampling_ratio
from adaptctl.control.adaptive import AdaptiveController, AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains.sampling_ratio import sampling_ratio, validate_sampling_ratio
from adaptctl.control.gains.workspace import Workspace
from adaptctl.errors import StabilityWarning
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column


class ReferenceVelocity(NamedTuple):
    """Reference velocity of Slotine and Li's law for r joints. `v_r` (r,), rad/s (m/s if prismatic), is the velocity
    from which the sliding variable s = v - v_r of the measured velocities v is taken; `a_r` (r,), rad/s^2 (m/s^2), is
    its derivative in time; and `more` is the internal state, a named tuple of columns, from which the law makes both in
    the next control period, empty where it needs none. Nothing is checked."""

    v_r: Column
    a_r: Column
    controller_state: Any


@dataclass(frozen=True, eq=False)
class SlotineLi(AdaptiveController):
    """Slotine and Li's passivity-based adaptive control (1987), on as many parameters as the model has.

        e = p - p_d,  v_r = v_d - Lambda e,  a_r = v_r',  s = v - v_r
        torque = Y_r(p, v, v_r, a_r) estimate - K s
        estimate' = -Gamma Y_r' s, or another adaptation law's

    p and v (r,) are measured positions and velocities of r joints, p_d and v_d desired ones; Y_r (r, k) is the torque
    regressor, M the mass matrix, C that of Coriolis torques, and error the estimate minus the true parameters. A prime
    is a derivative in time, but the transpose of Y_r and, in V below, of s and error.

    Theorem: M s' + C s + K s = Y_r error, so that in continuous time V = s'Ms/2 + error' Gamma^-1 error/2 has the time
    derivative -s'Ks, and the tracking error goes to zero. Drives' friction f is modelled at v_r: with it V falls by
    s'(f(v) - f(v_r)) >= 0 besides, for any friction that rises with velocity. Modelled at v, an estimate above the
    truth would be positive feedback. The estimates converge too only under persistent excitation, and nothing keeps
    them physically consistent, unless the adaptation law does. The proof asks of v_r only that a_r be its derivative
    (Ortega and Spong 1989): `PassivityIntegral` and `TaskSpaceSlotineLi` are this law with another v_r.

    `model` has the k parameters; `bandwidth` is Lambda (1/s) and `damping` K in N m s/rad (N s/m for a prismatic
    joint), each one number or one a joint (r,); `adaptation` is an adaptation law, or Gamma for `Gradient`, its
    diagonal (k,) or whole (k, k), in units of the parameters squared per J, or None to switch adaptation off; `initial`
    (k,) is the initial estimate in SI units, None for zero; `period` is the control period T_c in s, 1 ms by default;
    `workspace` is the set of joint positions for which the gains are checked, None for all that the joints' limits
    allow; nothing is learned from a period whose torque is beyond `torque_limits`, one number or (r,), N m (N), None
    for the mechanism's own; `prior` (k,), in SI units, is how far each parameter may be from its initial estimate: with
    it, a `StabilityWarning` is given where the sampling ratio of the gains plus `estimate_sampling_ratio` is 2 or more,
    so that estimates on their way could make the loop ring; None, the default, checks nothing of this.

    Raises `GainError` where the gains are too large for the period: the sampling ratio T_c lambda_max(M^-1 K + Lambda),
    lambda_max the largest eigenvalue, is above 1.5, or M not positive definite, at a position that a local search over
    `workspace` finds; `InputError` on wrong shapes, on gains, limits or a period that are not positive, and on an
    adaptation law that does not fit the model.
    """

    tunable: ClassVar[tuple[str, ...]] = ("bandwidth", "damping", "initial")

    model: ReducedModel
    bandwidth: Array
    damping: Array
    adaptation: AdaptationLaw[Any] | Array | None = None
    initial: Array | None = None
    control_period: float = 1e-3
    workspace: Workspace | None = None
    torque_limits: ArrayLike | None = None
    prior: ArrayLike | None = None

    def __post_init__(self) -> None:
        self._validate_model()
        object.__setattr__(self, "bandwidth", positive_per_joint(self.bandwidth, self._coordinates, "bandwidth"))
        object.__setattr__(self, "damping", positive_per_joint(self.damping, self.dof, "damping"))
        self._settle()
        self._check_sample_time()
        if self.prior is not None:
            self._warn_of_estimates(frozen_array(self.prior, (len(self.model.columns),), "prior"))

    def law(
        self, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> tuple[Column, AdaptiveState]:
        """The torque (r,) of r joints, N m (N for a prismatic joint), for one control period, and the internal state
        after learning from the period that has passed. Positions p in rad (m) and velocities v in rad/s (m/s), (r,),
        are measured; `reference` has the desired positions, velocities and accelerations (r,), in rad, rad/s and
        rad/s^2 (m, m/s and m/s^2 if prismatic); `memory` is the internal state of the last control period, at first
        that of the method `start`. Nothing is checked here: the method `step` checks shapes."""
        equations, damping = self.model.mechanism.equations, column(self.damping)
        q = equations.closed(p, memory.q)
        v_r, a_r, more = self.reference_velocity(q, p, v, reference, memory)
        s = v - v_r

        def gradient(sliding: Column) -> Column:  # Y_r's, of the regressor at the last tick
            before = equations.motion_memory.numbers(memory.regressor_state)
            return equations.remembered(before).regressor_transpose_product(sliding, self.model.columns)

        passed = Period(gradient, memory.s, s, memory.torque, q, v, self.control_period, memory.dt[0], damping)
        estimate, learning = self._learned(memory, passed)
        motion = equations.motion(q, v, v_r, a_r)
        torque = motion.torque(self._parameters(estimate)) - damping * s
        kept = equations.motion_memory.chosen(motion.numbers) if self._motion_size else Column(())
        return torque, AdaptiveState(estimate, q, kept, s, *self._held(torque), learning, more)

    def reference_velocity(
        self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> ReferenceVelocity:
        """The reference velocity v_r = v_d - Lambda e (r,) of r joints, in rad/s (m/s if prismatic), its derivative in
        time a_r (r,) in rad/s^2 (m/s^2), and an empty internal state, as a `ReferenceVelocity`. e = p - p_d is the
        tracking error and Lambda the bandwidth (1/s). p in rad (m) and v in rad/s (m/s), (r,), are the measured
        positions and velocities; `reference` has the desired p_d, v_d and their derivative a_d (r,). The positions q
        (n,), rad (m), of all n joints of the spanning tree and `memory`, the internal state of the last control period,
        are for subclasses that need them. Nothing is checked here."""
        bandwidth = column(self.bandwidth)
        e, e_rate = p - reference.p, v - reference.v
        return ReferenceVelocity(reference.v - bandwidth * e, reference.a - bandwidth * e_rate, NoMemory())

    def _check_sample_time(self) -> None:
        """Raise `GainError` where the period cannot carry the gains."""
        validate_sampling_ratio(
            self.model.mechanism, self.damping, self.control_period, self._velocity_feedback, self.workspace
        )

    def _warn_of_estimates(self, prior: Array) -> None:
        """Warn (`StabilityWarning`) where an estimate within the prior and V can make the sampling ratio 2."""
        if not isinstance(self.adaptation_law, Descent):
            return
        fed_back = self._velocity_feedback
        held = sampling_ratio(
            self.model.mechanism, self.damping, self.control_period, fed_back, workspace=self.workspace
        ).value
        own = estimate_sampling_ratio(
            self.model, self.adaptation_law.gain, prior, fed_back, self.control_period, self.workspace
        )
        if held + own >= 2.0:
            warnings.warn(
                f"{self.model.mechanism.name}: the sampling ratio of the gains is {held:.3g}, and estimates within the "
                f"prior may add {own:.3g} on their way: below 2 none of them rings for certain. A smaller adaptation "
                "gain (`adaptation_gain` with the gains), bandwidth, period or prior lowers it",
                StabilityWarning,
                stacklevel=4,
            )

    @property
    def _velocity_feedback(self) -> Array:
        """Gain (r,) in 1/s by which a_r feeds back the joints' velocities."""
        return self.bandwidth

    @property
    def _motion_size(self) -> int:
        return 0 if self.adaptation_law is None else len(self.model.mechanism.equations.motion_memory.kept)

    @property
    def _coordinates(self) -> int:
        """Number of coordinates whose errors decay at the bandwidth: the joints."""
        return self.dof


class Integral(NamedTuple):
    """Internal state of integral action on r joints: `integral` (r,), the integral in time of the tracking error
    (measured less desired positions) so far, rad s (m s if prismatic), and `error` (r,), that error in the last control
    period, rad (m). Nothing is checked."""

    integral: Any
    error: Any


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
        before: Integral = memory.controller_state
        e, e_rate = p - reference.p, v - reference.v
        integral = before.integral + (0.5 * memory.dt[0]) * (before.error + e)
        v_r = reference.v - twice * e - square * integral
        return ReferenceVelocity(v_r, reference.a - twice * e_rate - square * e, Integral(integral, e))

    @property
    def _velocity_feedback(self) -> Array:
        return 2.0 * self.bandwidth

    def _more(self, p: Array, v: Array) -> Integral:
        return Integral(np.zeros(self.dof), np.zeros(self.dof))
