"""A plant and a controller as one step over scalars: a whole run is then one call of native code."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array, checked
from adaptctl.compilation import Ensemble, Stepper, compile_step
from adaptctl.control.controller import Controller, Reference, ReferencePoint, leaves, like
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation.plant import PlantState
from adaptctl.simulation.real_plant import RealPlant, RealPlantState

REFERENCE = ("reference_p", "reference_v", "reference_a")
_NOTHING = (Column(()), Column(()))


class Sample(NamedTuple):
    """What is recorded of a control period: the state at its beginning, and what was done on it."""

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


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """A controller that ticks on what is measured of a plant, and the plant under its torque.

    Its columns are those of `RealPlant.sizes`, what was measured last where there are sensors, and the controller's
    memory; they come back in this order.
    """

    plant: RealPlant
    controller: Controller[Any]

    def __post_init__(self) -> None:
        if self.plant.plant.dof != self.controller.dof:
            raise InputError(
                f"closed loop: the plant has {self.plant.plant.dof} joints, the controller is for {self.controller.dof}"
            )

    @cached_property
    def state(self) -> dict[str, int]:
        """Lengths of what is passed from one control period to the next."""
        measured = dict.fromkeys(("measured_p", "measured_v"), self.controller.dof if self._senses else 0)
        memory = {f"memory_{k}": len(part) for k, part in enumerate(leaves(self._blank))}
        return self.plant.sizes | measured | memory

    @property
    def held(self) -> dict[str, int]:
        """Lengths of what is kept: the plant's parameters (P,)."""
        return {"parameters": self.plant.plant.mechanism.equations.parameters}

    @property
    def reference(self) -> dict[str, int]:
        """Lengths of a reference point's parts."""
        return dict.fromkeys(REFERENCE, self.controller.reference_size)

    @property
    def noise(self) -> dict[str, int]:
        """Length of what the sensors' noise is made of, standard normal numbers."""
        return {"noise": 2 * self.controller.dof if self._senses else 0}

    def equation(
        self,
        q: Column,
        v: Column,
        drives: Column,
        sensors: Column,
        measured_p: Column,
        measured_v: Column,
        parameters: Column,
        reference_p: Column,
        reference_v: Column,
        reference_a: Column,
        noise: Column,
        **memory: Column,
    ) -> tuple[list[Column], Sample]:
        """One control period: what is passed on, and what is recorded of it."""
        p = self.plant.plant.primary(q)
        told = (measured_p, measured_v) if self._senses else (p, v)
        reference = ReferencePoint(reference_p, reference_v, reference_a)
        torque, after = self.controller.law(*told, reference, like(self._blank, memory.values()))
        period = self.plant.equation(q, v, drives, sensors, torque, noise, parameters)
        measured = (period.measured_p, period.measured_v) if self._senses else _NOTHING
        passed_on = [period.q, period.v, period.drives, period.sensors, *measured, *leaves(after)]
        marks = Column((*period.marks, *(mark[0] for mark in guards(after))))
        estimate = Column(getattr(after, "estimate", ()))
        energy = Column((self.plant.plant.energy_equation(q, v, parameters),))
        done = torque, period.applied, period.clipped, estimate, marks
        return passed_on, Sample(q, v, measured_p, measured_v, energy, *done)

    @cached_property
    def marks(self) -> tuple[str, ...]:
        """The names of what is marked."""
        return (*self.plant.marks, *getattr(guards(self._blank), "_fields", ()))

    def __eq__(self, other: object) -> bool:
        """Of the same plant, effects and controller."""
        return isinstance(other, ClosedLoop) and self._parts == other._parts

    def __hash__(self) -> int:
        return hash(self._parts)

    @property
    def _parts(self) -> tuple[int, ...]:
        """What it is made of, by identity."""
        effects = self.plant.effects
        chains = effects.actuators, effects.sensors, effects.joints, effects.loads
        return id(self.plant.plant), id(self.controller), *(id(effect) for chain in chains for effect in chain)

    @lru_cache(maxsize=8)  # noqa: B019  # some code is worth keeping, and its loop with it
    def compiled(self) -> Stepper:
        """Native code of a control period of one arm, whose reference and noise come from outside; that of the latest
        loops is kept."""
        shared, name = self.reference | self.noise, type(self.controller).__name__
        return compile_step(self.step, state=self.state, held=self.held, shared=shared, lanes=1, name=name)

    def step(self, **columns: Column) -> tuple[Any, ...]:
        """One control period in a row: what is passed on, then what is recorded."""
        passed_on, sample = self.equation(**columns)
        return (*passed_on, *sample)

    def begin(self, arms: Ensemble, state: RealPlantState, memory: Any) -> None:
        """Put arms where plants (..., n) and the controller's memory are: of one for all, or with a row each."""
        plant = state.arm.q, state.arm.v, state.drives, state.sensors
        measured = (state.p, state.v) if self._senses else np.zeros((2, 0))
        for name, values in zip(self.state, (*plant, *measured, *leaves(memory)), strict=True):
            arms.state[name] = values

    def now(self, arms: Ensemble, time: float, member: int = 0) -> tuple[RealPlantState, Any]:
        """The plant of an arm at a time, nothing having been done yet, and what its controller remembers."""
        q, v, drives, sensors, *told = (arms.state[name][member] for name in self.state)
        p = np.array(self.plant.plant.primary(Column(q)).of)
        measured, memory = told[:2] if self._senses else (p, v), like(self._blank, told[2:])
        done = np.zeros(len(p)), False, np.zeros(len(self.plant.marks))
        return RealPlantState(PlantState(time, p, v, q), measured[0], measured[1], *done, drives, sensors), memory

    def positions(self, q: Array) -> Array:
        """The primary joints' positions (..., r) among the tree's (..., n)."""
        return np.stack(self.plant.plant.primary(Column(np.moveaxis(q, -1, 0))).of, axis=-1)

    @cached_property
    def _blank(self) -> Any:
        """A memory, to learn its layout from."""
        return self.controller.start(self.controller.home, np.zeros(self.controller.dof))

    @property
    def _senses(self) -> bool:
        return bool(self.plant.effects.sensors)


def sampled(reference: Reference, time: Array, size: int) -> ReferencePoint:
    """A reference (T, size) at times (T,). Raises `InputError` where it is not of that shape, `NonFiniteError` where
    it is not finite."""
    point = reference(time)
    for name, values in zip(point._fields, point, strict=True):
        if checked(values, size, f"reference: {name}").shape != (len(time), size):
            raise InputError(f"reference: {name}: expected shape {(len(time), size)}, got {np.shape(values)}")
    return point


def guards(memory: Any) -> tuple[Any, ...]:
    """What the guards of a controller tell."""
    marks = getattr(memory, "marks", ())
    return marks if isinstance(marks, tuple) else ()
