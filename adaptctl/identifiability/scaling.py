"""Scaling that makes columns of a regressor comparable, whatever the units and the size of the mechanism."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptctl.mechanism.inertia import PARAMETERS
from adaptctl.mechanism.pose import Array

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

    Columns by (1, L, L^2) for mass, first moment and inertia, then by one over max(norm, floor). Energies must
    be given before differencing: a column that is constant then keeps its size, and its round-off stays small.
    """
    sizes = length_scales(parameter_names, length)
    norms = np.linalg.norm(regressor * sizes, axis=0)
    return sizes / np.maximum(norms, SMALLEST_NORM * norms.max())
