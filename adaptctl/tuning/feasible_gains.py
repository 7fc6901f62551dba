"""Gains of the tracking loop, and initial errors, as large as torque limits and control period carry."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.control import Gains
from adaptctl.control.controller import Reference
from adaptctl.control.gains.workspace import reachable
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.scalars import column
from adaptctl.tuning.feasible_reference import motion_ranges

FIRST_SHARE = 0.5
"""of a torque limit, which damping asks for at the initial error"""
ACCELERATION_SHARE = 0.3
"""of a torque limit, with which the initial error is brought back"""
SHRINKS, GROWS, GROWTH = 150, 120, 1.08
WIDTH = 0.2
"""rad or m about the reference"""
LARGEST_ERROR = 0.1
"""rad or m, and of a joint's range"""
SLOW = 1.0
"""1/s, the least bandwidth with which an initial error is to be brought back"""
LOAD = 0.4
"""of a torque limit, the most that gravity may ask at the initial error unless it asks more on the reference: an arm
whose links are heavier than they are thought to be can still hold itself there"""
LESS, ROUNDS = 0.8, 20
"""times the errors of all joints, while gravity asks more"""
MORE = 4.0
"""times as much damping, for which a rotor is named"""


class FeasibleGains(NamedTuple):
    """Record of the tracking gains of r joints that a control period T (s) and the torque limits allow, and of which of
    the two limits each gain. Nothing is checked.

    `gains` are Slotine and Li's bandwidth Lambda (r,), 1/s, and damping K (r,), N m s/rad (N s/m if prismatic).
    `by_hold` (r,) is True where the control period limits K, not the torque limit; `by_torque` (r,) is True where the
    torque limit makes Lambda smaller than the bandwidth that was asked for. `free_inertia` (r,), kg m^2 (kg), is the
    least inertia that a joint's torque moves, over S positions near the reference, while all other joints are free: 1
    over the greatest, at these positions, of the joint's diagonal entry of (M + T B)^-1, with the mass matrix M and the
    viscous friction B.
    """

    gains: Gains
    limited_by_sampling: NDArray[np.bool_]
    free_inertia: Array
    limited_by_torque: NDArray[np.bool_]


def feasible_gains(
    mechanism: Mechanism, limits: Array, p: Array, off: Array, control_period: float, bandwidth: float, hold: float
) -> FeasibleGains:
    """The largest gains of Slotine and Li's law that torque limits and a control `period` T (s) allow at S positions
    `p` (S, r) of the r joints of a `mechanism`, rad (m if prismatic), as a `FeasibleGains`. They are bandwidth Lambda
    (r,), 1/s, and damping K (r,), N m s/rad (N s/m).

    `limits` (r,) are the torque limits, N m (N), `off` (r,) the sizes of the initial tracking error, rad (m), above 0.
    Lambda is the lesser of `bandwidth` (1/s) and sqrt(0.3 limit/(inertia off)) of each joint, the inertia being its
    largest entry, over the positions, of the mass matrix's diagonal. K has T lambda_max((M + T B)^-1 K) of at most
    `hold` (no unit; a held torque is stable below 2) at these positions and is at most 0.5 limit/(Lambda off); M is the
    mass matrix, B the viscous friction, lambda_max the largest eigenvalue. Raises `InputError` for joints that move
    nothing that has inertia, and where M is not positive definite.
    """
    M = mechanism.mass_matrix(p)
    _validate_inertia(mechanism, M)
    inertia = np.diagonal(M, axis1=1, axis2=2).max(axis=0)
    reachable = np.sqrt(ACCELERATION_SHARE * limits / (inertia * off))
    rates = np.asarray(np.minimum(bandwidth, reachable), dtype=np.float64)
    inverse = np.asarray(np.linalg.inv(M + control_period * _viscous(mechanism, p)), dtype=np.float64)
    affordable = np.asarray(FIRST_SHARE * limits / (rates * off), dtype=np.float64)
    damping = _largest_damping(inverse, control_period, hold, affordable)
    free = 1.0 / np.diagonal(inverse, axis1=1, axis2=2).max(axis=0)
    return FeasibleGains(Gains(rates, damping), damping < 0.99 * affordable, free, reachable < bandwidth)


def _largest_damping(inverse: Array, control_period: float, hold: float, affordable: Array) -> Array:
    """Largest K (r,): joints grow alike, and where `hold` is passed only those that take part in it shrink."""
    typical = np.median(1.0 / np.diagonal(inverse, axis1=1, axis2=2), axis=0)
    damping = np.minimum(hold / control_period * typical, affordable)
    for k in range(SHRINKS):
        number, shares = _worst(inverse, control_period, damping)
        if number > hold:
            damping = damping * (hold / number) ** (shares / shares.max())
        elif k < GROWS:
            damping = np.minimum(damping * GROWTH, affordable)
    return damping * min(1.0, hold / _worst(inverse, control_period, damping)[0])


def _worst(inverse: Array, control_period: float, damping: Array) -> tuple[float, Array]:
    """T lambda_max(M^-1 K) over postures, and each joint's share (r,) in the motion that has it."""
    root = np.sqrt(damping)
    values, vectors = np.linalg.eigh(control_period * inverse * root[:, None] * root)
    worst = int(values[:, -1].argmax())
    return float(values[worst, -1]), np.asarray(vectors[worst, :, -1] ** 2)


def _viscous(mechanism: Mechanism, p: Array) -> Array:
    """Viscous friction B (S, r, r) at postures (S, r): the drives' at high speed, where Coulomb friction adds none."""
    parameters = mechanism.inertial_parameters.copy()
    coulomb = [name.endswith(".coulomb") for name in mechanism.parameter_names]
    parameters[coulomb] = 0.0
    q = column(mechanism.configuration(p))
    rows = mechanism.equations.damping(q, column(np.ones_like(p)), column(parameters))
    filled = [[np.broadcast_to(np.asarray(x, dtype=np.float64), p.shape[:1]) for x in row] for row in rows]
    return np.moveaxis(np.array(filled), -1, 0)


def _validate_inertia(mechanism: Mechanism, M: Array) -> None:
    """Raise `InputError` for joints that move nothing, and for a mass matrix that is not positive definite."""
    names = [joint.name for joint in mechanism.primary_joints]
    diagonal = np.diagonal(M, axis1=1, axis2=2)
    light = np.flatnonzero(~(diagonal.min(axis=0) > 1e-12 * diagonal.max()))
    if light.size:
        raise InputError(
            f"{mechanism.name}: {', '.join(names[j] for j in light)}: moves nothing that has inertia, so no gains hold "
            "it: give its links mass, or the joint a rotor's inertia"
        )
    root = np.sqrt(diagonal)
    least = np.linalg.eigvalsh(M / root[:, :, None] / root[:, None, :])[:, 0]
    if not least.min() > 1e-10:
        wrong = mechanism.description.inconsistent_links
        whose = f"no rigid body has the inertial parameters of {', '.join(wrong)}: give them" if wrong else "give"
        raise InputError(
            f"{mechanism.name}: the mass matrix is not positive definite along the reference, so no gains hold it: "
            f"{whose} inertial parameters that a rigid body can have, or the joints rotors"
        )


def limitations(mechanism: Mechanism, carried: FeasibleGains) -> tuple[str, ...]:
    """Sentences (a tuple of r texts), one for each of the `mechanism`'s r joints, on what limits its gains, Slotine and
    Li's bandwidth and damping. It is the control period, named with the rotor inertia that would allow four times the
    damping, or the torque limit. `carried` has the gains and what limits each. Nothing is checked."""
    return tuple(_limitation(mechanism, carried, j) for j in range(mechanism.dof))


def _limitation(mechanism: Mechanism, carried: FeasibleGains, j: int) -> str:
    joint = mechanism.primary_joints[j]
    unit = "kg m²" if joint.kind.is_revolute else "kg"
    if carried.limited_by_sampling[j]:
        rotor = (MORE - 1.0) * carried.free_inertia[j]
        kind = "a rotor" if joint.kind.is_revolute else "a drive"
        return f"the control period holds K low: {kind} of {rotor:.1g} {unit} would allow {MORE:g} times"
    if carried.limited_by_torque[j]:
        return "its torque limit holds Λ and K low"
    return "its torque limit holds K low"


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
