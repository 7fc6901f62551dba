"""Limits of motions that are searched for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array, frozen_array, per_joint, real_number
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """
    Limits of positions, speeds and torques of a reference.

    Parameters
    ----------
    lower, upper : ndarray
        Positions (r,) in rad (m).
    velocity : ndarray
        Greatest speeds (r,) in rad/s (m/s), infinite for none.
    torque : ndarray
        Greatest torques (r,) in N m (N), infinite for none.
    axes : ndarray, optional
        Matrix (r, r) of coordinates u, with p = axes u, whose positions and speeds are limited instead of the joints'.
        Default: the joints'.

    Examples
    --------
    >>> adaptctl.control.MotionLimits.from_model(model, share=0.5).velocity
    array([3., 3.])
    """

    lower: Array
    upper: Array
    velocity: Array
    torque: Array
    axes: Array | None = None

    @classmethod
    def from_model(cls, model: ReducedModel, share: float) -> MotionLimits:
        """
        Return a fraction of the position, velocity and torque limits of a mechanism's joints.

        Parameters
        ----------
        model : ReducedModel
            Reduced model of the mechanism with k parameters and r primary joints.
        share : float
            Fraction of the joints' limits that may be used, above 0 and at most 1; ranges of positions shrink about
            their middle.

        Returns
        -------
        MotionLimits
            Limits, where missing positions are pi rad (1 m), or a full range from the other limit.

        Raises
        ------
        InputError
            If the share is out of range.

        Examples
        --------
        >>> from adaptctl.control import MotionLimits
        >>> MotionLimits.from_model(model, 0.8).velocity.shape
        (2,)
        """
        validate_share(share)
        joints = model.mechanism.primary_joints
        wide = np.array([np.pi if joint.kind.is_revolute else 1.0 for joint in joints])
        lower, upper = (np.array([getattr(j.limits, name) for j in joints]) for name in ("lower", "upper"))
        lower = np.where(np.isfinite(lower), lower, np.minimum(-wide, upper - 2.0 * wide))
        upper = np.where(np.isfinite(upper), upper, np.maximum(wide, lower + 2.0 * wide))
        middle, half = 0.5 * (lower + upper), 0.5 * share * (upper - lower)
        velocity = share * np.array([joint.limits.velocity for joint in joints])
        return cls(middle - half, middle + half, velocity, share * model.mechanism.effort_limits)


def validate_limits(limits: MotionLimits, dof: int) -> None:
    """Raise `InputError` for shapes other than (dof,), or ranges that are empty."""
    lower, upper = (frozen_array(getattr(limits, name), (dof,), f"limits: {name}") for name in ("lower", "upper"))
    if not np.all(lower <= upper):
        raise InputError(f"limits: expected lower <= upper for every joint, got {lower.tolist()} and {upper.tolist()}")
    velocity, torque = (per_joint(getattr(limits, name), dof, f"limits: {name}") for name in ("velocity", "torque"))
    if not np.all(velocity >= 0.0):
        raise InputError(f"limits: velocity: expected numbers of at least 0, got {velocity.tolist()}")
    if not np.all(torque > 0.0):
        raise InputError(f"limits: torque: expected positive numbers, got {torque.tolist()}")
    if limits.axes is not None:
        frozen_array(limits.axes, (dof, dof), "limits: axes")


def validate_share(share: float) -> None:
    """Raise `InputError` for a share of limits that is not above 0 and up to 1."""
    if not 0.0 < real_number(share, "limit_share") <= 1.0:
        raise InputError(f"limit_share: expected a share of the limits above 0 and up to 1, got {share}")
