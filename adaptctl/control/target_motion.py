"""Motion of an impedance whose inertia is not the arm's own."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array


class TargetMotion(NamedTuple):
    """
    State of an impedance with a target inertia.

    Parameters
    ----------
    velocity : ndarray
        Velocity (r,) in rad/s (m/s) that the target inertia would have now, by the forces felt so far.
    felt : ndarray
        Measured external torque (r,) in N m (N): put it in here in each period, as `HeldState.feeling` does.
    force : ndarray
        External torque (r,) in N m (N) by which the target was driven: the filtered measured one, or the observer's.

    Examples
    --------
    >>> soft = adaptctl.control.JointImpedance(model, 40.0, [6.0, 2.0], inertia=0.5, force_cutoff=500.0)
    >>> soft.init(p, v).controller_state.felt
    array([0., 0.])
    """

    velocity: Any
    felt: Any
    force: Any


def at_rest(v: Array) -> TargetMotion:
    """Motion that begins with velocities (..., r), and feels nothing."""
    none = np.zeros(np.shape(v)[-1])
    return TargetMotion(np.array(v), none, none)
