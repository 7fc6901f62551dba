"""The ten inertial parameters of a link, and when a rigid body can have them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.description.pose import Pose

PARAMETERS = ("m", "mc_x", "mc_y", "mc_z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz")
"""Names and order of a link's ten, about its frame's origin (kg, kg m, kg m^2); Pinocchio's order and sign."""

_TENSOR = np.array([[4, 5, 7], [5, 6, 8], [7, 8, 9]])
_LOWER = (0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)


def inertia_tensor(ten: ArrayLike) -> Array:
    """The inertia tensor (3, 3), kg m^2, about the link frame's origin, of a link's ten inertial parameters (10,) in
    the order m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz; off-diagonal entries are -integral xy dm. Raises
    `IndexError` for fewer than ten; nothing else is checked."""
    return np.asarray(ten, dtype=np.float64)[_TENSOR]


def from_tensor(mass: float, first_moment: ArrayLike, tensor: ArrayLike) -> Array:
    """The ten inertial parameters (10,) of a rigid body from its mass, first moment and inertia tensor, all about the
    frame's origin. Their order is m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2). `mass` is
    m, `first_moment` mc (3,), mass times centre of mass, and `tensor` I (3, 3), off-diagonal entries -integral xy dm;
    its diagonal and the entries above it are read. Nothing is checked."""
    entries = np.asarray(tensor, dtype=np.float64)
    return np.array([mass, *np.asarray(first_moment, dtype=np.float64), *(entries[index] for index in _LOWER)])


def from_center_of_mass(mass: float, center: ArrayLike, tensor_at_center: ArrayLike) -> Array:
    """The ten inertial parameters (10,) of a rigid body from its mass, centre of mass and inertia tensor about that
    centre (Huygens and Steiner). They are m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2),
    about the frame's origin. `mass` is in kg, `center` (3,) in m, and `tensor_at_center` (3, 3) in kg m^2, along the
    frame's axes. Nothing is checked."""
    c = np.asarray(center, dtype=np.float64)
    shift = mass * (np.dot(c, c) * np.eye(3) - np.outer(c, c))
    return from_tensor(mass, mass * c, np.asarray(tensor_at_center, dtype=np.float64) + shift)


def pseudo_inertia(ten: ArrayLike) -> Array:
    """The pseudo-inertia matrix (4, 4) of a rigid body, [[S, mc], [mc', m]] with S = tr(I)/2 1 - I, from its ten
    inertial parameters `ten` (10,).

    The ten are m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2): the mass m, the first moment
    mc (3,), whose transpose is mc', and the inertia tensor I (3, 3) with trace tr(I); 1 is the identity. A rigid body
    of positive density can have the ten exactly when the matrix is positive definite (Wensing, Kim and Slotine 2018).
    Raises `IndexError` for fewer than ten numbers; nothing else is checked.
    """
    values, tensor = np.asarray(ten, dtype=np.float64), inertia_tensor(ten)
    second_moments = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    moment = values[1:4, None]
    return np.block([[second_moments, moment], [moment.T, values[:1, None]]])


UNIT_PSEUDO_INERTIAS = np.stack([pseudo_inertia(unit) for unit in np.eye(len(PARAMETERS))])
"""Pseudo-inertias (10, 4, 4) of each parameter at 1 and the others at 0."""


def from_pseudo_inertia(matrix: ArrayLike) -> Array:
    """The ten inertial parameters (10,) of a rigid body from its pseudo-inertia `matrix` (4, 4), [[S, mc], [mc', m]].
    They are m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg m^2): the mass m, the first moment mc
    (3,) and the inertia tensor I = tr(S) 1 - S (3, 3), with the trace tr and the identity 1. Nothing is checked."""
    values = np.asarray(matrix, dtype=np.float64)
    second_moments = values[:3, :3]
    return from_tensor(values[3, 3], values[:3, 3], np.trace(second_moments) * np.eye(3) - second_moments)


def transformed(ten: ArrayLike, pose: Pose) -> Array:
    """The ten inertial parameters (10,) of a rigid body in a parent frame, from its `ten` (10,) in a child frame and
    the child's `pose` in the parent. Both are m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg, kg m, kg
    m^2), about the frames' origins. Raises `IndexError` for fewer than ten numbers; nothing else is checked."""
    homogeneous = np.eye(4)
    homogeneous[:3, :3], homogeneous[:3, 3] = pose.rotation, pose.translation
    return from_pseudo_inertia(homogeneous @ pseudo_inertia(ten) @ homogeneous.T)


def is_physically_consistent(ten: ArrayLike) -> bool:
    """True where some rigid body of positive density has the ten inertial parameters (10,) (kg)."""
    return bool(np.linalg.eigvalsh(pseudo_inertia(ten))[0] > 0.0)


def parameter_names(link_names: Sequence[str]) -> tuple[str, ...]:
    """Names of the inertial parameters of links, ten for each of `link_names`, such as ``link3.I_xx``."""
    return tuple(f"{link}.{name}" for link in link_names for name in PARAMETERS)
