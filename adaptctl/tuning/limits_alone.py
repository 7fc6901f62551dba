"""Stand-in for an arm of which only kinematics and limits are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, positive_per_joint
from adaptctl.description.drive import DriveParameter
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, validate_kind

LIGHT = from_center_of_mass(1e-6, np.zeros(3), 1e-9 * np.eye(3))
"""kg, kg m and kg m^2 of a link that hardly counts, but is a body"""


def limits_alone(mechanism: Mechanism, acceleration: ArrayLike = 1000.0) -> Mechanism:
    """
    Return an arm of the same kinematics and limits, whose inertias are made of these alone.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r primary joints. Its masses, inertias and friction are not used.
    acceleration : array_like, default 1000.0
        Acceleration in rad/s^2 (m/s^2), one number or (r,), that no joint's torque limit exceeds without a load. 1000
        is above that of geared joints; those of light links without rotors reach 100,000.

    Returns
    -------
    Mechanism
        Arm whose rotors have the torque limits divided by the acceleration, and whose links hardly have a mass. `tune`
        and `adaptive_controller` find gains and a reference for it that know no more.

    Raises
    ------
    InputError
        If a primary joint has no torque limit, or an acceleration is not positive.

    Notes
    -----
    Gains for it are stable on every arm with at least these rotors: damping K obeys T K <= h J, and M - J is positive.

    Examples
    --------
    >>> from adaptctl.tuning import limits_alone
    >>> [drive.rotor_inertia for drive in (joint.drive for joint in limits_alone(arm).primary_joints)]
    [0.06, 0.025]
    """
    validate_kind(mechanism, Mechanism, "limits_alone", "as load(...) gives one")
    names = [joint.name for joint in mechanism.primary_joints]
    rotors = dict(zip(names, _rotors(mechanism, acceleration).tolist(), strict=True))
    joints, bodies = [link.joint for link in mechanism.links], len(mechanism.description.bodies)
    drives = [replace(one.drive, rotor_inertia=rotors.get(one.name, one.drive.rotor_inertia)) for one in joints]
    found = mechanism.with_drives(drives)
    known = {f"{name}.{DriveParameter.ROTOR_INERTIA.value}": rotor for name, rotor in rotors.items()}
    rest = [known.get(name, 0.0) for name in found.parameter_names[10 * bodies :]]
    return found.with_parameters(np.concatenate((np.tile(LIGHT, bodies), rest)))


def _rotors(mechanism: Mechanism, acceleration: ArrayLike) -> Array:
    """Least rotor inertias (r,)."""
    limits = np.asarray(mechanism.effort_limits)
    if without := [joint.name for joint, x in zip(mechanism.primary_joints, limits, strict=True) if not np.isfinite(x)]:
        raise InputError(f"limits_alone: {', '.join(without)}: expected torque limits, of which gains are made")
    return np.asarray(limits / positive_per_joint(acceleration, mechanism.dof, "acceleration"))
