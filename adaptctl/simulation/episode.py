"""An environment's running episode in parts, for whoever computes it without the environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.caching import sent_as_made
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.plant_state import PlantState

Judge: TypeAlias = Callable[[Array, Array, ReferencePoint, Array], tuple[Array, NDArray[np.bool_]]]
"""From configurations q (..., n), velocities (..., r), the reference there and the torques applied before (..., r), to
rewards (...) and whether the episode ends there (...)."""


@sent_as_made
class Episode(NamedTuple):
    """A running episode: what `simulate` asks an environment for by `hand_over()`, and gives back to it by
    `take_back(state, steps, clipped, terminated)`, which returns the info there."""

    plant: Plant
    state: PlantState
    parameters: Array
    """(P,) the true ones, without what effects load on them"""
    reference: Reference
    rng: np.random.Generator
    """draws the sensors' noise, 2r standard normal numbers a step"""
    steps: int
    """control periods left"""
    judge: Judge
