"""Initial errors from which torque limits bring an arm back to its reference."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.controller import Reference
from adaptctl.control.gains.workspace import reachable
from adaptctl.dynamics import Mechanism
from adaptctl.tuning.carried_gains import ACCELERATION_SHARE
from adaptctl.tuning.motion_range import motion_ranges

LARGEST_ERROR = 0.1
"""rad or m, and of a joint's range"""
SLOW = 1.0
"""1/s, the least bandwidth with which an initial error is to be brought back"""
LOAD = 0.4
"""of a torque limit, the most that gravity may ask at the initial error unless it asks more on the reference: an arm
whose links are heavier than they are thought to be can still hold itself there"""
LESS, ROUNDS = 0.8, 20
"""times the errors of all joints, while gravity asks more"""


def initial_error(mechanism: Mechanism, limits: Array, reference: Reference) -> Array:
    """Initial errors (r,), rad or m, with which an arm of torque limits (r,) starts on a reference.

    They are a tenth of each joint's range, at most LARGEST_ERROR and what its torque brings back with a bandwidth of
    SLOW; all joints' less where gravity would ask more than LOAD, or loops could not close.
    """
    start = reference(np.zeros(1)).p[0]
    inertia = np.maximum(np.diagonal(mechanism.mass_matrix(start)), np.finfo(float).tiny)
    carried = ACCELERATION_SHARE * limits / (inertia * SLOW**2)
    error = np.minimum(common_error(mechanism), carried)
    allowed = np.maximum(LOAD, _load(mechanism, limits, start))
    for _ in range(ROUNDS):
        there = start + error
        if reachable(mechanism, there[None]).all() and np.all(_load(mechanism, limits, there) <= allowed):
            break
        error = LESS * error
    return np.asarray(error)


def common_error(mechanism: Mechanism) -> Array:
    """A tenth of each joint's range, at most LARGEST_ERROR (r,), rad or m."""
    lower, upper = motion_ranges(mechanism)
    return np.minimum(LARGEST_ERROR, LARGEST_ERROR * (upper - lower))


def _load(mechanism: Mechanism, limits: Array, p: Array) -> Array:
    """Share (r,) of the torque limits that gravity asks at p (r,)."""
    rest = np.zeros_like(p)
    return np.asarray(np.abs(mechanism.inverse_dynamics(p, rest, rest)) / limits)
