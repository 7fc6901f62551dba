"""Scaling that makes columns of a regressor comparable, whatever the units and the size of the mechanism."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.inertia import PARAMETERS

LENGTH_POWERS = dict(zip((*PARAMETERS, "rotor_inertia"), (0, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2), strict=True))
"""Mass, first moment and inertia are kg times this power of a length."""

SMALLEST_NORM = 1e-3
"""Of the largest: the floor under column norms. Without it, columns of mere round-off are blown up."""


def length_scales(parameter_names: Sequence[str], length: float) -> Array:
    """(P,): 1, L, L^2 for mass, first moment and inertia."""
    powers = np.array([LENGTH_POWERS[name.rsplit(".", 1)[-1]] for name in parameter_names], dtype=np.float64)
    return np.asarray(length**powers)


def column_scales(regressor: Array, parameter_names: Sequence[str], length: float) -> Array:
    """Factors (P,) by which columns of `regressor` (rows, P) are multiplied before its rank is decided.

    Energies must be given before differencing: a column that is constant then keeps its size, and its round-off
    stays small.
    """
    return comparable(np.linalg.norm(regressor, axis=0), parameter_names, length)


def comparable(norms: Array, parameter_names: Sequence[str], length: float) -> Array:
    """The same from the columns' norms (P,): columns times (1, L, L^2) for mass, first moment and inertia, then over
    max(norm, floor)."""
    sizes = length_scales(parameter_names, length)
    scaled = norms * sizes
    return sizes / np.maximum(scaled, SMALLEST_NORM * scaled.max())
