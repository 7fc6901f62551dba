"""Costs of a mechanism's equations in native code: floating-point operations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from adaptctl.compilation import trace
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.scalars import Column, spread


class EquationCosts(NamedTuple):
    """Counts of floating-point operations of one evaluation: additions, subtractions, multiplications, divisions and
    negations; sines are not among them.

    `regressor` counts the Slotine-Li regressor Y (r, k), `tick` the torque Y beta and the powers Y' s of one motion
    without forming Y, as an adaptive law needs them in a period, `forward_dynamics` the accelerations (r,), None where
    the k parameters kept leave a joint without inertia.
    """

    regressor: int
    """Slotine and Li's regressor Y (r, k)"""
    tick: int
    """Y beta and Y's of one motion, without forming Y: what an adaptive law needs of the equations in a period"""
    forward_dynamics: int | None
    """accelerations under torques; None where the parameters that are kept leave a joint without inertia"""


def equation_costs(mechanism: Mechanism, columns: Sequence[int] | None = None) -> EquationCosts:
    """The operation counts of a mechanism's equations with the parameters of indices `columns` only, all others being
    zero; with all of them where `columns` is None.

    With loops, at a tree configuration that closes them. Sheu and Walker (1991, section 5.3) compare such counts.
    """
    equations, r, P = mechanism.equations, mechanism.dof, len(mechanism.parameter_names)
    kept = sorted(range(P) if columns is None else columns)

    def regressor(q: Column, v: Column, v_r: Column, a_r: Column) -> list[Column]:
        return equations.torque_regressor(q, v, v_r, a_r, kept)

    def tick(q: Column, v: Column, v_r: Column, a_r: Column, s: Column, beta: Column) -> tuple[Column, Column]:
        motion = equations.motion(q, v, v_r, a_r)
        return motion.torque(spread(beta, kept, P)), motion.powers(s, kept)

    def forward(q: Column, v: Column, torque: Column, beta: Column) -> Column:
        return equations.forward_dynamics(q, v, torque, spread(beta, kept, P))

    def flops(function: Callable[..., object], *more: str) -> int:
        sizes = {"q": equations.joints, "beta": len(kept)}
        return trace(function, {name: sizes.get(name, r) for name in ("q", "v", *more)}).operations.flops

    given = "v_r", "a_r"
    try:
        accelerations = flops(forward, "torque", "beta")
    except ZeroDivisionError:
        accelerations = None
    return EquationCosts(flops(regressor, *given), flops(tick, *given, "s", "beta"), accelerations)
