"""Integration methods and their step sizes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol, TypeAlias

import numpy as np

from adaptctl.control.gains.sampling_ratio import damping_matrix
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation.effects import JointEffect
from adaptctl.simulation.transmission import Transmission

Acceleration: TypeAlias = Callable[[Column, Column], Column]
"""From q (n,) and v (r,) to accelerations (r,)."""

Rates: TypeAlias = Callable[[Column, Column], Column]
"""From q (n,) and v (r,) to q' (n,)."""


def own(q: Column, v: Column) -> Column:
    """Rates of a tree's positions, its velocities (n,)."""
    return v


class Integrator(Protocol):
    """
    Protocol of one-step methods for q' = rates(q, v), v' = acceleration(q, v).

    Parameters
    ----------
    *args, **kwargs : object
        Settings of an implementation.

    Notes
    -----
    An implementation has `stages`, its accelerations per step, and `implicit`, True if `acceleration` uses the friction
    of the step's end.

    Examples
    --------
    >>> method = adaptctl.simulation.RungeKutta4()
    >>> method.stages, method.implicit
    (4, False)
    """

    stages: ClassVar[int]
    implicit: ClassVar[bool]

    def step(
        self, acceleration: Acceleration, q: Column, v: Column, dt: float, rates: Rates = own
    ) -> tuple[Column, Column]:
        """
        Advance positions and velocities by one step, without checks.

        Parameters
        ----------
        acceleration : callable
            Accelerations (r,) at (q, v) in rad/s^2 (m/s^2 if prismatic); for an implicit method their mean over the
            step.
        q : Column
            Positions (n,) of the spanning tree's joints, rad (m).
        v : Column
            Velocities (r,) of the primary joints, rad/s (m/s).
        dt : float
            Step in s.
        rates : callable, optional
            Time derivatives (n,) of q at (q, v). Default: v, as for a tree.

        Returns
        -------
        tuple of Column
            Positions (n,) in rad (m) and velocities (r,) in rad/s (m/s) after the step.
        """
        ...


def validate_integrator(given: object) -> None:
    """Raise `InputError` unless `given` is an integrator."""
    if isinstance(given, type) or not (hasattr(given, "step") and hasattr(given, "implicit")):
        raise InputError(f"integrator: expected an Integrator, such as RungeKutta4(), got {given!r:.80}")


@dataclass(frozen=True)
class RungeKutta4:
    """
    Classical Runge-Kutta method of order 4.

    Notes
    -----
    Explicit, with four accelerations per step [1]_.

    References
    ----------
    .. [1] W. Kutta, "Beitrag zur näherungsweisen Integration totaler Differentialgleichungen", Zeitschrift für
       Mathematik und Physik 46, 1901.

    Examples
    --------
    >>> adaptctl.simulation.RungeKutta4().stages
    4
    """

    stages: ClassVar[int] = 4
    implicit: ClassVar[bool] = False

    def step(
        self, acceleration: Acceleration, q: Column, v: Column, dt: float, rates: Rates = own
    ) -> tuple[Column, Column]:
        """
        Advance positions and velocities by one step, without checks.

        Parameters
        ----------
        acceleration : callable
            Accelerations (r,) at (q, v) in rad/s^2 (m/s^2 if prismatic).
        q : Column
            Positions (n,) of the spanning tree's joints, rad (m).
        v : Column
            Velocities (r,) of the primary joints, rad/s (m/s).
        dt : float
            Step in s.
        rates : callable, optional
            Time derivatives (n,) of q at (q, v). Default: v, as for a tree.

        Returns
        -------
        tuple of Column
            Positions (n,) in rad (m) and velocities (r,) in rad/s (m/s) after the step.
        """
        half = 0.5 * dt
        u1, a1 = rates(q, v), acceleration(q, v)
        q2, v2 = q + half * u1, v + half * a1
        u2, a2 = rates(q2, v2), acceleration(q2, v2)
        q3, v3 = q + half * u2, v + half * a2
        u3, a3 = rates(q3, v3), acceleration(q3, v3)
        q4, v4 = q + dt * u3, v + dt * a3
        u4, a4 = rates(q4, v4), acceleration(q4, v4)
        sixth, third = dt / 6.0, dt / 3.0
        return q + sixth * (u1 + u4) + third * (u2 + u3), v + sixth * (a1 + a4) + third * (a2 + a3)


@dataclass(frozen=True)
class SemiImplicitEuler:
    """
    Symplectic (semi-implicit) Euler method of order 1.

    Notes
    -----
    One acceleration per step; the new velocities move the positions. The energy error stays bounded if accelerations
    depend on positions alone [1]_.

    References
    ----------
    .. [1] E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration, 2006, section I.1.

    Examples
    --------
    >>> adaptctl.Plant(arm, 0.001, integrator=adaptctl.simulation.SemiImplicitEuler()).integrator
    SemiImplicitEuler()
    """

    stages: ClassVar[int] = 1
    implicit: ClassVar[bool] = False

    def step(
        self, acceleration: Acceleration, q: Column, v: Column, dt: float, rates: Rates = own
    ) -> tuple[Column, Column]:
        """
        Advance positions and velocities by one step, without checks.

        Parameters
        ----------
        acceleration : callable
            Accelerations (r,) at (q, v) in rad/s^2 (m/s^2 if prismatic).
        q : Column
            Positions (n,) of the spanning tree's joints, rad (m).
        v : Column
            Velocities (r,) of the primary joints, rad/s (m/s).
        dt : float
            Step in s.
        rates : callable, optional
            Time derivatives (n,) of q at (q, new v). Default: the new v, as for a tree.

        Returns
        -------
        tuple of Column
            Positions (n,) in rad (m) and velocities (r,) in rad/s (m/s) after the step.
        """
        after = v + dt * acceleration(q, v)
        return q + dt * rates(q, after), after


@dataclass(frozen=True)
class LinearlyImplicitEuler:
    r"""
    Linearly implicit Euler method of order 1, for stiff friction.

    Notes
    -----
    .. math:: (M + \Delta t\,B)(v_1 - v) = \Delta t\,(\tau - C v - g - B v), \quad p_1 = p + \Delta t\,(v + v_1)/2

    with M, C and g half a step ahead, at p + dt v/2. B v is friction by the secant of its curve at the velocity that
    such a step with the secant at v would end at [1]_. Friction alone never reverses a velocity. Of
    accelerations that depend on positions alone the order is 2.

    References
    ----------
    .. [1] E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 1996, section IV.7.

    Examples
    --------
    >>> adaptctl.simulation.LinearlyImplicitEuler().implicit
    True
    """

    stages: ClassVar[int] = 1
    implicit: ClassVar[bool] = True

    def step(
        self, acceleration: Acceleration, q: Column, v: Column, dt: float, rates: Rates = own
    ) -> tuple[Column, Column]:
        """
        Advance positions and velocities by one step, without checks.

        Parameters
        ----------
        acceleration : callable
            Mean accelerations (r,) over the step from v, at the positions of its middle and with the friction of its
            end, in rad/s^2 (m/s^2 if prismatic).
        q : Column
            Positions (n,) of the spanning tree's joints, rad (m).
        v : Column
            Velocities (r,) of the primary joints, rad/s (m/s).
        dt : float
            Step in s.
        rates : callable, optional
            Time derivatives (n,) of q at the velocities of both ends. Default: these, as for a tree.

        Returns
        -------
        tuple of Column
            Positions (n,) in rad (m) and velocities (r,) in rad/s (m/s) after the step.
        """
        half = 0.5 * dt
        middle = q + half * rates(q, v)
        after = v + dt * acceleration(middle, v)
        return middle + half * rates(middle, after), after


MAX_RATE_STEP = 2.5
"""rate times step; RK4 is stable up to 2.78"""
MAX_EXPLICIT_SUBSTEPS = 8
"""RK4 steps per control period"""
MIN_IMPLICIT_SUBSTEPS = 4
"""within 0.03 mrad of 40 RK4 steps on a PUMA that friction of 60 N m stops"""


MAX_FREQUENCY_STEP = 1.0
"""frequency times step; RK4 then loses 0.7 % amplitude per radian"""
MAX_SPRING_SUBSTEPS = 2000
"""steps per control period"""


def friction_rate(mechanism: Mechanism, effects: Sequence[JointEffect] = ()) -> float:
    """Fastest decay rate (1/s) of a velocity by friction in 200 random configurations."""
    extra = sum((np.diag(effect.max_slope(mechanism.dof)) for effect in effects), np.zeros((mechanism.dof,) * 2))
    description = mechanism.description
    if description.num_energy_parameters == len(description.parameter_names) and not np.any(extra):
        return 0.0
    if np.isinf(extra).any():
        return math.inf
    p = sampled_configurations(mechanism)
    damping = extra + damping_matrix(mechanism, p, mechanism.inertial_parameters)
    try:
        return float(np.abs(np.linalg.eigvals(np.linalg.solve(mechanism.mass_matrix(p), damping))).max())
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"{mechanism.name}: the mass matrix is singular: every joint that moves "
            "independently needs a link or a rotor with inertia"
        ) from error


class Integration(NamedTuple):
    """Integration method, and number of equal steps in a control period."""

    substeps: int
    integrator: Integrator


def integration(
    mechanism: Mechanism,
    effects: Sequence[JointEffect],
    control_period: float,
    integrator: Integrator | None = None,
    transmission: Transmission | None = None,
) -> Integration:
    """
    Return an integration method and step that are stable with given friction and elastic joints.

    Parameters
    ----------
    mechanism : Mechanism
        Robot with r joints.
    effects : sequence of JointEffect
        Friction besides that of the drives.
    control_period : float
        Control period in s.
    integrator : Integrator, optional
        Method asked for. Default: `RungeKutta4` where 8 steps are enough for friction, else `LinearlyImplicitEuler`.
    transmission : Transmission, optional
        Springs of elastic joints. Default: rigid joints.

    Returns
    -------
    Integration
        Method and number of steps.

    Raises
    ------
    InputError
        If the mass matrix is singular, effects do not fit, loops reach no configuration, or springs need more than 2000
        steps.

    Examples
    --------
    >>> from adaptctl.simulation.integrator import integration
    >>> integration(arm, [], period).substeps
    1
    """
    if integrator is not None:
        validate_integrator(integrator)
    waves, decay = 0.0, 0.0
    if transmission is not None:
        waves, decay = transmission.rates(mechanism, sampled_configurations(mechanism))
    friction = friction_rate(mechanism, effects)
    resolved = _few(math.ceil(waves * control_period / MAX_FREQUENCY_STEP), mechanism)
    too_stiff = integrator is None and friction * control_period / MAX_RATE_STEP > MAX_EXPLICIT_SUBSTEPS
    if too_stiff or (integrator is not None and integrator.implicit):
        return Integration(max(MIN_IMPLICIT_SUBSTEPS, resolved), integrator or LinearlyImplicitEuler())
    validate_explicit(mechanism, effects, None, control_period, 1)
    stable = math.ceil((friction + decay) * control_period / MAX_RATE_STEP)
    return Integration(max(1, resolved, stable), integrator or RungeKutta4())


def validate_explicit(
    mechanism: Mechanism,
    effects: Sequence[JointEffect],
    transmission: Transmission | None,
    control_period: float,
    substeps: int,
) -> None:
    """Raise `InputError` if joints stick, or if explicit steps are too few for elastic joints."""
    if any(np.isinf(effect.max_slope(mechanism.dof)).any() for effect in effects):
        raise InputError(
            "plant: joints that stick, as by LuGre, or friction with a load need integrator=LinearlyImplicitEuler()"
        )
    if transmission is None:
        return
    waves, decay = transmission.rates(mechanism, sampled_configurations(mechanism))
    needed = _few(math.ceil(control_period * max(waves, decay) / MAX_RATE_STEP), mechanism)
    if substeps < needed:
        raise InputError(
            f"elastic joints: {substeps} substeps per {control_period:g} s are too few for springs with oscillations "
            f"of {waves:.3g} rad/s and decay rates of {decay:.3g} 1/s with the inertias of {mechanism.name}: use at "
            f"least {needed}"
        )


def _few(steps: int, mechanism: Mechanism) -> int:
    if steps <= MAX_SPRING_SUBSTEPS:
        return steps
    raise InputError(
        f"elastic joints: these springs and dampers, with the inertias of {mechanism.name}, would need {steps} "
        f"steps per control period, but the limit is {MAX_SPRING_SUBSTEPS}: use softer springs, or rigid "
        "joints"
    )
