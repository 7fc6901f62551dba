"""Rough models of arms, from which laws may start, and their deviations from the truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.identifiability import ReducedModel


def deviations(model: ReducedModel, parameters: ArrayLike, share: float) -> Array:
    """Deviations (k,) of a model's parameters when those of links and drives (P,) are off by a share.

    A link of mass m and second moments I = tr Sigma about its frame has first moments of at most sqrt(m I) and
    inertias of at most I. What is regrouped adds as independent deviations do.
    """
    values, bodies = np.asarray(parameters, dtype=np.float64), len(model.mechanism.description.bodies)
    sizes = np.abs(values)
    for i in range(0, 10 * bodies, 10):
        matrix = pseudo_inertia(values[i : i + 10])
        mass, second = float(matrix[3, 3]), float(np.trace(matrix[:3, :3]))
        sizes[i : i + 10] = [mass, *[np.sqrt(mass * second)] * 3, *[second] * 6]
    return share * np.sqrt(model.regrouping**2 @ sizes**2)
