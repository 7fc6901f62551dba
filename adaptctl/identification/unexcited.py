"""Combinations of parameters that a log's torques do not excite, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.adaptation import PriorRanges
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import EssentialSpace, States, essential_space, reduce

SHOWN = 4
"""Parameters of a combination that are named."""
WEAK = 3.0
"""Deviations that a combination's prior range must be worth to count as excited."""
ENERGY_ERROR = 1.0
"""Percent, of the essential components that are counted."""


class Combination(NamedTuple):
    """Combination of fundamental (base) parameters, and how strongly a log excites it. `words` is a text such as "0.89
    link2.mc_x -0.45 link3.m": the largest coefficients (unitless), up to four, of parameters each divided by its prior
    range, the greatest plausible distance from a first guess. `strength` (unitless) is the ratio of the prior range
    along the combination to the standard deviation that the log leaves. Made by `combinations`; nothing is checked at
    construction."""

    words: str
    strength: float
    """the prior range along it over the deviation that the log leaves"""


def combinations(curvature: Array, names: Sequence[str], ranges: PriorRanges | None = None) -> list[Combination]:
    """Combinations of k parameters, a list of k `Combination`, the least excited first: the eigenvectors of a normal
    matrix, once parameters are scaled by their prior ranges. The matrix `curvature` (k, k), per SI units of two
    parameters, is of equations each divided by its standard deviation.

    `names` are the parameters' full names, such as `link1.m`, and `ranges` their greatest plausible distances from a
    first guess, by kind, `PriorRanges()` by default (None). Raises `NotFoundError` for a name of unknown kind,
    `ValueError` for a matrix of another size.
    """
    scale = (ranges or PriorRanges()).of(tuple(names))
    values, vectors = np.linalg.eigh(curvature * np.outer(scale, scale))
    return [
        Combination(_words(vector, names), float(np.sqrt(max(value, 0.0))))
        for value, vector in zip(values, vectors.T, strict=True)
    ]


def unexcited(found: Sequence[Combination], inflation: float) -> list[Combination]:
    """Combinations, a list of those `Combination` of `found` that a log hardly excites: with a `strength` below 3 times
    `inflation`, the log leaves them about as uncertain as they were before it. `inflation` (unitless) is the ratio of
    the true standard deviations to those for white (uncorrelated) residuals. Nothing is raised."""
    return [c for c in found if c.strength < WEAK * inflation]


def essential_components(mechanism: Mechanism, p: Array, v: Array) -> tuple[EssentialSpace, int]:
    """The essential space of a `mechanism`, an `EssentialSpace` (directions of the inertial parameters that change
    energies and torques), with a log's motion as its states, and a number of essential components, a pair. The number
    is that of the components, combinations of the mechanism's parameters, that give the motion's energy differences to
    a root mean square error of 1 % (Sheu and Walker 1991, section 3.2). The motion has positions `p`, rad (m for a
    prismatic joint), and velocities `v`, rad/s (m/s), both (n, r), of r joints at n instants. Raises `InputError` for a
    motion of other shapes or without energy differences, `RankError` where the number of identifiable parameters cannot
    be certified."""
    space = essential_space(mechanism, states=States(p, v, "the log's motion"))
    return space, reduce(space, mechanism, energy_error=ENERGY_ERROR).kept


def _words(vector: Array, names: Sequence[str]) -> str:
    largest = np.argsort(-np.abs(vector))[:SHOWN]
    kept = [i for i in largest.tolist() if abs(vector[i]) > 0.2 * abs(vector[largest[0]])]
    sign = np.sign(vector[kept[0]])
    terms = [f"{sign * vector[i]:+.2f} {names[i]}" for i in kept]
    return " ".join(terms).removeprefix("+") + (" ..." if len(kept) < np.sum(np.abs(vector) > 0.1) else "")
