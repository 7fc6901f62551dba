"""Torque limits: given, the mechanism's own, or bounds where it states none. Plants, laws and environments ask here."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_per_joint
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.dynamics import Mechanism

SPEED, ACCELERATION, MARGIN = 2.0, 10.0, 4.0
"""rad/s (m/s), rad/s^2 (m/s^2), and how many times the torque that these ask of a joint is its limit."""


def torque_limits(mechanism: Mechanism, given: ArrayLike | None = None, *, finite: bool = False) -> Array:
    """Torque limits (r,) of the `mechanism`'s r primary (independent) joints, N m (N if prismatic), read-only: `given`
    ones, one number or (r,), or where that is None the joints' own effort limits. Where a joint states none its limit
    is infinite, or if `finite` the bound of `finite_torque_limits`. Raises `InputError` for limits that are not
    positive or of another shape, and where no such bound is found, `NonFiniteError` for NaN."""
    if given is None:
        given = finite_torque_limits(mechanism) if finite else mechanism.effort_limits
    return positive_per_joint(given, mechanism.dof, "torque_limits")


def finite_torque_limits(mechanism: Mechanism) -> Array:
    """Finite torque limits (r,) of the `mechanism`'s r primary (independent) joints, N m (N if prismatic), for the
    actions of a learner: each joint's own effort limit, or a bound from inverse dynamics where it has none.

    That bound is 4 times the largest torque that inverse dynamics asks of the joint in 200 random states, and at least
    1 N m (N). Positions are uniform within the joint's limits, speeds up to 2 rad/s (m/s) and accelerations up to 10
    rad/s^2 (m/s^2) of either sign; the states are the same in every call. With kinematic loops, states where these
    cannot be closed are left out. Raises `InputError` where a joint has no limit and loops can be closed in none of the
    states.
    """
    limits = np.array(mechanism.effort_limits)
    unlimited = np.isinf(limits)
    if unlimited.any():
        limits[unlimited] = np.maximum(MARGIN * _largest_torques(mechanism), 1.0)[unlimited]
    return limits


def _largest_torques(mechanism: Mechanism) -> Array:
    p = sampled_configurations(mechanism)
    rng = np.random.default_rng(0)
    v, a = rng.uniform(-SPEED, SPEED, p.shape), rng.uniform(-ACCELERATION, ACCELERATION, p.shape)
    return np.asarray(np.abs(mechanism.inverse_dynamics(p, v, a)).max(axis=0))
