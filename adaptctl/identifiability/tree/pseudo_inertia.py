"""Linear functionals of a body's ten inertial parameters, and the change of the ten with the frame.

A body of pseudo-inertia J (4, 4) = sum of x x' dm over its points x = (position, 1) has, in a frame that stands at T
(4, 4) and moves with the twist X (T' = T X), the energy <X'X/2 - e4 g'T, J> with gravity g: a functional <M, J>. In a
frame that stands at G in another one, the same body has G J G' there.
"""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.inertia import UNIT_PSEUDO_INERTIAS, from_pseudo_inertia

_TENS = np.stack([from_pseudo_inertia(unit) for unit in np.eye(16).reshape(16, 4, 4)], axis=1)
"""Matrix (10, 16) from the entries of a pseudo-inertia to its ten."""


def functionals(matrices: Array) -> Array:
    """The coefficients f (..., 10) of linear functionals of a body's ten inertial parameters, one row for each of
    `matrices` M (..., 4, 4): f times the ten (m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz) is tr(M' J). J
    (4, 4) is the body's pseudo-inertia, the sum of x x' dm over its points x = (position, 1). Raises `ValueError` for
    matrices that have not 16 entries each."""
    return matrices.reshape(*matrices.shape[:-2], 16) @ UNIT_PSEUDO_INERTIAS.reshape(10, 16).T


def frame_changes(frames: Array) -> Array:
    """The matrices (..., 10, 10) that map a body's ten inertial parameters in a frame B to its ten in a frame A, one
    for each pose of B in A in `frames` (..., 4, 4), a homogeneous matrix of rotation and origin. The ten are m, mc_x,
    mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz, with lengths in the poses' unit. Raises `ValueError` for poses of
    another size."""
    G = frames[..., None, :, :]
    return _tens(G @ UNIT_PSEUDO_INERTIAS @ G.mT)


def frame_change_rates(twists: Array) -> Array:
    """The rates (..., 10, 10) at which a body's ten inertial parameters in a fixed frame change as the body begins to
    move with `twists`, given by their matrices S (..., 4, 4). The ten are m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz,
    I_yz, I_zz; the pseudo-inertia J (4, 4), the sum of x x' dm over the body's points x = (position, 1), changes at S J
    + J S'. Raises `ValueError` for matrices of another size."""
    moved = twists[..., None, :, :] @ UNIT_PSEUDO_INERTIAS
    return _tens(moved + moved.mT)


def _tens(matrices: Array) -> Array:
    """The ten (..., 10, n), a column each, of pseudo-inertias (..., n, 4, 4)."""
    return (matrices.reshape(*matrices.shape[:-2], 16) @ _TENS.T).mT
