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
    """Running episode of an environment of one arm: plant, state, reference trajectory and all else from which the
    function `simulate` runs it to its end in native code. Nothing is checked.

    `plant` is the arm, now at `state`; `parameters` (P,) are its P true inertial and friction parameters, SI units, in
    the order of `Mechanism.parameter_names`, without the loads of effects such as payloads; `reference` is the
    trajectory, a function from T times (T,), s, to a `ReferencePoint` (positions, velocities, accelerations); `rng`
    draws the sensors' noise, `Plant.noise_size` standard normal numbers a control period; `steps` is the number of
    control periods left. `judge(q, v, point, torque)` returns rewards (...), no unit, and a mask (...), True where the
    episode ends, from what was reached: configurations q (..., n) of the n joints of the spanning tree, rad (m if
    prismatic), velocities v (..., r) of the r primary (independent) joints, rad/s (m/s), the `ReferencePoint` there and
    the torques (..., r), N m (N), applied in the control period before.

    An environment hands the episode over by `hand_over()` and has it back by `take_back(state, steps, clipped,
    terminated)`: the state reached, the control periods it took, how many of them had a clipped torque, and True if the
    episode ended there. That returns the environment's `info` of this state.
    """

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
