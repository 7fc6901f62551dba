"""A plant with what real ones have: effects between controller and joints, in the joints, and back."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, stacked
from adaptctl.compilation import Kernel, compile_function
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Scalar, absolute, column, maximum, where
from adaptctl.simulation.effects import PlantEffects
from adaptctl.simulation.plant import Plant, PlantState


class RealPlantState(NamedTuple):
    """The arm, what was measured of it (r,), and what its drives and sensors remember."""

    arm: PlantState
    p: Array
    """(r,) measured positions"""
    v: Array
    """(r,) measured velocities"""
    applied: Array
    """(r,) N m, what reached the joints in the last period"""
    clipped: bool
    """whether the torque commanded in the last period was beyond the plant's limits"""
    marks: Array
    """(m,) 1 for each of `RealPlant.marks` that held a torque back in the last period"""
    drives: Array
    sensors: Array


class Period(NamedTuple):
    """What `RealPlant.equation` makes of one control period, in columns: first what is passed on to the next."""

    q: Column
    """(n,) the tree's joints"""
    v: Column
    """(r,) velocities"""
    drives: Column
    sensors: Column
    measured_p: Column
    """(r,) as the sensors tell"""
    measured_v: Column
    """(r,) likewise"""
    applied: Column
    """(r,) N m, what reached the joints"""
    clipped: Column
    """(1,) 1 where the torque commanded was beyond the plant's limits, else 0"""
    marks: Column
    """(m,) 1 for each of `RealPlant.marks` that held a torque back, else 0"""


@dataclass(frozen=True, eq=False)
class RealPlant:
    """A plant behind its effects. Equal calls give equal bits: noise is an argument.

    The effects within the joints must be the plant's own (`Plant.friction`): they act within its integration.
    """

    plant: Plant
    effects: PlantEffects

    def __post_init__(self) -> None:
        links = self.plant.mechanism.description.body_names
        self.effects.require(self.plant.dof, links, self.plant.control_period)
        if self.effects.loads:
            require_ten_a_link(self.plant.mechanism)

    @property
    def marks(self) -> tuple[str, ...]:
        """Names of what may hold a torque back."""
        return tuple(effect.mark for effect in self.effects.actuators if effect.mark is not None)

    def parameters(self, own: Array, time: float) -> Array:
        """The inertial parameters (P,) at a time (s), what is held included."""
        for load in self.effects.loads:
            own = load.loaded(own, self.plant.mechanism.description.body_names, time)
        return own

    def until(self, time: float) -> float:
        """How long the parameters at a time (s) stay as they are, in s."""
        return min((load.until(time) for load in self.effects.loads), default=math.inf)

    def payload(self, time: float) -> float:
        """The mass that is held at a time (s), kg."""
        return sum(load.mass(time) for load in self.effects.loads)

    def init(self, p: ArrayLike, v: ArrayLike, noise: Array, parameters: Array) -> RealPlantState:
        """The state at time zero, the joints having been held still by the torque that gravity asks for: of one arm
        or, with leading axes, of many."""
        arm, period = self.plant.init(p, v), self.plant.control_period
        arms = arm.p.shape[:-1]
        held = self._holding(arm.q, parameters) if self.effects.actuators else np.zeros_like(arm.p)
        drives = _joined(arms, (effect.start(held, period) for effect in self.effects.actuators))
        sensors = _joined(arms, (effect.start(arm.p, arm.v, period) for effect in self.effects.sensors))
        measured: Sequence[Array] = arm.p, arm.v, sensors
        if self.effects.sensors:
            given = np.broadcast_to(noise, (*arms, 2 * self.plant.dof))
            rows = (x.reshape(math.prod(arms), x.shape[-1]) for x in (arm.p, arm.v, given, sensors))
            measured = [x.reshape(*arms, x.shape[-1]) for x in self._sense.map(*rows)]
        told_p, told_v, sensors = measured
        marks = np.zeros((*arms, len(self.marks)))
        return RealPlantState(arm, told_p, told_v, held, False, marks, drives, sensors)

    def _holding(self, q: Array, parameters: Array) -> Array:
        """The torques (..., r) of gravity on true parameters (..., P)."""
        still, true = Column.zeros(self.plant.dof), column(np.asarray(parameters, dtype=np.float64))
        torque = self.plant.mechanism.equations.inverse_dynamics(column(q), still, still, still, true)
        return stacked(torque.of, q.shape[:-1])

    def step(self, state: RealPlantState, torque: Array, noise: Array, parameters: Array) -> RealPlantState:
        """One control period under a commanded torque (r,); `noise` (2r,) is standard normal.

        Raises what `Plant.step` raises.
        """
        applied, drives, marks = self.plant.limited(torque), state.drives, state.marks
        clipped = bool((applied != torque).any())
        if self.effects.actuators:
            applied, drives, marks = self._drive(applied, drives)
        arm = self.plant.step(state.arm, applied, parameters)
        p, v, sensors = arm.p, arm.v, state.sensors
        if self.effects.sensors:
            p, v, sensors = self._sense(p, v, noise, sensors)
        return RealPlantState(arm, p, v, applied, clipped, marks, drives, sensors)

    def compile(self) -> None:
        """Compile now what would else be compiled when first used."""
        self.plant.compile()
        _ = self._drive, self._sense

    @cached_property
    def _drive(self) -> Callable[..., tuple[Array, Array, Array]]:
        sizes = {"torque": self.plant.dof, "memory": sum(self._drive_sizes)}
        return compile_function(self.drive_equation, sizes, name="drives")

    @cached_property
    def _sense(self) -> Kernel:
        r = self.plant.dof
        sizes = {"p": r, "v": r, "noise": 2 * r, "memory": sum(self._sensor_sizes)}
        return compile_function(self.sense_equation, sizes, name="sensors")

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of what `equation` passes from one control period to the next."""
        joints = {"q": self.plant.mechanism.equations.joints, "v": self.plant.dof}
        return joints | {"drives": sum(self._drive_sizes), "sensors": sum(self._sensor_sizes)}

    def equation(
        self,
        q: Column,
        v: Column,
        drives: Column,
        sensors: Column,
        torque: Column,
        noise: Column,
        parameters: Column,
    ) -> Period:
        """One control period over scalars of any kind, as `step` is on arrays: commanded torque (r,), noise (2r,) and
        parameters (P,). Without sensors the noise may be empty."""
        held = self.plant.limited_equation(torque)
        applied, drives, marks = self.drive_equation(held, drives)
        q, v = self.plant.equation(q, v, applied, parameters)
        p, measured_v, sensors = self.sense_equation(self.plant.primary(q), v, noise, sensors)
        clipped = Column((_differs(torque, held),))
        return Period(q, v, drives, sensors, p, measured_v, applied, clipped, marks)

    def drive_equation(self, torque: Column, memory: Column) -> tuple[Column, Column, Column]:
        """What reaches the joints (r,), the drives' memory, and marks (m,); over scalars of any kind."""
        period, parts = self.plant.control_period, _split(memory, self._drive_sizes)
        after: list[Column] = []
        marks: list[Scalar] = []
        for effect, part in zip(self.effects.actuators, parts, strict=True):
            given, kept = effect.act(torque, part, period)
            if effect.mark is not None:
                marks.append(_differs(torque, given))
            torque = given
            after.append(kept)
        return torque, Column(x for kept in after for x in kept), Column(marks)

    def sense_equation(self, p: Column, v: Column, noise: Column, memory: Column) -> tuple[Column, Column, Column]:
        """What is measured of p and v (r,), and the sensors' memory; over scalars of any kind."""
        period, parts = self.plant.control_period, _split(memory, self._sensor_sizes)
        after: list[Column] = []
        for effect, part in zip(self.effects.sensors, parts, strict=True):
            p, v, kept = effect.measure(p, v, noise, part, period)
            after.append(kept)
        return p, v, Column(x for kept in after for x in kept)

    @cached_property
    def _drive_sizes(self) -> list[int]:
        blank, period = np.zeros(self.plant.dof), self.plant.control_period
        return [len(effect.start(blank, period)) for effect in self.effects.actuators]

    @cached_property
    def _sensor_sizes(self) -> list[int]:
        blank, period = np.zeros(self.plant.dof), self.plant.control_period
        return [len(effect.start(blank, blank, period)) for effect in self.effects.sensors]


def require_ten_a_link(mechanism: Mechanism) -> None:
    """Refuse payloads where a link's ten parameters are not the mechanism's own to change."""
    if len(mechanism.inertial_parameters) < len(mechanism.description.inertial_parameters):
        raise InputError(
            f"payload: {mechanism.name} has relations among its parameters, which a payload would not keep to: take "
            "the mechanism without them as the plant"
        )


def _joined(arms: tuple[int, ...], memories: Iterable[Array]) -> Array:
    parts = [np.broadcast_to(memory, (*arms, memory.shape[-1])) for memory in memories]
    return np.concatenate(parts, axis=-1) if parts else np.zeros((*arms, 0))


def _split(memory: Column, sizes: Sequence[int]) -> list[Column]:
    parts, start = [], 0
    for size in sizes:
        parts.append(Column(memory.of[start : start + size]))
        start += size
    return parts


def _differs(asked: Column, given: Column) -> Scalar:
    """1 where any joint got another torque than was asked."""
    largest: Any = 0.0
    for x, y in zip(asked, given, strict=True):
        largest = maximum(largest, absolute(x - y))
    return where(largest > 0.0, 1.0, 0.0)
