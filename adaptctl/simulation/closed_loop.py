"""A plant and a controller as one step over scalars: a whole run is then one call of native code."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from adaptctl.caching import cached_property
from adaptctl.compilation import Ensemble, Stepper, compile_step
from adaptctl.control.controller import GAINS, Controller, ReferencePoint
from adaptctl.control.memory import leaves, like
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Structure
from adaptctl.simulation.plant import Plant
from adaptctl.simulation.plant_state import PlantState
from adaptctl.simulation.sampled_references import REFERENCE

_NOTHING = (Column(()), Column(()))


class Sample(NamedTuple):
    """The record of a control period: the state at its beginning, and the torques commanded and applied on it."""

    q: Any
    """(n,) the tree's joints"""
    v: Any
    """(r,)"""
    measured_p: Any
    """(r,), or nothing without sensors"""
    measured_v: Any
    energy: Any
    """(1,) J, kinetic plus potential"""
    torque: Any
    """(r,) N m, commanded"""
    applied: Any
    """(r,) N m, what reached the joints"""
    clipped: Any
    """(1,) 1 or 0"""
    estimate: Any
    """(k,) after the tick, k = 0 where there is none"""
    marks: Any
    """(m,) 1 or 0: the plant's, then those of the controller's guards"""
    learning: Any
    """(l,) what the adaptation law tells of its memory after the tick, l = 0 where it tells nothing"""


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """A closed loop: a controller that ticks on a plant's measured positions and velocities, and the plant under its
    torque.

    Its state's columns are those of `Plant.sizes`, what was measured last where there are sensors, and the controller's
    memory; they come back in this order. Raises `InputError` where plant and controller differ in their number of
    joints.
    """

    plant: Plant
    controller: Controller[Any]

    def __post_init__(self) -> None:
        if self.plant.dof != self.controller.dof:
            raise InputError(
                f"closed loop: the plant has {self.plant.dof} joints, the controller is for {self.controller.dof}"
            )

    @cached_property
    def state(self) -> dict[str, int]:
        """Lengths of the columns that pass from one control period to the next, by name: those of `Plant.sizes`,
        `measured_p` and `measured_v` (r, or 0 without sensors), and the parts of the controller's memory."""
        measured = dict.fromkeys(("measured_p", "measured_v"), self.controller.dof if self._senses else 0)
        memory = {f"memory_{k}": len(part) for k, part in enumerate(leaves(self._blank))}
        return self.plant.sizes | measured | memory

    @property
    def held(self) -> dict[str, int]:
        """Lengths of the columns that stay the same, by name: the plant's `parameters` (P,) and, where there are any,
        the controller's `gains` (g,)."""
        return {"parameters": self.plant.mechanism.equations.parameters} | self.controller.gain_sizes

    @property
    def reference(self) -> dict[str, int]:
        """Lengths of a reference point's parts (positions, velocities, accelerations), by name: r each, or as many as
        the task space has for a controller there."""
        return dict.fromkeys(REFERENCE, self.controller.reference_size)

    @property
    def noise(self) -> dict[str, int]:
        """Length of the column `noise` of the sensors' standard normal numbers, by its name: `Plant.noise_size`."""
        return {"noise": self.plant.noise_size}

    def equation(self, **columns: Column) -> tuple[list[Column], Sample]:
        """The columns (n,) passed on, in the order of `state`, and the `Sample` recorded, of one control period, from
        the columns, by name, of `state`, `held`, `reference` and `noise`."""
        q, v = columns["q"], columns["v"]
        measured = columns["measured_p"], columns["measured_v"]
        reference = ReferencePoint(*(columns[name] for name in REFERENCE))
        memory = like(self._blank, (columns[name] for name in self.state if name.startswith("memory")))
        observed = measured if self._senses else (self.plant.primary(q), v)
        law = self.controller.substituted(columns[GAINS]) if GAINS in columns else self.controller
        torque, after = law.law(*observed, reference, memory)
        outcome = self.plant.equation({**columns, "torque": torque})
        next_measured = (outcome.measured_p, outcome.measured_v) if self._senses else _NOTHING
        marks = Column((*outcome.marks, *(mark[0] for mark in guards(after))))
        estimate = Column(getattr(after, "estimate", ()))
        energy = Column((self.plant.energy_equation(q, v, columns["parameters"], columns["drives"]),))
        done = torque, outcome.applied, outcome.clipped, estimate, marks, Column(getattr(after, "recorded", ()))
        return [*outcome[:4], *next_measured, *leaves(after)], Sample(q, v, *measured, energy, *done)

    @cached_property
    def marks(self) -> tuple[str, ...]:
        """Names of the marks of a `Sample`, each 1 or 0: `Plant.marks`, then those of the controller's guards."""
        return (*self.plant.marks, *getattr(guards(self._blank), "_fields", ()))

    def __eq__(self, other: object) -> bool:
        """True if the plants are equal, and the controllers but for their gains."""
        return isinstance(other, ClosedLoop) and self._parts == other._parts

    def __hash__(self) -> int:
        return hash(self._parts)

    @property
    def _parts(self) -> tuple[Structure, Structure]:
        return self.plant.structure, self.controller.structure

    @lru_cache(maxsize=8)  # noqa: B019  # some code is worth keeping, and its loop with it
    def compiled(self) -> Stepper:
        """The stepper of one arm: native code of a control period, whose reference and noise come from outside. Those
        of the 8 latest loops are kept."""
        shared, name = self.reference | self.noise, type(self.controller).__name__
        return compile_step(self.step, state=self.state, held=self.held, shared=shared, lanes=1, name=name)

    def step(self, **columns: Column) -> tuple[Any, ...]:
        """The results of `equation` in one tuple, from the same columns: those passed on, then the fields of the
        `Sample`."""
        passed_on, sample = self.equation(**columns)
        return (*passed_on, *sample)

    def begin(self, arms: Ensemble, state: PlantState, memory: Any) -> None:
        """Set the state of `arms`, M copies of the compiled step, to `state`, the plants' (n,) or (M, n), to `memory`,
        the controller's, one for all or a row each, and their gains, if any, to the controller's."""
        plant = state.q, state.v, state.drives, state.sensors
        measured = (state.measured_p, state.measured_v) if self._senses else np.zeros((2, 0))
        for name, values in zip(self.state, (*plant, *measured, *leaves(memory)), strict=True):
            arms.state[name] = values
        for name in self.controller.gain_sizes:
            arms.held[name] = self.controller.packed

    def now(self, arms: Ensemble, time: float, member: int = 0) -> tuple[PlantState, Any]:
        """The plant's state of one of the `arms`, the number `member` from 0, at a `time` (s), with torque and marks
        zero, and its controller's memory."""
        q, v, drives, sensors, *rest = (arms.state[name][member] for name in self.state)
        p = self.plant.positions(q)
        measured, memory = rest[:2] if self._senses else (p, v), like(self._blank, rest[2:])
        done = np.zeros(len(p)), False, np.zeros(len(self.plant.marks))
        return PlantState(time, p, v, q, measured[0], measured[1], *done, drives, sensors), memory

    @cached_property
    def _blank(self) -> Any:
        """A memory, to learn its layout from."""
        return self.controller.start(self.controller.home, np.zeros(self.controller.dof))

    @property
    def _senses(self) -> bool:
        return self.plant.noise_size > 0


def guards(memory: Any) -> tuple[Any, ...]:
    """The marks of a controller's guards: a NamedTuple, empty without guards."""
    marks = getattr(memory, "marks", ())
    return marks if isinstance(marks, tuple) else ()
