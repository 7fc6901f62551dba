"""Adaptive impedance of joints."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, positive_number, positive_per_joint, stacked, whole_number
from adaptctl.control.adaptation.guarded_learning import GuardedLearning
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.energy_tank import EnergyTank, full, opened, trusting
from adaptctl.control.gains.force_feedback import DrivenLoop, FeltForce, validate_inertia
from adaptctl.control.gains.sampling_ratio import (
    MAX_SAMPLING_RATIO,
    SamplingRatio,
    sampling_ratio,
    validate_sampling_ratio,
)
from adaptctl.control.gains.stiffness import MAX_DELAY, largest_stiffness
from adaptctl.control.gains.workspace import Workspace, Worst, workspace_of
from adaptctl.control.passivity_based import Instant, PassivityBased, ReferenceVelocity
from adaptctl.control.pytree import either
from adaptctl.control.target_motion import TargetMotion, at_rest
from adaptctl.description.drive import DISSIPATIVE
from adaptctl.errors import GainError, InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column, maximum, minimum, where

FRICTION = tuple(f".{kind.value}" for kind in DISSIPATIVE)
POSTURES = 8
"""number of the workspace's samples at which a target inertia is checked"""


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
    inertia : array_like, optional
        Target inertia M_d in kg m^2 (kg), one number, (r,) or a matrix (r, r). Default: the arm's own.
    force_cutoff : float, optional
        Corner frequency in rad/s of a filter of measured external torques, which then drive the target inertia: put
        them in the state's `controller_state.felt`, as `HeldState.feeling` does. Default: the observer of `adaptation`.
    surroundings : float, default 1e3
        Stiffness in N m/rad (N/m) of what the arm may touch, up to which a target inertia is checked.

    Raises
    ------
    GainError
        If the stiffness is above what the period carries, the sampling ratio of the damping is above 1.5, or the arm
        would swing with the target inertia between springs.
    InputError
        If a shape is wrong, a gain, limit, period or tank is not positive, the adaptation law does not fit, or a target
        inertia has a tank or nothing that drives it.

    Notes
    -----
    With the true parameters an external torque :math:`\tau_e` moves the error :math:`e=p-p_d` by

    .. math:: M\ddot e+(C+D)\dot e+Ke=\tau_e,\quad\tau=Y(p,v,v_d,\dot v_d)\hat\beta-Ke-D\dot e.

    No force is measured then, since the inertia stays the arm's own. :math:`V=\tfrac12\dot e'M\dot e+\tfrac12e'Ke+
    \tfrac12\tilde\beta'\Gamma^{-1}\tilde\beta` falls by :math:`\dot e'D\dot e` [1]_: at a resting reference the arm is
    passive while it learns. With a tank [2]_ a moving one is too: what held torques did beyond the gravity and
    friction of an estimate that is trusted is taken from it. When it is empty, the stiffness falls, and the weight
    that is held is the trusted one: the initial one, and what was learned while nothing was doubted for 3 s.

    With a target inertia [3]_ a felt torque :math:`\hat\tau_e` moves a reference velocity, from which
    :math:`s=v-v_r` of the learning law is counted:

    .. math:: M_d(\dot v_r-\dot v_d)=\hat\tau_e-D\dot e-Ke,\quad\tau=Y(p,v,v_r,\dot v_r)\hat\beta-Ds-\hat\tau_e.

    References
    ----------
    .. [1] Slotine and Li, Int. J. Robotics Research, 1987.
    .. [2] Ferraguti, Secchi and Fantuzzi, IEEE Int. Conf. Robotics and Automation, 2013.
    .. [3] Lu and Meng, IEEE Trans. Systems, Man, and Cybernetics, 1991.

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
    inertia: ArrayLike | None = field(default=None, kw_only=True)
    force_cutoff: float | None = field(default=None, kw_only=True)
    surroundings: float = field(default=1e3, kw_only=True)

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
        self._settle_inertia()
        self._check_gains()
        if self.inertia is not None:
            self._check_inertia()

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
        if self.inertia is not None:
            return self._driven(q, p, v, reference, memory)
        if self.tank is None:
            return ReferenceVelocity(reference.v, reference.a, NoMemory())
        energy = self._spring(q, p, reference.p)[1]
        after = opened(memory.controller_state, p, memory.torque, energy, self.tank)
        return ReferenceVelocity(after.opening[0] * reference.v, after.opening[0] * reference.a, after)

    def _feedback(self, at: Instant, memory: AdaptiveState) -> tuple[Column, Any]:
        damper = self._damper(at.q, at.s)
        if self.inertia is not None:
            return damper + at.wanted.controller_state.force, at.wanted.controller_state
        spring = self._spring(at.q, at.p, at.reference.p)[0]
        if self.tank is None:
            return spring + damper, NoMemory()
        after: EnergyTank = trusting(
            at.wanted.controller_state, memory.estimate, getattr(memory.law_state, "watch", None), self.control_period
        )
        opening, trusted = after.opening[0], self._parameters(after.trusted)
        after = after._replace(weight=self._free(at, trusted))
        if self.adaptation_law is None:
            return opening * spring + damper, after
        unpaid = (1.0 - opening) * self._weight(at, at.wanted.v_r, at.parameters - trusted)
        return opening * spring + damper + unpaid, after

    def _driven(
        self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> ReferenceVelocity:
        """Velocity of the target inertia, which begins at the arm's after a period from which nothing is learned."""
        before: TargetMotion = memory.controller_state
        force, rate = self._force(memory), v - reference.v
        push = force - self._spring(q, p, reference.p)[0] - self._damper(q, rate)
        a_r = reference.a + self._accelerated(q, v, rate, push)
        v_r = either(memory.dt[0] > 0.0, before.velocity, v)
        return ReferenceVelocity(v_r, a_r, TargetMotion(v_r + self.control_period * a_r, before.felt, force))

    def _force(self, memory: AdaptiveState) -> Column:
        """External torque (r,), measured or estimated."""
        if self.force_cutoff is None:
            return memory.law_state.touch.torque
        keep, before = math.exp(-self.force_cutoff * self.control_period), memory.controller_state
        return keep * before.force + (1.0 - keep) * before.felt

    def _accelerated(self, q: Column, v: Column, rate: Column, push: Column) -> Column:
        """Acceleration (r,) of the target inertia under a torque (r,), where the error moves at a rate (r,)."""
        return Column(column(row) @ push for row in np.linalg.inv(np.asarray(self.inertia)))

    def _spring(self, q: Column, p: Column, goal: Column) -> tuple[Column, Scalar]:
        """Torque (r,) and energy of the springs towards positions (r,)."""
        torque = column(self.stiffness) * (p - goal)
        return torque, 0.5 * ((p - goal) @ torque)

    def _damper(self, q: Column, s: Column) -> Column:
        """Torque (r,) of the dampers."""
        return column(self.damping) * s

    def _free(self, at: Instant, parameters: Column) -> Column:
        """Torque (r,) of parameters (P,) whose work is free: of friction, what the arm's own speed has at most."""
        wanted, there = (self._weight(at, v, parameters) for v in (at.wanted.v_r, at.v))
        pairs = zip(at.v, wanted, there, strict=True)
        return Column(where(v > 0.0, minimum(x, y), maximum(x, y)) for v, x, y in pairs)

    def _weight(self, at: Instant, v: Column, parameters: Column) -> Column:
        """Torque (r,) of gravity and friction at velocities (r,) of parameters (P,)."""
        equations, none = self.model.mechanism.equations, Column.zeros(self.dof)
        moving = equations.motion(at.q, none, v, none)
        if equations.has_constraint_bias:
            return moving.torque(parameters)
        # Apart, they need no recursion over velocities: without inertias, what moves is friction alone.
        names = self.model.mechanism.parameter_names
        rubs = zip(names, parameters, strict=True)
        friction = moving.torque(Column(x if name.endswith(FRICTION) else 0.0 for name, x in rubs))
        return equations.motion(at.q, none, none, none).torque(parameters) + friction

    def _controller_state(self, p: Array, v: Array) -> Any:
        if self.inertia is not None:
            return at_rest(v)
        if self.tank is None:
            return NoMemory()
        return full(float(self.tank), p, v, np.asarray(self.initial))

    def _settle_inertia(self) -> None:
        """Check and freeze what belongs to a target inertia."""
        positive_number(self.surroundings, "surroundings: expected a positive stiffness in N m/rad (N/m)")
        if self.inertia is None:
            if self.force_cutoff is not None:
                raise InputError("force_cutoff: has no effect without a target inertia")
            return
        object.__setattr__(self, "inertia", self._settled_inertia(self.inertia))
        if self.tank is not None:
            raise InputError("tank: it counts what an impedance of the arm's own inertia gives: leave out one of both")
        if self.force_cutoff is not None:
            positive_number(self.force_cutoff, "force_cutoff: expected a positive frequency in rad/s")
        elif getattr(self.adaptation_law, "external_torque", None) is None:
            raise InputError(
                "inertia: nothing tells the external torque: expected an adaptation of with_external_torque(...), or "
                "force_cutoff for a measured one"
            )

    def _settled_inertia(self, given: ArrayLike) -> Array:
        return _positive_definite(given, self.dof)

    def _check_inertia(self) -> None:
        """Raise `GainError` for a target inertia that the period does not carry."""
        mechanism, observer = self.model.mechanism, getattr(self.adaptation_law, "external_torque", None)
        samples = workspace_of(mechanism, self.workspace).samples
        q = column(samples[:: max(1, len(samples) // POSTURES)])
        own = FeltForce(self.force_cutoff, 1, self.delay) if self.force_cutoff else None
        units, none = [column(unit) for unit in np.eye(self.dof)], Column.zeros(self.dof)

        def matrices(columns: list[Column]) -> Array:
            return np.stack([stacked(list(one), np.shape(q[0])) for one in columns], axis=-1)

        loop = DrivenLoop(
            mechanism.mass_matrix(np.stack(list(q), axis=-1)),
            np.asarray(np.linalg.inv(matrices([self._accelerated(q, none, none, unit) for unit in units])), float),
            matrices([self._damper(q, unit) for unit in units]),
            matrices([self._linear_spring(q, unit) for unit in units]),
            [matrices([self._touched(q, unit, along) for unit in units]) for along in self._surrounded],
            self.control_period,
            own or FeltForce(observer.cutoff, 2, self.delay),  # type: ignore[union-attr]
        )
        validate_inertia(mechanism.name, loop, self.surroundings)

    def _linear_spring(self, q: Column, way: Column) -> Column:
        """Torque (r,) of the springs after a short way (r,)."""
        return column(self.stiffness) * way

    @property
    def _surrounded(self) -> Array:
        """Stiffnesses of surroundings: along all axes, and along each."""
        return np.concatenate((np.ones((1, self.dof)), np.eye(self.dof)))

    def _touched(self, q: Column, way: Column, along: Array) -> Column:
        """Torque (r,) of surroundings after a short way (r,)."""
        return column(along) * way

    def _check_gains(self) -> None:
        """Raise `GainError` for a damping or stiffness that the period does not carry."""
        mechanism, T = self.model.mechanism, self.control_period
        if self.delay:
            ratio = sampling_ratio(mechanism, self.damping, T, workspace=self.workspace)
            validate_damping(mechanism.name, ratio, T, self.delay)
        else:
            validate_sampling_ratio(mechanism, self.damping, T, workspace=self.workspace)
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


def _positive_definite(given: ArrayLike, r: int) -> Array:
    """Target inertia (r, r)."""
    values = np.asarray(given)
    if values.ndim < 2:
        return frozen_array(np.diag(positive_per_joint(given, r, "inertia")), (r, r), "inertia")
    matrix = frozen_array(values, (r, r), "inertia")
    if not np.allclose(matrix, matrix.T) or np.linalg.eigvalsh(matrix).min() <= 0.0:
        raise InputError(f"inertia: expected a positive definite matrix, got {matrix.tolist()}")
    return matrix
