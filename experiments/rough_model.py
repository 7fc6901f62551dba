"""Rough models of arms, from which laws may start, and their deviations from the truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.description.inertia import pseudo_inertia
from adaptctl.identifiability import ReducedModel


def deviations(model: ReducedModel, parameters: ArrayLike, share: float) -> Array:
    """Standard deviations (k,) of the k parameters of a reduced `model`, in SI units, where the P inertial and drive
    parameters that are regrouped into them, `parameters` (P,), have standard deviations of a fraction `share` (no unit)
    of their sizes.

    The size of a link's mass is the mass m, that of its first moments sqrt(m I) and that of its inertias I, the most
    that m and I allow; I = tr Sigma, Sigma (3, 3) being its second-moment matrix about its frame's origin. The size of
    a drive's parameter is its magnitude. Parameters that are regrouped into one count as independent, so their
    variances add. Nothing is checked.
    """
    values, bodies = np.asarray(parameters, dtype=np.float64), len(model.mechanism.description.bodies)
    sizes = np.abs(values)
    for i in range(0, 10 * bodies, 10):
        matrix = pseudo_inertia(values[i : i + 10])
        mass, second = float(matrix[3, 3]), float(np.trace(matrix[:3, :3]))
        sizes[i : i + 10] = [mass, *[np.sqrt(mass * second)] * 3, *[second] * 6]
    return share * np.sqrt(model.regrouping**2 @ sizes**2)
