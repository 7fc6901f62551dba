"""Floating-point operations of a mechanism's equations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from adaptctl.compilation import trace
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.dynamics.parameter_layout import required_columns
from adaptctl.scalars import Column, spread


class EquationCosts(NamedTuple):
    """
    Floating-point operations per evaluation of each equation.

    Parameters
    ----------
    regressor : int
        Operations of the Slotine-Li regressor.
    control_law : int
        Operations of an adaptive law in a control period, without the regressor: the torque, and the regressor's
        transpose times the tracking error s.
    forward_dynamics : int or None
        Operations of the accelerations under given torques; None where the mass matrix is always singular.

    Examples
    --------
    >>> from adaptctl.dynamics import equation_costs
    >>> costs = equation_costs(arm)
    >>> costs.control_law < costs.regressor + costs.forward_dynamics
    True
    """

    regressor: int
    control_law: int
    forward_dynamics: int | None


def equation_costs(mechanism: Mechanism, columns: Sequence[int] | None = None) -> EquationCosts:
    """
    Count the floating-point operations of a mechanism's equations.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism; for one with loops, the closing of loops is not counted.
    columns : sequence of int, optional
        Indices of the parameters to compute with, such as those of a fundamental basis; all P by default.

    Returns
    -------
    EquationCosts
        Counts of additions, subtractions, multiplications, divisions and negations; sines, roots and comparisons do not
        count.

    Raises
    ------
    InputError
        If an index is not a whole number from 0 to P - 1.
    LoopError
        If the loops cannot be closed.

    Notes
    -----
    Sheu and Walker (1991, section 5.3) compare such counts.

    Examples
    --------
    >>> from adaptctl.dynamics import equation_costs
    >>> equation_costs(arm, basis.columns).regressor < equation_costs(arm).regressor
    True
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
        sizes = {"q": equations.num_joints, "beta": len(kept)}
        return trace(function, {name: sizes.get(name, r) for name in ("q", "v", *more)}).operations.flops

    given = "v_r", "a_r"
    try:
        accelerations = flops(forward, "torque", "beta")
    except ZeroDivisionError:
        accelerations = None
    return EquationCosts(flops(regressor, *given), flops(tick, *given, "s", "beta"), accelerations)
