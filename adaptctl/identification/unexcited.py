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
    """A combination of fundamental parameters, each over its prior range, and how strongly the log excites it."""

    words: str
    strength: float
    """the prior range along it over the deviation that the log leaves"""


def combinations(curvature: Array, names: Sequence[str], ranges: PriorRanges | None = None) -> list[Combination]:
    """Directions of a whitened normal matrix (k, k) as combinations of parameters, the least excited first."""
    scale = (ranges or PriorRanges()).of(tuple(names))
    values, vectors = np.linalg.eigh(curvature * np.outer(scale, scale))
    return [
        Combination(_words(vector, names), float(np.sqrt(max(value, 0.0))))
        for value, vector in zip(values, vectors.T, strict=True)
    ]


def unexcited(found: Sequence[Combination], inflation: float) -> list[Combination]:
    """The combinations that the log leaves about as uncertain as they were; `inflation` is the factor by which white
    deviations are too small."""
    return [c for c in found if c.strength < WEAK * inflation]


def essential_components(mechanism: Mechanism, p: Array, v: Array) -> tuple[EssentialSpace, int]:
    """The essential space with a log's motion as its states, and how many of the parameters' components carry that
    motion's energy to a percent (Sheu and Walker 1991, section 3.2)."""
    space = essential_space(mechanism, states=States(p, v, "the log's motion"))
    return space, reduce(space, mechanism, energy_error=ENERGY_ERROR).kept


def _words(vector: Array, names: Sequence[str]) -> str:
    largest = np.argsort(-np.abs(vector))[:SHOWN]
    kept = [i for i in largest.tolist() if abs(vector[i]) > 0.2 * abs(vector[largest[0]])]
    sign = np.sign(vector[kept[0]])
    terms = [f"{sign * vector[i]:+.2f} {names[i]}" for i in kept]
    return " ".join(terms).removeprefix("+") + (" ..." if len(kept) < np.sum(np.abs(vector) > 0.1) else "")
