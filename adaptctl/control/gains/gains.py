"""Gains and torque limits."""

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
    """
    Compute the typical inertia that each joint moves.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.

    Returns
    -------
    ndarray
        Median (r,) of the mass matrix's diagonal over 200 random configurations within the limits, the same in every
        call, in kg m^2 (kg for a prismatic joint).

    Raises
    ------
    InputError
        If kinematic loops can be closed at none of the configurations.

    Examples
    --------
    >>> adaptctl.control.typical_inertia(arm).shape
    (2,)
    """
    return np.median(np.diagonal(everywhere(mechanism).mass_matrices, axis1=-2, axis2=-1), axis=0)


@sent_as_made
@dataclass(frozen=True, eq=False)
class Gains:
    """
    Bandwidth and damping of Slotine and Li's law.

    Parameters
    ----------
    bandwidth : ndarray
        Decay rate Lambda (r,) of the tracking error in 1/s.
    damping : ndarray
        Damping K (r,) in N m s/rad (N s/m for a prismatic joint).

    Examples
    --------
    >>> gains = adaptctl.Gains.from_bandwidth(arm, 5.0)
    >>> adaptctl.SlotineLi(model, gains.bandwidth, gains.damping).dof
    2
    """

    bandwidth: Array
    damping: Array

    @classmethod
    def from_bandwidth(cls, mechanism: Mechanism, bandwidth: ArrayLike, damping_scale: float = 1.0) -> Gains:
        """
        Choose the gains for a bandwidth and the typical inertias.

        Parameters
        ----------
        mechanism : Mechanism
            Mechanism with r joints.
        bandwidth : array_like
            Bandwidth in 1/s, one number or (r,).
        damping_scale : float, default 1.0
            Factor of the damping, which is the bandwidth times the joint's typical inertia. At 1 both poles of the
            error of a joint of this inertia are at minus the bandwidth; more is stiffer against unknown torques.

        Returns
        -------
        Gains
            Bandwidth (r,) and damping (r,).

        Raises
        ------
        InputError
            If a number is not positive, a shape is wrong, or a joint's typical inertia is not positive.

        Examples
        --------
        >>> adaptctl.control.Gains.from_bandwidth(arm, 5.0).damping.shape
        (2,)
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
    """
    Compute the control period times the largest eigenvalue of M^-1 K, mass matrix M and damping K.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    damping : array_like
        Damping K in N m s/rad (N s/m for a prismatic joint), one number or (r,).
    control_period : float
        Time in s for which a torque is held.
    workspace : Workspace, optional
        Joint positions that are searched. Unless given, 200 random ones within the joints' limits start the search.

    Returns
    -------
    float
        Greatest value without a unit. A held torque -K v is stable below 2.

    Raises
    ------
    InputError
        If damping or period is not positive and finite, or a shape is wrong.

    Examples
    --------
    >>> adaptctl.control.sampled_gain(arm, [6.0, 2.0], control_period=1e-3) < 1.5
    True
    """
    return sampling_ratio(mechanism, damping, control_period, workspace=workspace).value


SAMPLED_SPEED, SAMPLED_ACCELERATION = 2.0, 10.0  # rad/s (m/s) and rad/s^2 (m/s^2)
TORQUE_MARGIN = 4.0  # of the limit over the largest torque in these states


def torque_limits(mechanism: Mechanism, given: ArrayLike | None = None, *, finite: bool = False) -> Array:
    """Torque limits (r,), by default the mechanism's."""
    if given is None:
        given = finite_torque_limits(mechanism) if finite else mechanism.effort_limits
    return positive_per_joint(given, mechanism.dof, "torque_limits", infinite=True)


def finite_torque_limits(mechanism: Mechanism) -> Array:
    """Effort limits (r,), or bounds from inverse dynamics."""
    limits = np.array(mechanism.effort_limits)
    unlimited = np.isinf(limits)
    if unlimited.any():
        limits[unlimited] = np.maximum(TORQUE_MARGIN * _largest_torques(mechanism), 1.0)[unlimited]
    return limits


def _largest_torques(mechanism: Mechanism) -> Array:
    p = sampled_configurations(mechanism)
    rng = np.random.default_rng(0)
    v, a = (
        rng.uniform(-SAMPLED_SPEED, SAMPLED_SPEED, p.shape),
        rng.uniform(-SAMPLED_ACCELERATION, SAMPLED_ACCELERATION, p.shape),
    )
    return np.asarray(np.abs(mechanism.inverse_dynamics(p, v, a)).max(axis=0))
