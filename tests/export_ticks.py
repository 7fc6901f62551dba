"""Ticks of a law in closed loop, and what native code without fused operations makes of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from every_law import ARM

from adaptctl.arrays import Array
from adaptctl.codegen.closed_loop_check import default_reference
from adaptctl.codegen.interface import Interface
from adaptctl.compilation import compile_step
from adaptctl.compilation.native import Processor
from adaptctl.control import Controller, ReferencePoint
from adaptctl.control.pytree import leaves
from adaptctl.simulation import Plant
from adaptctl.simulation.closed_loop import ClosedLoop, Sample
from adaptctl.simulation.references import REFERENCE

TICKS = 20_000


@dataclass(frozen=True)
class Ticks:
    """Ticks of a closed loop, and what they are answered with."""

    given: Array
    """(T, 2r + 3m)"""
    torque: Array
    """(T, r)"""
    memory: Array
    """all numbers of the last memory"""


@dataclass(frozen=True, eq=False)
class Trial:
    """A law on an arm, the one that it names or the small one."""

    law: Controller[Any]

    @property
    def interface(self) -> Interface:
        """The law as code sees it."""
        return Interface(self.law)

    @property
    def plant(self) -> Plant:
        """The arm that it drives."""
        return Plant(self.interface.mechanism or ARM, self.interface.control_period)

    def points(self, ticks: int = TICKS) -> ReferencePoint:
        """The default reference's points (T, m)."""
        return default_reference(self.interface)(self.interface.control_period * np.arange(ticks))

    def started(self, points: ReferencePoint) -> Array:
        """Where the arm begins (r,)."""
        return np.asarray(points.p[0] if self.interface.follows_joints else self.law.neutral_configuration) + 0.0

    def recorded(self, ticks: int = TICKS) -> Ticks:
        """A closed loop of the law on its own arm, repeated without fused operations."""
        law, plant, points = self.law, self.plant, self.points(ticks)
        loop, start, rest = ClosedLoop(plant, law), self.started(points), np.zeros(law.dof)
        arms = loop.compiled().ensemble(1)
        loop.set_state(arms, plant.init(start, rest), law.init(start, rest))
        arms.held["parameters"] = plant.mechanism.inertial_parameters
        signals = dict(zip(REFERENCE, points, strict=True)) | {"noise": np.zeros((ticks, 0))}
        sample = Sample(*(x[:, 0] for x in arms.run(ticks, signals, record=True)))
        rows = np.concatenate([plant.positions(sample.q), sample.v, *points], axis=1)
        return self._repeated(np.ascontiguousarray(rows))

    def _repeated(self, rows: Array) -> Ticks:
        stepper = self.stepper(Processor.host().limited("sse2"))
        arms, law = stepper.ensemble(1), self.law
        for name, value in self.first(rows).items():
            arms.state[name] = value
        if law.gain_sizes:
            arms.held["gains"] = law.packed
        (torque,) = arms.run(len(rows), self._signals(rows), record=True)
        memory = np.concatenate([arms.state[_plain(name)][0] for name in law._memory_sizes])
        return Ticks(rows, np.array(torque[:, 0]), np.array(memory))

    def first(self, rows: Array) -> dict[str, Array]:
        """The memory before the first tick, as the stepper names its parts."""
        made = leaves(self.law.init(rows[0, : self.law.dof], np.zeros(self.law.dof)))
        return {_plain(name): value for name, value in zip(self.law._memory_sizes, made, strict=True)}

    def stepper(self, processor: Processor | None = None) -> Any:
        """The law again and again in native code, one arm at a time."""
        law, equation = self.law, self.law._equation()

        def step(**columns: Any) -> tuple[Any, ...]:
            named = {name: columns[f"given_{name}"] for name in law._given_sizes}
            kept = {name: columns[_plain(name)] for name in law._memory_sizes}
            torque, *after = equation(**named, **kept, **{name: columns[name] for name in law.gain_sizes})
            return (*after, torque)

        return compile_step(
            step,
            state={_plain(name): size for name, size in law._memory_sizes.items()},
            constants=law.gain_sizes,
            inputs={f"given_{name}": size for name, size in law._given_sizes.items()},
            lanes=1,
            name="law",
            processor=processor,
        )

    def _signals(self, rows: Array) -> dict[str, Array]:
        """Columns of ticks by name."""
        sizes = self.law._given_sizes
        parts = np.split(rows, np.cumsum(list(sizes.values()))[:-1], axis=1)
        return {f"given_{name}": np.ascontiguousarray(x) for name, x in zip(sizes, parts, strict=True)}


def _plain(name: str) -> str:
    return name.replace(".", "_")
