"""The rate at which friction acts, and the integration steps that it needs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.drive import SLOW
from adaptctl.errors import InputError
from adaptctl.simulation.effects import JointEffect

STABLE = 2.5
"""Of rate times step: Runge and Kutta's method is stable up to 2.78 on the real axis."""
MOST = 100
"""substeps of a control period"""


def friction_rate(mechanism: Mechanism, effects: Sequence[JointEffect] = ()) -> float:
    """The fastest decay of a velocity by friction (1/s), over random configurations within the limits.

    It is the largest eigenvalue of M^-1 B, B the slope of friction at rest, where the smoothed sign is steepest.
    """
    extra = sum((np.diag(effect.steepest(mechanism.dof)) for effect in effects), np.zeros((mechanism.dof,) * 2))
    description = mechanism.description
    columns = range(description.energetic, len(description.parameter_names))
    if not columns and not np.any(extra):
        return 0.0
    p = sampled_configurations(mechanism)
    damping = extra + _slopes(mechanism, p, columns)
    try:
        return float(np.abs(np.linalg.eigvals(np.linalg.solve(mechanism.mass_matrix(p), damping))).max())
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"{mechanism.name}: the mass matrix is singular, so friction would act at once: every joint that moves "
            "alone needs a link or a rotor with inertia"
        ) from error


def substeps_for_friction(mechanism: Mechanism, effects: Sequence[JointEffect], control_period: float) -> int:
    """The fewest steps of a control period (s) in which friction is integrated stably; 1 without friction.

    Raises `InputError` where that is more than MOST, and says what to do.
    """
    rate = friction_rate(mechanism, effects)
    needed = max(1, math.ceil(rate * control_period / STABLE))
    if needed > MOST:
        raise InputError(
            f"{mechanism.name}: friction brakes a joint within {1.0 / rate:.2g} s, so a control period of "
            f"{control_period:g} s would need {needed} integration steps: lower the friction, add the rotor's inertia "
            "(the inertia of light links alone is rarely what a drive moves), or give `substeps`"
        )
    return needed


def _slopes(mechanism: Mechanism, p: Array, columns: range) -> Array:
    """The drives' friction over velocity at rest (samples, r, r), by velocities far below where the sign bends."""
    D, slow = mechanism.inertial_parameters[columns.start :], 1e-6 * SLOW
    rest = np.zeros_like(p)
    slopes = np.zeros((*p.shape, mechanism.dof))
    for j in range(mechanism.dof if columns else 0):
        v = np.broadcast_to(slow * np.eye(mechanism.dof)[j], p.shape)
        slopes[..., j] = mechanism.torque_regressor(p, v, rest, columns) @ D / slow
    return slopes
