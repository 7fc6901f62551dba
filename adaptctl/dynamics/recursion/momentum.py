"""Equations of motion by momenta, which need no accelerations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from adaptctl.dynamics.equations import Equations
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Dual


class MomentumTerms(NamedTuple):
    """Regressors of the equations of motion in momenta, which need no accelerations: tau = d/dt (momentum D) - forces
    D. Here tau (r,) are the torques of r primary (independent) joints, N m (N if prismatic), and D (k,) k of their
    inertial and friction parameters.

    Both have r rows, a `Column` (k,) for each joint: `momentum` D is the generalised momentum M v, N m s (N s), and
    `forces` D the generalised forces C' v - g - friction, N m (N), with the mass matrix M, the transpose C' of the
    Christoffel (Coriolis) matrix, gravity's torque g and the joints' velocities v. Nothing is checked.
    """

    momentum: list[Column]
    """M v = momentum D, N m s"""
    forces: list[Column]
    """C' v - g - friction = forces D, N m"""


def momentum_terms(equations: Equations, q: Column, v: Column, columns: Sequence[int]) -> MomentumTerms:
    """Regressors, as `MomentumTerms`, of the momenta M v of r primary (independent) joints and of all generalised
    forces but the torque that change these momenta. They have r rows (k,) each, N m s and N m (N s and N if prismatic)
    per unit of each of the k of the P inertial and friction parameters whose indices `columns` are, from 0 to P - 1.

    `equations` are the mechanism's, with mass matrix M and Christoffel (Coriolis) matrix C; `q` (n,) is a configuration
    of the spanning tree's n joints, rad (m), and `v` (r,) the velocities of the primary ones, rad/s (m/s). Of the
    forces C' v - g - friction, g being gravity's torque, C' v is M_dot v - C v, since the rate M_dot of M along v is C
    + C'; M_dot v comes from dual numbers along the motion. Raises `InputError` for equations whose linear constraints
    fix parameters at values other than zero, for which regressors have no columns, `IndexError` for an index of P or
    more, and `IndexError` or `ValueError` for vectors too short.
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
