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
    """Rows (..., 10) that take the ten of a pseudo-inertia J to <M, J> = tr(M' J), of matrices M (..., 4, 4)."""
    return matrices.reshape(*matrices.shape[:-2], 16) @ UNIT_PSEUDO_INERTIAS.reshape(10, 16).T


def frame_changes(frames: Array) -> Array:
    """Matrices (..., 10, 10) that take the ten in frames at G (..., 4, 4) to the ten in the frame where G is given."""
    G = frames[..., None, :, :]
    return _tens(G @ UNIT_PSEUDO_INERTIAS @ G.mT)


def frame_change_rates(twists: Array) -> Array:
    """Rates (..., 10, 10) of `frame_changes` as frames begin to move with twists S (..., 4, 4): J -> S J + J S'."""
    moved = twists[..., None, :, :] @ UNIT_PSEUDO_INERTIAS
    return _tens(moved + moved.mT)


def _tens(matrices: Array) -> Array:
    """The ten (..., 10, n), a column each, of pseudo-inertias (..., n, 4, 4)."""
    return (matrices.reshape(*matrices.shape[:-2], 16) @ _TENS.T).mT
