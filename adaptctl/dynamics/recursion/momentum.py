"""Equations of motion by momenta, which need no accelerations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from adaptctl.dynamics.equations import Equations
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Dual


class MomentumTerms(NamedTuple):
    """Regressors with tau = d/dt (momentum D) - (forces D): rows, one a joint, of the asked columns."""

    momentum: list[Column]
    """M v = momentum D, N m s"""
    forces: list[Column]
    """C' v - g - friction = forces D, N m"""


def momentum_terms(equations: Equations, q: Column, v: Column, columns: Sequence[int]) -> MomentumTerms:
    """The regressor of the joints' momenta, and that of the forces that change them besides the torque, at
    configuration q (n,), velocities v (r,).

    C'v = M' v - C v for the Christoffel C (M' = C + C'), and dual numbers along the motion give M' v. Raises
    `InputError` for equations with known parameters other than zero: the regressors would leave out their share.
    """
    if equations.has_known_share:
        raise InputError("learning from filtered torques needs relations without known values other than zero")
    still = Column.zeros(equations.dof)
    moving = Column(map(Dual, q, equations.rates(q, v)))
    rows = equations.weightless().torque_regressor(moving, still, still, v, columns)
    momentum = [Column(_value(x) for x in row) for row in rows]
    change = [Column(_slope(x) for x in row) for row in rows]
    bias = equations.torque_regressor(q, v, v, still, columns)
    return MomentumTerms(momentum, [c - b for c, b in zip(change, bias, strict=True)])


def _value(x: Any) -> Any:
    return x.value if isinstance(x, Dual) else x


def _slope(x: Any) -> Any:
    return x.slope if isinstance(x, Dual) else 0.0
