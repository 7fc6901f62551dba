"""Gains of the tracking loop, and the largest that a sampled controller can carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, numbers, per_joint, positive_number
from adaptctl.caching import sent_as_made
from adaptctl.control.gains.hold import hold_number
from adaptctl.control.gains.workspace import Workspace, everywhere
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, require_kind


def positive_per_joint(values: ArrayLike, dof: int, what: str) -> Array:
    """Positive finite numbers (dof,), one a joint, as a read-only float64 array in the unit of `values`: one number for
    all `dof` joints, or (dof,), one each. Raises `InputError` on a wrong shape and for numbers that are not positive
    and finite, `NonFiniteError` for NaN; the message names them by `what`."""
    array = per_joint(values, dof, what)
    if not ((array > 0.0) & np.isfinite(array)).all():
        raise InputError(f"{what}: expected positive numbers, got {array.tolist()}")
    return array


def positive_numbers(values: ArrayLike, what: str) -> Array:
    """Positive finite numbers (n,), read-only float64, in the unit of `values`, which are n numbers, or one number
    alone, n = 1. Raises `InputError` on a wrong shape, for other numbers and for what is no number; `what` is the name
    of the values in its message."""
    return positive_per_joint(values, numbers(values, what).size, what)


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
    def from_bandwidth(cls, mechanism: Mechanism, bandwidth: ArrayLike, ratio: float = 1.0) -> Gains:
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
        require_kind(mechanism, Mechanism, "gains", "as load(...) gives one")
        rates = positive_per_joint(bandwidth, mechanism.dof, "bandwidth")
        ratio = positive_number(ratio, "ratio: expected a positive number")
        inertia = typical_inertia(mechanism)
        if np.any(inertia <= 0.0):
            raise InputError(f"{mechanism.name}: gains need a positive inertia at every joint, got {inertia}")
        return cls(rates, positive_per_joint(ratio * rates * inertia, mechanism.dof, "damping"))


def sampled_gain(mechanism: Mechanism, damping: ArrayLike, period: float, workspace: Workspace | None = None) -> float:
    """The greatest sampled gain T_c lambda_max(M^-1 K), without a unit, that a local search over `workspace` finds: 2
    is the limit of stability of a torque -K v held over the `period` T_c (s).

    lambda_max is the largest eigenvalue, M the mass matrix of the `mechanism` and v (r,) the velocities of its r
    joints; `damping` is K in N m s/rad (N s/m if prismatic), one number or (r,). The search starts from the worst
    samples of `workspace`, a set of joint positions, None for 200 random ones within the joints' limits. Viscous
    friction is taken into account as in `hold_number`. Raises `InputError` unless damping and period are positive and
    finite, and on a wrong shape.
    """
    return hold_number(mechanism, damping, period, workspace=workspace).value
