"""Slotine and Li's adaptive controllers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, positive_per_joint
from adaptctl.control.adaptation.gradient import Descent
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory
from adaptctl.control.adaptation.prior_ranges import estimate_sampling_ratio
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains.sampling_ratio import sampling_ratio, validate_sampling_ratio
from adaptctl.control.gains.workspace import Workspace
from adaptctl.control.passivity_based import PassivityBased, ReferenceVelocity
from adaptctl.errors import StabilityWarning, warn
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column


@dataclass(frozen=True, eq=False)
class SlotineLi(PassivityBased):
    r"""
    Passivity-based adaptive controller of Slotine and Li.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    bandwidth : array_like
        Decay rate Lambda of the tracking error in 1/s, one number or (r,).
    damping : array_like
        Damping K in N m s/rad (N s/m for a prismatic joint), one number or (r,).
    adaptation : AdaptationLaw or array_like, optional
        Adaptation law, or the gain of `Gradient`: its diagonal (k,) or the whole matrix (k, k), in units of the
        parameters squared per J. None switches adaptation off.
    initial : array_like, optional
        Initial estimate (k,) in SI units, zero unless given.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    workspace : Workspace, optional
        Joint positions for which the gains are checked. Unless given, all that the joints' limits allow.
    torque_limits : array_like, optional
        Limits in N m (N), one number or (r,). Nothing is learned from a period whose torque exceeds them; the
        mechanism's own limits unless given.
    prior : array_like, optional
        Largest plausible error (k,) of each initial parameter in SI units. With it, gains for which the estimates could
        make the sampled loop ring give a `StabilityWarning`.

    Raises
    ------
    GainError
        If the sampling ratio of the gains is above 1.5 or the mass matrix not positive definite in the workspace.
    InputError
        If a shape is wrong, a gain, limit or period is not positive, or the adaptation law does not fit the model.

    Notes
    -----
    .. math::

        s=v-v_r=\dot e+\Lambda e,\quad \tau=Y(p,v,v_r,\dot v_r)\hat\beta-Ks,\quad \dot{\hat\beta}=-\Gamma Y^\top s.

    Without disturbance the tracking error converges to zero [1]_, estimates only under persistent excitation.

    References
    ----------
    .. [1] Slotine and Li, Int. J. Robotics Research, 1987.

    Examples
    --------
    >>> controller = adaptctl.SlotineLi(model, bandwidth=5.0, damping=[6.0, 2.0], adaptation=np.full(6, 0.1))
    >>> state = controller.init(p, v)
    >>> torque, state = controller.step(state, p, v, reference(0.0))
    >>> torque.shape, state.estimate.shape
    ((2,), (6,))
    """

    tunable: ClassVar[tuple[str, ...]] = ("bandwidth", "damping", "initial")
    unread: ClassVar[tuple[str, ...]] = ("workspace", "prior")

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
            self._warn_if_ringing(frozen_array(self.prior, (len(self.model.columns),), "prior"))

    def reference_velocity(
        self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> ReferenceVelocity:
        """
        Compute the desired velocity minus bandwidth times error.

        Parameters
        ----------
        q : Column
            Positions (n,) in rad (m) of the n joints of the spanning tree.
        p, v : Column
            Measured positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations (r,) in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
        memory : AdaptiveState
            Internal state of the last control period.

        Returns
        -------
        ReferenceVelocity
            Reference velocity (r,) in rad/s (m/s), its derivative in time (r,), and the law's further internal state.
        """
        bandwidth = column(self.bandwidth)
        e, e_rate = p - reference.p, v - reference.v
        return ReferenceVelocity(reference.v - bandwidth * e, reference.a - bandwidth * e_rate, NoMemory())

    def _check_sample_time(self) -> None:
        validate_sampling_ratio(
            self.model.mechanism, self.damping, self.control_period, self._velocity_feedback, self.workspace
        )

    def _warn_if_ringing(self, prior: Array) -> None:
        """Warn if an estimate within the prior can ring."""
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
            warn(
                f"{self.model.mechanism.name}: the sampling ratio of the gains is {held:.3g}, and estimates within the "
                f"prior may add {own:.3g}: stability is only guaranteed below 2. Reduce the adaptation "
                "gain (`adaptation_gain` with the gains), bandwidth, period or prior",
                StabilityWarning,
            )

    @property
    def _velocity_feedback(self) -> Array:
        """Gain (r,), 1/s, of velocities in the reference acceleration."""
        return self.bandwidth

    @property
    def _coordinates(self) -> int:
        return self.dof


class Integral(NamedTuple):
    """Integral (r,) of the error, rad s (m s), and the last error."""

    integral: Any
    error: Any


@dataclass(frozen=True, eq=False)
class PassivityIntegral(SlotineLi):
    r"""
    Slotine and Li's controller with integral action.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    bandwidth : array_like
        Decay rate Lambda of the tracking error in 1/s, one number or (r,).
    damping : array_like
        Damping K in N m s/rad (N s/m for a prismatic joint), one number or (r,).
    adaptation : AdaptationLaw or array_like, optional
        Adaptation law, or the gain of `Gradient`: its diagonal (k,) or the whole matrix (k, k), in units of the
        parameters squared per J. None switches adaptation off.
    initial : array_like, optional
        Initial estimate (k,) in SI units, zero unless given.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    workspace : Workspace, optional
        Joint positions for which the gains are checked. Unless given, all that the joints' limits allow.
    torque_limits : array_like, optional
        Limits in N m (N), one number or (r,). Nothing is learned from a period whose torque exceeds them; the
        mechanism's own limits unless given.
    prior : array_like, optional
        Largest plausible error (k,) of each initial parameter in SI units. With it, gains for which the estimates could
        make the sampled loop ring give a `StabilityWarning`.

    Raises
    ------
    GainError
        If the sampling ratio with feedback of 2 Lambda is above 1.5 or the mass matrix not positive definite.
    InputError
        If a shape is wrong, a gain, limit or period is not positive, or the adaptation law does not fit the model.

    Notes
    -----
    .. math:: v_r=v_d-2\Lambda e-\Lambda^2\int e\,dt,\quad s=v-v_r.

    At rest, without adaptation, a constant disturbance leaves no position error [1]_.

    References
    ----------
    .. [1] Slotine and Li, Applied Nonlinear Control, 1991, section 9.2.

    Examples
    --------
    >>> controller = adaptctl.control.PassivityIntegral(model, bandwidth=5.0, damping=[6.0, 2.0])
    >>> controller.init(p, v).controller_state.integral
    array([0., 0.])
    """

    tunable = SlotineLi.tunable

    def reference_velocity(
        self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> ReferenceVelocity:
        """
        Compute the reference velocity with the error's integral.

        Parameters
        ----------
        q : Column
            Positions (n,) in rad (m) of the n joints of the spanning tree.
        p, v : Column
            Measured positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations (r,) in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
        memory : AdaptiveState
            Internal state of the last control period.

        Returns
        -------
        ReferenceVelocity
            Reference velocity (r,) in rad/s (m/s), its derivative in time (r,), and the law's further internal state.
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

    def _controller_state(self, p: Array, v: Array) -> Integral:
        return Integral(np.zeros(self.dof), np.zeros(self.dof))
