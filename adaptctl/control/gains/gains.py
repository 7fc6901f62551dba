"""Gains of the tracking loop, and the largest that a sampled controller can carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_number, positive_per_joint
from adaptctl.caching import sent_as_made
from adaptctl.control.gains.sampling_ratio import sampling_ratio
from adaptctl.control.gains.workspace import Workspace, everywhere, sampled_configurations
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, validate_kind


def typical_inertia(mechanism: Mechanism) -> Array:
    """The typical inertia (r,) of each of the r joints of a `mechanism`, in kg m^2 (kg if prismatic). It is the median,
    over 200 random configurations within the joints' limits, the same in every call, of the joint's entry of the mass
    matrix's diagonal. Raises `InputError` where kinematic loops can be closed at none of these."""
    return np.median(np.diagonal(everywhere(mechanism).mass_matrices, axis1=-2, axis2=-1), axis=0)


@sent_as_made
@dataclass(frozen=True, eq=False)
class Gains:
    """Slotine and Li's gains for r joints: `bandwidth` is Lambda (r,) in 1/s, `damping` is K (r,) in N m s/rad (N s/m
    for a prismatic joint). Nothing is checked."""

    bandwidth: Array
    damping: Array

    @classmethod
    def from_bandwidth(cls, mechanism: Mechanism, bandwidth: ArrayLike, damping_scale: float = 1.0) -> Gains:
        """Slotine and Li's gains, a `Gains`, for the r joints of a `mechanism` from a `bandwidth` (1/s), one number or
        one for each joint (r,). With a `ratio` of 1, the default, both poles of the error of a joint of typical inertia
        are at minus the bandwidth.

        Lambda is the bandwidth; the damping K is the bandwidth times the joint's typical inertia times `ratio` (no
        unit). The typical inertia is the median of the joint's entry of the mass matrix's diagonal over 200 random
        configurations. With the true parameters the error e, measured less desired positions, and the sliding variable
        s obey e' + Lambda e = s and M s' + (C + K) s = 0, M the mass matrix, C that of Coriolis torques and a prime the
        derivative in time. A larger ratio is stiffer against unknown torques. Raises `InputError` for numbers that are
        not positive or of another shape, and where a joint's typical inertia is not positive.
        """
        validate_kind(mechanism, Mechanism, "gains", "as load(...) gives one")
        rates = positive_per_joint(bandwidth, mechanism.dof, "bandwidth")
        damping_scale = positive_number(damping_scale, "damping_scale: expected a positive number")
        inertia = typical_inertia(mechanism)
        if np.any(inertia <= 0.0):
            raise InputError(f"{mechanism.name}: gains need a positive inertia at every joint, got {inertia}")
        return cls(rates, positive_per_joint(damping_scale * rates * inertia, mechanism.dof, "damping"))


def sampled_gain(
    mechanism: Mechanism, damping: ArrayLike, control_period: float, workspace: Workspace | None = None
) -> float:
    """The greatest sampled gain T_c lambda_max(M^-1 K), without a unit, that a local search over `workspace` finds: 2
    is the limit of stability of a torque -K v held over the `period` T_c (s).

    lambda_max is the largest eigenvalue, M the mass matrix of the `mechanism` and v (r,) the velocities of its r
    joints; `damping` is K in N m s/rad (N s/m if prismatic), one number or (r,). The search starts from the worst
    samples of `workspace`, a set of joint positions, None for 200 random ones within the joints' limits. Viscous
    friction is taken into account as in `sampling_ratio`. Raises `InputError` unless damping and period are positive
    and finite, and on a wrong shape.
    """
    return sampling_ratio(mechanism, damping, control_period, workspace=workspace).value


SPEED, ACCELERATION, MARGIN = 2.0, 10.0, 4.0
"""rad/s (m/s), rad/s^2 (m/s^2), and how many times the torque that these ask of a joint is its limit."""


def torque_limits(mechanism: Mechanism, given: ArrayLike | None = None, *, finite: bool = False) -> Array:
    """Torque limits (r,) of the `mechanism`'s r primary (independent) joints, N m (N if prismatic), read-only: `given`
    ones, one number or (r,), or where that is None the joints' own effort limits. Where a joint states none its limit
    is infinite, or if `finite` the bound of `finite_torque_limits`. Raises `InputError` for limits that are not
    positive or of another shape, and where no such bound is found, `NonFiniteError` for NaN."""
    if given is None:
        given = finite_torque_limits(mechanism) if finite else mechanism.effort_limits
    return positive_per_joint(given, mechanism.dof, "torque_limits", infinite=True)


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
