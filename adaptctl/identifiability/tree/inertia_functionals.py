"""What is linear in a body's ten inertial parameters, and how the ten change with the frame.

A body of pseudo-inertia J (4, 4) = sum of x x' dm over its points x = (position, 1) has, in a frame that stands at T
(4, 4) and moves with the twist X (T' = T X), the energy <X'X/2 - e4 g'T, J> with gravity g: a functional <M, J>. In a
frame that stands at G in another one, the same body has G J G' there.
"""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_pseudo_inertia, pseudo_inertia

_UNITS = np.stack([pseudo_inertia(unit) for unit in np.eye(10)])
"""(10, 4, 4): the pseudo-inertia of each unit parameter."""
_TENS = np.stack([from_pseudo_inertia(unit) for unit in np.eye(16).reshape(16, 4, 4)], axis=1)
"""(10, 16): the ten of a pseudo-inertia's entries."""


def functionals(matrices: Array) -> Array:
    """The rows (..., 10) that take the ten of J to <M, J>, of matrices M (..., 4, 4)."""
    return matrices.reshape(*matrices.shape[:-2], 16) @ _UNITS.reshape(10, 16).T


def transfers(frames: Array) -> Array:
    """Matrices (..., 10, 10) that take the ten in frames G (..., 4, 4) to the ten where these frames stand."""
    G = frames[..., None, :, :]
    return _tens(G @ _UNITS @ G.mT)


def transfer_rates(twists: Array) -> Array:
    """The rates (..., 10, 10) of `transfers` as frames begin to move with twists S (..., 4, 4): J -> S J + J S'."""
    moved = twists[..., None, :, :] @ _UNITS
    return _tens(moved + moved.mT)


def _tens(matrices: Array) -> Array:
    """Columns of tens (..., 10, n) of matrices (..., n, 4, 4)."""
    return (matrices.reshape(*matrices.shape[:-2], 16) @ _TENS.T).mT
