"""Rough models of arms, from which laws may start, and their deviations from the truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.identifiability import ReducedModel


def deviations(model: ReducedModel, parameters: ArrayLike, share: float) -> Array:
    """Standard deviations (k,) of a model's k parameters, in SI units, where the P inertial and drive parameters that
    they are regrouped from, `parameters` (P,), are off by a `share` (no unit) of their size.

    A link of mass m and second moments I = tr Sigma about its frame has first moments of at most sqrt(m I) and inertias
    of at most I, which are taken as sizes; Sigma (3, 3) is its second-moment matrix. The size of a drive's parameter is
    its magnitude. Deviations of parameters that are regrouped into one add as independent ones do, by squares. Nothing
    is checked.
    """
    values, bodies = np.asarray(parameters, dtype=np.float64), len(model.mechanism.description.bodies)
    sizes = np.abs(values)
    for i in range(0, 10 * bodies, 10):
        matrix = pseudo_inertia(values[i : i + 10])
        mass, second = float(matrix[3, 3]), float(np.trace(matrix[:3, :3]))
        sizes[i : i + 10] = [mass, *[np.sqrt(mass * second)] * 3, *[second] * 6]
    return share * np.sqrt(model.regrouping**2 @ sizes**2)
