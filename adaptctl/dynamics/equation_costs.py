"""Costs of a mechanism's equations in native code: floating-point operations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from adaptctl.compilation import trace
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.dynamics.parameter_layout import required_columns
from adaptctl.scalars import Column, spread


class EquationCosts(NamedTuple):
    """Counts of floating-point operations of one evaluation of a mechanism's equations with k of its inertial
    parameters, for r primary (independent) joints: additions, subtractions, multiplications, divisions and negations,
    without sines, cosines, roots and comparisons. Made by `equation_costs`; nothing is checked at construction.

    `regressor` counts the Slotine-Li regressor Y (r, k). `tick` counts what an adaptive law needs in a control period,
    without forming Y: the torque Y beta (r,) of the parameters beta (k,) and the powers Y' s (k,), with the transpose
    Y', at joint rates s (r,). `forward_dynamics` counts the accelerations (r,) under torques (r,); it is None where a
    pivot of the mass matrix is zero for every motion, as of a joint without inertia, and a count is no proof that the
    matrix is invertible.
    """

    regressor: int
    tick: int
    forward_dynamics: int | None


def equation_costs(mechanism: Mechanism, columns: Sequence[int] | None = None) -> EquationCosts:
    """Counts of floating-point operations of a mechanism's equations, as `EquationCosts`: of its Slotine-Li regressor,
    of the torque and powers of a control period (`tick`), and of its forward dynamics.

    `columns` are the indices, from 0 to P - 1 in any order, of the k of its P inertial and friction parameters that are
    counted, all others being zero; None for all P. With loops, the closed configuration is given: closing it is not
    counted. Sheu and Walker (1991, section 5.3) compare such counts. A repeated index counts once. Raises `InputError`
    for an entry that is not a whole number from 0 to P - 1, `LoopError` where loops cannot be closed.
    """
    equations, r, P = mechanism.equations, mechanism.dof, len(mechanism.parameter_names)
    kept = sorted(set(range(P) if columns is None else required_columns(columns, P, mechanism.name)))

    def regressor(q: Column, v: Column, v_r: Column, a_r: Column) -> list[Column]:
        return equations.torque_regressor(q, v, v_r, a_r, kept)

    def tick(q: Column, v: Column, v_r: Column, a_r: Column, s: Column, beta: Column) -> tuple[Column, Column]:
        motion = equations.motion(q, v, v_r, a_r)
        return motion.torque(spread(beta, kept, P)), motion.regressor_transpose_product(s, kept)

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
