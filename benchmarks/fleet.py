"""Many arms, each with its controller, its estimate and its true parameters, as one compiled step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import adaptctl
from adaptctl.arrays import Array
from adaptctl.compilation import Ensemble, Stepper, compile_step
from adaptctl.control import ReferencePoint
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import leaves, like
from adaptctl.scalars import Column
from adaptctl.simulation import Integrator
from benchmarks.tasks import PERIOD, Task


@dataclass(frozen=True, eq=False)
class Course:
    """Steps to be taken again and again from the same start."""

    ensemble: Ensemble
    start: Array
    reference: Mapping[str, Array]

    def run(self) -> Array:
        """All steps: where the joints (arms, n) are in the end."""
        self.ensemble.state.blocks[...] = self.start
        self.ensemble.run(len(self.reference["p_d"]), self.reference)
        return self.ensemble.state["q"]


@dataclass(frozen=True, eq=False)
class Fleet:
    """So many arms at one task. They follow one reference, from different starts; each could have its own parameters.

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
    def stepper(self) -> Stepper:
        """A control period: tick, learn, and move on."""
        plant, controller, blank = self.plant, self.task.controller, self._memory

        def period(
            q: Column, v: Column, parameters: Column, p_d: Column, v_d: Column, a_d: Column, **kept: Column
        ) -> tuple[Column, ...]:
            memory = like(blank, kept.values())
            torque, memory = controller.law(plant.primary(q), v, ReferencePoint(p_d, v_d, a_d), memory)
            return (*plant.equation(q, v, torque, parameters), *leaves(memory))

        equations, r = self.task.arm.equations, self.task.arm.dof
        remembered = {f"memory_{k}": len(part) for k, part in enumerate(leaves(blank))}
        return compile_step(
            period,
            state={"q": equations.joints, "v": r} | remembered,
            held={"parameters": equations.parameters},
            shared={"p_d": r, "v_d": r, "a_d": r},
            lanes=self.lanes,
        )

    def course(self, steps: int) -> Course:
        """So many steps from the start."""
        ensemble, (p, v) = self.stepper.ensemble(self.arms), self.task.starts(self.arms)
        ensemble.held["parameters"] = self.task.arm.inertial_parameters
        ensemble.state["q"], ensemble.state["v"] = self.task.arm.configuration(p), v
        begun = [leaves(self.task.controller.init(*start)) for start in zip(p, v, strict=True)]
        for k, parts in enumerate(zip(*begun, strict=True)):
            ensemble.state[f"memory_{k}"] = np.array(parts)
        reference = dict(zip(("p_d", "v_d", "a_d"), self.task.references(steps), strict=True))
        return Course(ensemble, ensemble.state.blocks.copy(), reference)

    @property
    def _memory(self) -> AdaptiveState:
        controller = self.task.controller
        return controller.start(controller.home, np.zeros(controller.dof))
