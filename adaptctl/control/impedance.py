"""Adaptive impedance of joints."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_number, positive_per_joint, whole_number
from adaptctl.control.adaptation.guarded_learning import GuardedLearning
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.energy_tank import EnergyTank, full, opened, trusting
from adaptctl.control.gains.sampling_ratio import (
    MAX_SAMPLING_RATIO,
    SamplingRatio,
    sampling_ratio,
    validate_sampling_ratio,
)
from adaptctl.control.gains.stiffness import MAX_DELAY, largest_stiffness
from adaptctl.control.gains.workspace import Workspace, Worst
from adaptctl.control.passivity_based import Instant, PassivityBased, ReferenceVelocity
from adaptctl.description.drive import DISSIPATIVE
from adaptctl.errors import GainError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column

FRICTION = tuple(f".{kind.value}" for kind in DISSIPATIVE)


@dataclass(frozen=True, eq=False)
class JointImpedance(PassivityBased):
    r"""
    Adaptive controller under which joints feel like springs and dampers.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    stiffness : array_like
        Stiffness K in N m/rad (N/m for a prismatic joint), one number or (r,).
    damping : array_like
        Damping D in N m s/rad (N s/m), one number or (r,).
    adaptation : AdaptationLaw or array_like, optional
        Adaptation law, or the gain of `Gradient`: its diagonal (k,) or the whole matrix (k, k), in units of the
        parameters squared per J. None switches adaptation off.
    initial : array_like, optional
        Initial estimate (k,) in SI units, zero unless given.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    workspace : Workspace, optional
        Joint positions for which the damping is checked. Unless given, all that the joints' limits allow.
    torque_limits : array_like, optional
        Limits in N m (N), one number or (r,). Nothing is learned from a period whose torque exceeds them; the
        mechanism's own limits unless given.
    tank : float, optional
        Energy in J that moving references, rising stiffness and wrong learning may give to the surroundings. Default:
        no limit.
    delay : int, default 0
        Control periods between a measurement and its torque.

    Raises
    ------
    GainError
        If the stiffness is above what the period carries, or the sampling ratio of the damping is above 1.5.
    InputError
        If a shape is wrong, a gain, limit, period or tank is not positive, or the adaptation law does not fit.

    Notes
    -----
    With the true parameters an external torque :math:`\tau_e` moves the error :math:`e=p-p_d` by

    .. math:: M\ddot e+(C+D)\dot e+Ke=\tau_e,\quad\tau=Y(p,v,v_d,\dot v_d)\hat\beta-Ke-D\dot e.

    No force is measured, since the inertia stays the arm's own. :math:`V=\tfrac12\dot e'M\dot e+\tfrac12e'Ke+
    \tfrac12\tilde\beta'\Gamma^{-1}\tilde\beta` falls by :math:`\dot e'D\dot e` [1]_: at a resting reference the arm is
    passive while it learns. With a tank [2]_ a moving one is too: what held torques did beyond the gravity and
    friction of an estimate that is trusted is taken from it. When it is empty, the stiffness falls, and the weight
    that is held is the trusted one: the initial one, and what was learned while nothing was doubted for 3 s.

    References
    ----------
    .. [1] Slotine and Li, Int. J. Robotics Research, 1987.
    .. [2] Ferraguti, Secchi and Fantuzzi, IEEE Int. Conf. Robotics and Automation, 2013.

    Examples
    --------
    >>> soft = adaptctl.control.JointImpedance(model, stiffness=40.0, damping=[6.0, 2.0], adaptation=np.full(6, 0.1))
    >>> torque, state = soft.step(soft.init(p, v), p, v, reference(0.0))
    >>> torque.shape
    (2,)
    """

    tunable: ClassVar[tuple[str, ...]] = ("stiffness", "damping", "initial")

    model: ReducedModel
    stiffness: Array
    damping: Array
    adaptation: AdaptationLaw[Any] | Array | None = None
    initial: Array | None = None
    control_period: float = 1e-3
    workspace: Workspace | None = None
    torque_limits: ArrayLike | None = None
    tank: float | None = None
    delay: int = 0

    def __post_init__(self) -> None:
        self._validate_model()
        for name in ("stiffness", "damping"):
            object.__setattr__(self, name, positive_per_joint(getattr(self, name), self.dof, name))
        if self.tank is not None:
            positive_number(self.tank, "tank: expected a positive energy in J")
        whole_number(self.delay, "delay", 0, MAX_DELAY)
        if isinstance(self.adaptation, GuardedLearning):
            object.__setattr__(self, "adaptation", replace(self.adaptation, trial=False))
        self._settle()
        self._check_gains()

    def reference_velocity(
        self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> ReferenceVelocity:
        """
        Return the desired velocity.

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
            Desired velocity (r,) in rad/s (m/s), its derivative in time (r,), and the law's further internal state.
        """
        if self.tank is None:
            return ReferenceVelocity(reference.v, reference.a, NoMemory())
        energy = self._spring(q, p, reference.p)[1]
        after = opened(memory.controller_state, p, memory.torque, energy, self.tank)
        return ReferenceVelocity(after.opening[0] * reference.v, after.opening[0] * reference.a, after)

    def _feedback(self, at: Instant, memory: AdaptiveState) -> tuple[Column, Any]:
        spring, damper = self._spring(at.q, at.p, at.reference.p)[0], self._damper(at.q, at.s)
        if self.tank is None:
            return spring + damper, NoMemory()
        after: EnergyTank = trusting(
            at.wanted.controller_state, memory.estimate, getattr(memory.law_state, "watch", None), self.control_period
        )
        opening, trusted = after.opening[0], self._parameters(after.trusted)
        after = after._replace(weight=self._weight(at, trusted))
        if self.adaptation_law is None:
            return opening * spring + damper, after
        unpaid = (1.0 - opening) * self._weight(at, at.parameters - trusted)
        return opening * spring + damper + unpaid, after

    def _spring(self, q: Column, p: Column, goal: Column) -> tuple[Column, Scalar]:
        """Torque (r,) and energy of the springs towards positions (r,)."""
        torque = column(self.stiffness) * (p - goal)
        return torque, 0.5 * ((p - goal) @ torque)

    def _damper(self, q: Column, s: Column) -> Column:
        """Torque (r,) of the dampers."""
        return column(self.damping) * s

    def _weight(self, at: Instant, parameters: Column) -> Column:
        """Torque (r,) of gravity and friction of parameters (P,)."""
        equations, none = self.model.mechanism.equations, Column.zeros(self.dof)
        moving = equations.motion(at.q, none, at.wanted.v_r, none)
        if equations.has_constraint_bias:
            return moving.torque(parameters)
        # Apart, they need no recursion over velocities: without inertias, what moves is friction alone.
        names = self.model.mechanism.parameter_names
        rubs = zip(names, parameters, strict=True)
        friction = moving.torque(Column(x if name.endswith(FRICTION) else 0.0 for name, x in rubs))
        return equations.motion(at.q, none, none, none).torque(parameters) + friction

    def _controller_state(self, p: Array, v: Array) -> Any:
        if self.tank is None:
            return NoMemory()
        return full(float(self.tank), p, v, np.asarray(self.initial))

    def _check_gains(self) -> None:
        """Raise `GainError` for a damping or stiffness that the period does not carry."""
        mechanism, T = self.model.mechanism, self.control_period
        if self.delay:
            ratio = sampling_ratio(mechanism, self.damping, T, workspace=self.workspace)
            validate_damping(mechanism.name, ratio, T, self.delay)
        else:
            validate_sampling_ratio(mechanism, self.damping, T, 0.0, self.workspace)
        names = [f"joint {joint.name}" for joint in mechanism.primary_joints]
        validate_stiffness(mechanism.name, names, self.stiffness, self.damping, T, self.delay)


def validate_damping(arm: str, found: Worst | SamplingRatio, control_period: float, delay: int) -> None:
    """Raise `GainError` if a sampling ratio is above 1.5, or what a delay leaves of it."""
    most = MAX_SAMPLING_RATIO * math.sin(math.pi / (4 * delay + 2))
    if found.value <= most:
        return
    raise GainError(
        f"{arm}: damping is too stiff for a control period of {control_period:g} s and a delay of {delay}: its "
        f"sampling ratio is {found.value:.3g} at p = {np.round(found.p, 3).tolist()}, above the limit of {most:.3g}; "
        f"use at most {most / found.value:.3g} times this damping or period; `workspace` restricts the check to the "
        "reference"
    )


def validate_stiffness(
    arm: str, names: list[str], stiffness: Array, damping: Array, control_period: float, delay: int
) -> None:
    """Raise `GainError` for a stiffness above the largest that the period carries."""
    largest = largest_stiffness(damping, control_period, delay)
    if not (beyond := stiffness > largest).any():
        return
    i = int(beyond.argmax())
    late = f" and a delay of {delay}" if delay else ""
    raise GainError(
        f"{arm}: stiffness of {names[i]}: {stiffness[i]:g} is above {largest[i]:.4g}, the largest that a damping of "
        f"{damping[i]:g} carries at a control period of {control_period:g} s{late}; use at most that, more damping or "
        "a shorter period"
    )
