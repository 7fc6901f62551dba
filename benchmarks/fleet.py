"""Many arms, each with its controller, its estimate and its true parameters, as one compiled step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import adaptctl
from adaptctl.arrays import Array
from adaptctl.compilation import Ensemble, Stepper, compile_step
from adaptctl.scalars import Column
from adaptctl.simulation import ClosedLoop, Integrator
from benchmarks.tasks import PERIOD, Task


@dataclass(frozen=True, eq=False)
class Course:
    """Steps to be taken again and again from the same start."""

    ensemble: Ensemble
    start: Array
    signals: Mapping[str, Array]

    def run(self) -> Array:
        """Joint configurations (arms, n) after all steps."""
        self.ensemble.state.blocks[...] = self.start
        self.ensemble.run(len(self.signals["noise"]), self.signals)
        return self.ensemble.state["q"]


@dataclass(frozen=True, eq=False)
class Fleet:
    """A number of arms at one task. They follow one reference, from different starts; each could have its own
    parameters.

    `lanes` arms are worked on at once: as many as suit the processor, unless given.
    """

    task: Task
    integrator: Integrator
    arms: int
    lanes: int | None = None

    @cached_property
    def plant(self) -> adaptctl.Plant:
        """One of the arms."""
        return adaptctl.Plant(self.task.arm, PERIOD, integrator=self.integrator)

    @cached_property
    def loop(self) -> ClosedLoop:
        """One of the arms under its controller."""
        return ClosedLoop(self.plant, self.task.controller)

    @cached_property
    def stepper(self) -> Stepper:
        """A control period: tick, learn, and move on; nothing is recorded."""

        def period(**columns: Column) -> tuple[Column, ...]:
            return tuple(self.loop.equation(**columns)[0])

        loop = self.loop
        shared = loop.reference | loop.noise
        return compile_step(period, state=loop.state, constants=loop.held, inputs=shared, lanes=self.lanes)

    def course(self, steps: int) -> Course:
        """A course of `steps` control periods from the start."""
        ensemble, (p, v) = self.stepper.ensemble(self.arms), self.task.starts(self.arms)
        ensemble.held["parameters"] = self.task.arm.inertial_parameters
        self.loop.set_state(ensemble, self.plant.init(p, v), self.task.controller.init(p, v))
        reference = dict(zip(self.loop.reference, self.task.references(steps), strict=True))
        return Course(ensemble, ensemble.state.blocks.copy(), reference | {"noise": np.zeros((steps, 0))})
