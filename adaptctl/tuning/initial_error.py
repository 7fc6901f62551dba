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


def recoverable_error(mechanism: Mechanism, limits: Array, reference: Reference) -> Array:
    """Initial tracking errors (r,), at most 0.1 rad (m if prismatic), from which the r joints of a `mechanism` can
    return to a `reference` within its torque limits: each joint's position less the reference's at time 0. `limits`
    (r,) are the torque limits, N m (N).

    Each error is the least of three: a tenth of the joint's range of positions (of 2 rad or m without two limits), 0.1
    rad (m), and 0.3 torque limit/inertia times 1 s^2, the inertia being the joint's entry of the mass matrix's diagonal
    at time 0. All errors are then made smaller together, down to 0, where at the start the arm's gravity torque would
    be more than 0.4 of a torque limit and more than without the error, or where kinematic loops could not be closed.
    Nothing is checked.
    """
    start, common = reference(np.zeros(1)).p, common_error(mechanism)
    inertia = np.diagonal(mechanism.mass_matrix(start)[0])
    wanted = common / np.maximum(1.0, inertia * common * SLOW**2 / (ACCELERATION_SHARE * limits))
    errors = LESS ** np.arange(ROUNDS)[:, None] * wanted
    errors = np.concatenate((errors[reachable(mechanism, start + errors)], np.zeros_like(start)))
    load = np.abs(mechanism.inverse_dynamics(start + errors, 0.0 * errors, 0.0 * errors)) / limits
    fits = np.all(load <= np.maximum(LOAD, load[-1]), axis=1)
    return np.asarray(errors[fits.argmax()])


def common_error(mechanism: Mechanism) -> Array:
    """Initial tracking errors (r,) of the `mechanism`'s r joints, rad (m if prismatic), before torque limits are
    considered: a tenth of each joint's range of positions (of 2 rad or m without two limits), at most 0.1 rad (m).
    Nothing is checked."""
    lower, upper = motion_ranges(mechanism)
    return np.minimum(LARGEST_ERROR, LARGEST_ERROR * (upper - lower))
