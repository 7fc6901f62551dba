"""Ten inertial parameters of a link, and when a rigid body can have them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.description.pose import Pose

PARAMETERS = ("m", "mc_x", "mc_y", "mc_z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz")
"""Names and order of a link's ten, about its frame's origin (kg, kg m, kg m^2); Pinocchio's order and sign."""

_TENSOR = np.array([[4, 5, 7], [5, 6, 8], [7, 8, 9]])
LOWER = (0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)
"""Places in the tensor (3, 3) of the last six of the ten."""


def inertia_tensor(ten: ArrayLike) -> Array:
    """Inertia tensor (3, 3) in kg m^2 about the link frame's origin."""
    return np.asarray(ten, dtype=np.float64)[_TENSOR]


def from_tensor(mass: float, first_moment: ArrayLike, tensor: ArrayLike) -> Array:
    """Ten inertial parameters from mass, first moment and inertia tensor about the origin."""
    entries = np.asarray(tensor, dtype=np.float64)
    return np.array([mass, *np.asarray(first_moment, dtype=np.float64), *(entries[index] for index in LOWER)])


def from_center_of_mass(mass: float, center: ArrayLike, tensor_at_center: ArrayLike) -> Array:
    """Ten inertial parameters from mass, centre of mass and inertia tensor about it."""
    c = np.asarray(center, dtype=np.float64)
    return from_tensor(mass, mass * c, np.asarray(tensor_at_center, dtype=np.float64) + _of_point(mass, c))


def about_center(ten: Array) -> Array:
    """Inertia tensor (3, 3) in kg m^2 about the centre of mass, the origin where there is no mass."""
    mass = float(ten[0])
    return np.asarray(inertia_tensor(ten) - _of_point(mass, ten[1:4] / (mass or 1.0)))


def _of_point(mass: float, place: Array) -> Array:
    """Inertia tensor (3, 3) of a point mass about the origin."""
    return np.asarray(mass * (np.dot(place, place) * np.eye(3) - np.outer(place, place)))


def pseudo_inertia(ten: ArrayLike) -> Array:
    """Pseudo-inertia matrix (4, 4) [[S, mc], [mc', m]] with S = tr(I)/2 1 - I."""
    values, tensor = np.asarray(ten, dtype=np.float64), inertia_tensor(ten)
    second_moments = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    moment = values[1:4, None]
    return np.block([[second_moments, moment], [moment.T, values[:1, None]]])


UNIT_PSEUDO_INERTIAS = np.stack([pseudo_inertia(unit) for unit in np.eye(len(PARAMETERS))])
"""Pseudo-inertias (10, 4, 4) of each parameter at 1 and the others at 0."""
TEN_OF_PSEUDO_INERTIA = np.linalg.pinv(UNIT_PSEUDO_INERTIAS.reshape(10, 16))
"""Matrix (16, 10) by which rows of 16 entries of pseudo-inertias become rows of the ten."""


def from_pseudo_inertia(matrix: ArrayLike) -> Array:
    """Ten inertial parameters (10,) from the pseudo-inertia matrix (4, 4)."""
    values = np.asarray(matrix, dtype=np.float64)
    second_moments = values[:3, :3]
    return from_tensor(values[3, 3], values[:3, 3], np.trace(second_moments) * np.eye(3) - second_moments)


def transformed(ten: ArrayLike, pose: Pose) -> Array:
    """Ten inertial parameters in a parent frame, from those in a child frame."""
    homogeneous = np.eye(4)
    homogeneous[:3, :3], homogeneous[:3, 3] = pose.rotation, pose.translation
    return from_pseudo_inertia(homogeneous @ pseudo_inertia(ten) @ homogeneous.T)


def is_physically_consistent(ten: ArrayLike) -> bool:
    """True where the pseudo-inertia matrix is positive definite, so that a rigid body exists."""
    return bool(np.linalg.eigvalsh(pseudo_inertia(ten))[0] > 0.0)


def parameter_names(link_names: Sequence[str]) -> tuple[str, ...]:
    """Names of the inertial parameters of links, such as ``link3.I_xx``."""
    return tuple(f"{link}.{name}" for link in link_names for name in PARAMETERS)
