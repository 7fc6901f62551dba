"""One step in time of p'' = a(p, p') over scalars of any kind, and how many steps friction and springs need."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol, TypeAlias

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.drive import COULOMB_SMOOTHING_SPEED
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation.effects import JointEffect
from adaptctl.simulation.transmission import Transmission

Acceleration: TypeAlias = Callable[[Column, Column], Column]
"""Configurations (n,) and velocities (r,) to accelerations (r,)."""

Rates: TypeAlias = Callable[[Column, Column], Column]
"""Configurations (n,) and velocities (r,) to how the configuration moves (n,)."""


def own(q: Column, v: Column) -> Column:
    """The time derivatives (n,), rad/s (m/s if prismatic), of the positions of a tree's n joints: its velocities v
    (n,), the same column (vector), whatever the positions q (n,), rad (m). It is the default `rates` of an integrator's
    step. Nothing is checked."""
    return v


class Integrator(Protocol):
    """Protocol of a one-step integration method for second-order equations of motion q' = rates(q, v), v' =
    acceleration(q, v), of a configuration q (n,), rad (m if prismatic), and velocities v (r,), rad/s (m/s). A prime is
    a time derivative.

    An implementation gives `stages`, `implicit` and `step(acceleration, q, v, dt, rates)`, which returns q and v `dt`
    seconds later. `stages` is the number of accelerations that it evaluates in a step; `implicit` is True if
    `acceleration` is to return accelerations with the friction of the step's end, not of its beginning. `rates` is for
    mechanisms with loops, whose configuration has all n joints of the spanning tree, more than the r primary
    (independent) ones.
    """

    stages: ClassVar[int]
    implicit: ClassVar[bool]

    def step(
        self, acceleration: Acceleration, q: Column, v: Column, dt: float, rates: Rates = own
    ) -> tuple[Column, Column]:
        """Configuration q (n,) of all n joints, rad (m if prismatic), and velocities v (r,) of the r primary
        (independent) ones, rad/s (m/s), `dt` seconds after the q and v given, as new columns.

        `acceleration` gives the time derivative (r,) of v, rad/s^2 (m/s^2), at (q, v), or for an implicit method its
        mean over the step, and `rates` gives that of q (n,), rad/s (m/s), there: by default v itself, as for a tree,
        where all joints are primary. Vectors are Columns of scalars of any kind (floats, arrays, or symbols to be
        compiled). No number is checked: NaN goes through; columns of unlike lengths raise `ValueError`.
        """
        ...


def validate_integrator(given: object) -> None:
    """Raise `InputError` unless `given` is an `Integrator`, an object with the members `step` and `implicit` such as
    `RungeKutta4()`. A class given for an object is refused."""
    if isinstance(given, type) or not (hasattr(given, "step") and hasattr(given, "implicit")):
        raise InputError(f"integrator: expected an Integrator, such as RungeKutta4(), got {given!r:.80}")


@dataclass(frozen=True)
class RungeKutta4:
    """The classical Runge-Kutta method of order 4 (Kutta 1901), an `Integrator` of equations of motion: explicit, with
    four evaluations of the acceleration (`stages`) a step. Friction is that at each stage's velocities: not
    `implicit`."""

    stages: ClassVar[int] = 4
    implicit: ClassVar[bool] = False

    def step(
        self, acceleration: Acceleration, q: Column, v: Column, dt: float, rates: Rates = own
    ) -> tuple[Column, Column]:
        """Configuration q (n,) of all n joints, rad (m if prismatic), and velocities v (r,) of the r primary
        (independent) ones, rad/s (m/s), `dt` seconds after the q and v given, with an error in this step of order dt^5.

        `acceleration` gives the time derivative (r,) of v, rad/s^2 (m/s^2), at (q, v), and `rates` gives that of q
        (n,), rad/s (m/s), there: by default v itself, as for a tree, where all joints are primary. Vectors are Columns
        of scalars of any kind (floats, arrays, or symbols to be compiled). No number is checked: NaN goes through;
        columns of unlike lengths raise `ValueError`.
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
    """The symplectic (semi-implicit) Euler method of order 1, an `Integrator` of equations of motion: one evaluation of
    the acceleration (`stages`) a step, positions moved by the new velocities.

    Where the acceleration depends on positions alone, its energy error stays bounded; with the velocity terms of an arm
    it does so only approximately (Hairer, Lubich and Wanner 2006, section I.1). Friction is that of the step's
    beginning: not `implicit`.
    """

    stages: ClassVar[int] = 1
    implicit: ClassVar[bool] = False

    def step(
        self, acceleration: Acceleration, q: Column, v: Column, dt: float, rates: Rates = own
    ) -> tuple[Column, Column]:
        """Configuration q (n,) of all n joints, rad (m if prismatic), and velocities v (r,) of the r primary
        (independent) ones, rad/s (m/s), `dt` seconds after the q and v given, with an error in this step of order dt^2.

        `acceleration` gives the time derivative (r,) of v, rad/s^2 (m/s^2), at (q, v), and `rates` gives that of q
        (n,), rad/s (m/s), at (q, the new velocities): by default those velocities themselves, as for a tree, where all
        joints are primary. Vectors are Columns of scalars of any kind (floats, arrays, or symbols to be compiled). No
        number is checked: NaN goes through; columns of unlike lengths raise `ValueError`.
        """
        after = v + dt * acceleration(q, v)
        return q + dt * rates(q, after), after


@dataclass(frozen=True)
class LinearlyImplicitEuler:
    """The linearly implicit Euler method of order 1, an `Integrator` with the friction of the step's end, linearised:
    stable however stiff friction is.

        (M + dt B) (v_1 - v) = dt (torque - C v - g - B v),  p_1 = p + dt (v + v_1)/2

    A step of `dt` s takes positions p, rad (m if prismatic), and velocities v, rad/s (m/s), of r joints to p_1 and v_1,
    (r,) each. M (r, r) is the mass matrix in kg m^2 (kg); torque, the velocity torques C v and gravity's g are in N m
    (N), and B v is the friction at v, B (r,) in N m s/rad (N s/m): Coulomb friction by the secant of its curve from
    rest to v, so that at steady speed it has the value of the curve. One acceleration (`stages`) a step, `implicit` in
    friction alone. With torque and gravity held, friction alone never reverses a velocity (a Rosenbrock method of one
    stage: Hairer and Wanner 1996, section IV.7).
    """

    stages: ClassVar[int] = 1
    implicit: ClassVar[bool] = True

    def step(
        self, acceleration: Acceleration, q: Column, v: Column, dt: float, rates: Rates = own
    ) -> tuple[Column, Column]:
        """Configuration q (n,) of all n joints, rad (m if prismatic), and velocities v_1 (r,) of the r primary
        (independent) ones, rad/s (m/s), `dt` seconds after the q and v given, with an error in this step of order dt^2.

        `acceleration` gives (v_1 - v)/dt (r,), rad/s^2 (m/s^2), at (q, v), friction of the step's end included; `rates`
        gives the time derivative of q (n,), rad/s (m/s), at (q, (v + v_1)/2): by default that velocity itself, as for a
        tree, where all joints are primary. Vectors are Columns of scalars of any kind (floats, arrays, or symbols to be
        compiled). No number is checked: NaN goes through; columns of unlike lengths raise `ValueError`.
        """
        after = v + dt * acceleration(q, v)
        return q + dt * rates(q, 0.5 * (v + after)), after


STABLE = 2.5
"""Of rate times step: Runge and Kutta's method is stable up to 2.78 on the real axis."""
MOST = 8
"""steps of Runge and Kutta's method in a control period"""
IMPLICIT = 4
"""at least so many steps of the linearly implicit one: within 0.4 mrad of 144 to 556 of the other on arms with stiff
friction"""


RESOLVED = 1.0
"""Of a spring's frequency times step: Runge and Kutta's method loses 0.7 % of an oscillation's amplitude a radian."""
MOST_FOR_SPRINGS = 2000
"""steps in a control period"""


def friction_rate(mechanism: Mechanism, effects: Sequence[JointEffect] = ()) -> float:
    """The fastest decay rate of a velocity by friction, 1/s, 0 without friction: the largest magnitude of an eigenvalue
    of M^-1 B at any of 200 random configurations within the limits of the r joints. M (r, r) is the mass matrix, B (r,
    r) the slope of the friction torque over velocity at rest, where it is steepest, N m s/rad (N s/m if prismatic). The
    configurations are the same at every call.

    Friction is that of the `mechanism`'s drives and of `effects` in the joints, none by default. Raises `InputError`
    where the mass matrix is singular, for settings of effects that do not fit r joints, and where loops reach none of
    the configurations.
    """
    extra = sum((np.diag(effect.max_slope(mechanism.dof)) for effect in effects), np.zeros((mechanism.dof,) * 2))
    description = mechanism.description
    columns = range(description.num_energy_parameters, len(description.parameter_names))
    if not columns and not np.any(extra):
        return 0.0
    p = sampled_configurations(mechanism)
    damping = extra + _slopes(mechanism, p, columns)
    try:
        return float(np.abs(np.linalg.eigvals(np.linalg.solve(mechanism.mass_matrix(p), damping))).max())
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"{mechanism.name}: the mass matrix is singular, so friction would act at once: every joint that moves "
            "alone needs a link or a rotor with inertia"
        ) from error


class Integration(NamedTuple):
    """An integration of the motion over one control period: `integrator`, the method, in `substeps` equal steps.
    Nothing is checked."""

    substeps: int
    integrator: Integrator


def integration(
    mechanism: Mechanism,
    effects: Sequence[JointEffect],
    control_period: float,
    integrator: Integrator | None = None,
    transmission: Transmission | None = None,
) -> Integration:
    """The `Integration` of a control period of `control_period` (s), an integrator and its number of equal steps,
    chosen so that friction cannot make it unstable and it follows the oscillations of elastic joints, if there are any.

    `effects` are those in the joints, such as friction, besides the `mechanism`'s drives; `transmission` has the
    springs of elastic joints, None for rigid ones; `integrator` is the method asked for, which gets as many steps as it
    needs. None, the default, chooses Runge and Kutta's method in the fewest steps that friction allows, 1 without it,
    or, where that is more than MOST (8), the linearly implicit Euler method, whose steps friction does not bound. An
    implicit method gets at least IMPLICIT (4).

    Raises `InputError` where friction or springs act on a singular mass matrix, for effects that do not fit the joints,
    for an `integrator` without an integrator's members, where springs would need more than MOST_FOR_SPRINGS (2000)
    steps, and, with friction or springs, where loops reach none of 200 random configurations.
    """
    if integrator is not None:
        validate_integrator(integrator)
    waves, decay = 0.0, 0.0
    if transmission is not None:
        waves, decay = transmission.rates(mechanism, sampled_configurations(mechanism))
    friction = friction_rate(mechanism, effects)
    resolved = _few(math.ceil(waves * control_period / RESOLVED), mechanism)
    too_stiff = integrator is None and friction * control_period / STABLE > MOST
    if too_stiff or (integrator is not None and integrator.implicit):
        return Integration(max(IMPLICIT, resolved), integrator or LinearlyImplicitEuler())
    stable = math.ceil((friction + decay) * control_period / STABLE)
    return Integration(max(1, resolved, stable), integrator or RungeKutta4())


def validate_substeps(mechanism: Mechanism, transmission: Transmission, control_period: float, substeps: int) -> None:
    """Raise `InputError` where `substeps` explicit integration steps of a control period of `control_period` (s) are
    too few to be stable with the springs and dampers of a mechanism's elastic joints, `transmission`: step times the
    fastest frequency (rad/s) or decay (1/s) must be at most 2.5. It is also raised where more than MOST_FOR_SPRINGS
    (2000) steps are needed, and where the mass matrix without rotors is singular."""
    waves, decay = transmission.rates(mechanism, sampled_configurations(mechanism))
    needed = _few(math.ceil(control_period * max(waves, decay) / STABLE), mechanism)
    if substeps < needed:
        raise InputError(
            f"elastic joints: {substeps} substeps of {control_period:g} s are too few for springs that oscillate at "
            f"{waves:.3g} rad/s and decay at {decay:.3g} 1/s with the inertias of {mechanism.name}: use at least "
            f"{needed}"
        )


def _few(steps: int, mechanism: Mechanism) -> int:
    if steps <= MOST_FOR_SPRINGS:
        return steps
    raise InputError(
        f"elastic joints: springs and dampers this stiff, with the inertias of {mechanism.name}, would need {steps} "
        f"steps in a control period, and {MOST_FOR_SPRINGS} are the most: make them softer, or leave the joints rigid"
    )


def _slopes(mechanism: Mechanism, p: Array, columns: range) -> Array:
    """The drives' friction over velocity at rest (samples, r, r), by velocities far below where the sign bends."""
    D, slow = mechanism.inertial_parameters[columns.start :], 1e-6 * COULOMB_SMOOTHING_SPEED
    rest = np.zeros_like(p)
    slopes = np.zeros((*p.shape, mechanism.dof))
    for j in range(mechanism.dof if columns else 0):
        v = np.broadcast_to(slow * np.eye(mechanism.dof)[j], p.shape)
        slopes[..., j] = mechanism.torque_regressor(p, v, rest, columns) @ D / slow
    return slopes
