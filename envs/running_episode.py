"""An episode while it runs."""

from __future__ import annotations

from dataclasses import dataclass

from adaptctl.arrays import Array
from adaptctl.caching import sent_as_made
from adaptctl.simulation.plant_state import PlantState
from adaptctl.simulation.sampled_references import Preview


@sent_as_made
@dataclass
class RunningEpisode:
    """Mutable state of a running episode of a tracking environment: the plant's P true inertial and friction
    `parameters` (P,), SI units, in the order of `Mechanism.parameter_names`, without the loads of effects; `preview`,
    the `Preview` of its reference; `state`, the `PlantState`; `step`, the number of control periods since its start;
    `clipped`, the number of these in which a torque was clipped; and `over`, True once it has ended. Nothing is
    checked."""

    parameters: Array
    preview: Preview
    state: PlantState
    step: int = 0
    clipped: int = 0
    over: bool = False
