"""One step in time of p'' = a(p, p'), over scalars of any kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from adaptctl.scalars import Column

Acceleration: TypeAlias = Callable[[Column, Column], Column]
"""Positions and velocities (r,) to accelerations (r,)."""


class Integrator(Protocol):
    """A one-step method for second-order equations."""

    def step(self, acceleration: Acceleration, p: Column, v: Column, dt: float) -> tuple[Column, Column]:
        """Positions and velocities `dt` seconds later."""
        ...


@dataclass(frozen=True)
class RungeKutta4:
    """The classical method of order 4 (Kutta 1901): four accelerations a step."""

    def step(self, acceleration: Acceleration, p: Column, v: Column, dt: float) -> tuple[Column, Column]:
        """Positions and velocities `dt` seconds later, with an error of order dt^5."""
        half = 0.5 * dt
        a1 = acceleration(p, v)
        v2 = v + half * a1
        a2 = acceleration(p + half * v, v2)
        v3 = v + half * a2
        a3 = acceleration(p + half * v2, v3)
        v4 = v + dt * a3
        a4 = acceleration(p + dt * v3, v4)
        sixth, third = dt / 6.0, dt / 3.0
        return p + sixth * (v + v4) + third * (v2 + v3), v + sixth * (a1 + a4) + third * (a2 + a3)


@dataclass(frozen=True)
class SemiImplicitEuler:
    """The symplectic Euler method of order 1: one acceleration a step, positions moved by the new velocities.

    Where the acceleration depends on positions alone, its energy error stays bounded; with the velocity terms
    of an arm it does so only approximately (Hairer, Lubich and Wanner 2006, section I.1).
    """

    def step(self, acceleration: Acceleration, p: Column, v: Column, dt: float) -> tuple[Column, Column]:
        """Positions and velocities `dt` seconds later, with an error of order dt^2."""
        after = v + dt * acceleration(p, v)
        return p + dt * after, after
