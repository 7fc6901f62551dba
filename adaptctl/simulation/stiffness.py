"""The rates at which friction and springs act, and the integration steps that they need."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.drive import SLOW
from adaptctl.errors import InputError
from adaptctl.simulation.effects import JointEffect
from adaptctl.simulation.integrator import Integrator, LinearlyImplicitEuler, RungeKutta4, require_integrator
from adaptctl.simulation.transmission import Transmission

STABLE = 2.5
"""Of rate times step: Runge and Kutta's method is stable up to 2.78 on the real axis."""
MOST = 8
"""steps of Runge and Kutta's method in a control period"""
IMPLICIT = 4
"""at least so many steps of the linearly implicit one: within 0.4 mrad of 144 to 556 of the other on arms with stiff
friction"""


RESOLVED = 1.0
"""Of a spring's frequency times step: Runge and Kutta's method loses 0.7 % of an oscillation's amplitude a radian."""
MOST_FOR_SPRINGS = 2000
"""steps in a control period"""


def friction_rate(mechanism: Mechanism, effects: Sequence[JointEffect] = ()) -> float:
    """The fastest decay rate of a velocity by friction, 1/s, 0 without friction: the largest magnitude of an eigenvalue
    of M^-1 B at any of 200 random configurations within the limits of the r joints. M (r, r) is the mass matrix, B (r,
    r) the slope of the friction torque over velocity at rest, where it is steepest, N m s/rad (N s/m if prismatic). The
    configurations are the same at every call.

    Friction is that of the `mechanism`'s drives and of `effects` in the joints, none by default. Raises `InputError`
    where the mass matrix is singular, for settings of effects that do not fit r joints, and where loops reach none of
    the configurations.
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


class Integration(NamedTuple):
    """An integration of the motion over one control period: `integrator`, the method, in `substeps` equal steps.
    Nothing is checked."""

    substeps: int
    integrator: Integrator


def integration(
    mechanism: Mechanism,
    effects: Sequence[JointEffect],
    control_period: float,
    integrator: Integrator | None = None,
    transmission: Transmission | None = None,
) -> Integration:
    """The `Integration` of a control period of `control_period` (s), an integrator and its number of equal steps,
    chosen so that friction cannot make it unstable and it follows the oscillations of elastic joints, if there are any.

    `effects` are those in the joints, such as friction, besides the `mechanism`'s drives; `transmission` has the
    springs of elastic joints, None for rigid ones; `integrator` is the method asked for, which gets as many steps as it
    needs. None, the default, chooses Runge and Kutta's method in the fewest steps that friction allows, 1 without it,
    or, where that is more than MOST (8), the linearly implicit Euler method, whose steps friction does not bound. An
    implicit method gets at least IMPLICIT (4).

    Raises `InputError` where friction or springs act on a singular mass matrix, for effects that do not fit the joints,
    for an `integrator` without an integrator's members, where springs would need more than MOST_FOR_SPRINGS (2000)
    steps, and, with friction or springs, where loops reach none of 200 random configurations.
    """
    if integrator is not None:
        require_integrator(integrator)
    waves, decay = 0.0, 0.0
    if transmission is not None:
        waves, decay = transmission.rates(mechanism, sampled_configurations(mechanism))
    friction = friction_rate(mechanism, effects)
    resolved = _few(math.ceil(waves * control_period / RESOLVED), mechanism)
    too_stiff = integrator is None and friction * control_period / STABLE > MOST
    if too_stiff or (integrator is not None and integrator.implicit):
        return Integration(max(IMPLICIT, resolved), integrator or LinearlyImplicitEuler())
    stable = math.ceil((friction + decay) * control_period / STABLE)
    return Integration(max(1, resolved, stable), integrator or RungeKutta4())


def require_substeps(mechanism: Mechanism, transmission: Transmission, control_period: float, substeps: int) -> None:
    """Raise `InputError` where `substeps` explicit integration steps of a control period of `control_period` (s) are
    too few to be stable with the springs and dampers of a mechanism's elastic joints, `transmission`: step times the
    fastest frequency (rad/s) or decay (1/s) must be at most 2.5. It is also raised where more than MOST_FOR_SPRINGS
    (2000) steps are needed, and where the mass matrix without rotors is singular."""
    waves, decay = transmission.rates(mechanism, sampled_configurations(mechanism))
    needed = _few(math.ceil(control_period * max(waves, decay) / STABLE), mechanism)
    if substeps < needed:
        raise InputError(
            f"elastic joints: {substeps} substeps of {control_period:g} s are too few for springs that oscillate at "
            f"{waves:.3g} rad/s and decay at {decay:.3g} 1/s with the inertias of {mechanism.name}: use at least "
            f"{needed}"
        )


def _few(steps: int, mechanism: Mechanism) -> int:
    if steps <= MOST_FOR_SPRINGS:
        return steps
    raise InputError(
        f"elastic joints: springs and dampers this stiff, with the inertias of {mechanism.name}, would need {steps} "
        f"steps in a control period, and {MOST_FOR_SPRINGS} are the most: make them softer, or leave the joints rigid"
    )


def _slopes(mechanism: Mechanism, p: Array, columns: range) -> Array:
    """The drives' friction over velocity at rest (samples, r, r), by velocities far below where the sign bends."""
    D, slow = mechanism.inertial_parameters[columns.start :], 1e-6 * SLOW
    rest = np.zeros_like(p)
    slopes = np.zeros((*p.shape, mechanism.dof))
    for j in range(mechanism.dof if columns else 0):
        v = np.broadcast_to(slow * np.eye(mechanism.dof)[j], p.shape)
        slopes[..., j] = mechanism.torque_regressor(p, v, rest, columns) @ D / slow
    return slopes
