"""One step in time of p'' = a(p, p'), over scalars of any kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol, TypeAlias

from adaptctl.errors import InputError
from adaptctl.scalars import Column

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


def require_integrator(given: object) -> None:
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
