"""Arms that take a stretch of time together, so that what they read and write fits the caches."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation import Stepper
from adaptctl.compilation.loop import Source
from adaptctl.simulation.closed_loop import ClosedLoop
from adaptctl.simulation.gains_of_many import GainsOfMany
from adaptctl.simulation.lyapunov_rise import first_rise, watched
from adaptctl.simulation.noise import Noise
from adaptctl.simulation.references_of_many import ReferencesOfMany

MEMORY = 2**23
"""Bytes that a native call may read and write besides the arms' states."""
STRETCH = 2000
"""Control periods in one native call, at most: in between progress is reported, and Ctrl-C handled."""


class Herd:
    """Arms that take a stretch of time together."""

    def __init__(
        self,
        loop: ClosedLoop,
        stepper: Stepper,
        references: ReferencesOfMany,
        parameters: Array,
        noise: Noise,
        members: slice,
    ) -> None:
        self.loop, self.references, self.parameters = loop, references, parameters
        self.noise, self.members = noise, members
        self.arms = stepper.ensemble(len(parameters))

    def begin(self, p: Array, v: Array, memory: Any, tuned: GainsOfMany) -> None:
        """Put the arms at positions and velocities (M, r), with a memory, or that of new controllers."""
        loop, own = self.loop, tuned.of_arms(self.members)
        state = loop.plant.init(p, v, loop.plant.parameters(self.parameters, 0.0), self.noise.drawn(1)[0])
        begun = loop.controller.init(state.measured_p, state.measured_v, own) if memory is None else memory
        loop.begin(self.arms, state, begun)
        for name in loop.controller.gain_sizes if own else ():
            self.arms.held[name] = tuned.packed(self.members)
        for name, values in {"parameters": self.parameters, **self.references.held}.items():
            self.arms.held[name] = values

    def judge(self, bounds: Mapping[str, Array], final: int, tuned: GainsOfMany) -> None:
        """Set what errors are judged by."""
        for name, bound in bounds.items():
            self.arms.held[name] = np.minimum(bound, float(np.finfo(self.arms.stepper.dtype).max))
        self.arms.held["final"] = float(final)
        law = watched(self.loop, self.arms.stepper.precision)
        begun, true = first_rise(law, self.parameters, tuned.of_arms(self.members))
        for columns, values in ((self.arms.state, begun), (self.arms.held, true)):
            for name, numbers in values.items():
                columns[name] = numbers

    def longest(self, *, record: bool) -> int:
        """Control periods in a native call, by the memory that it needs."""
        shapes, columns = self.arms.stepper.outputs, self.arms.stepper.columns
        numbers = sum(columns[Source.DRIVEN].values()) + (sum(map(math.prod, shapes)) if record else 0)
        return max(1, min(STRETCH, MEMORY // (8 * self.arms.members * numbers) if numbers else STRETCH))

    def taken(self, time: Array, *, record: bool, threads: int) -> tuple[Array, ...]:
        """The control periods at these times."""
        if self.loop.plant.loads:
            self.arms.held["parameters"] = self.loop.plant.parameters(self.parameters, time[0])
        signals = {**self.references.signals(time), "noise": self.noise.drawn(len(time))}
        return self.arms.run(len(time), signals, record=record, threads=threads)
