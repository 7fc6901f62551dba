"""Effects of a plant together, in the order of their places."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Scalar, absolute, maximum, where
from adaptctl.simulation.effects.effect import ActuatorEffect, Effect, JointEffect, LoadEffect, SensorEffect
from adaptctl.simulation.effects.elastic_joints import MOTOR, ElasticJoints


@dataclass(frozen=True)
class PlantEffects:
    """The effects of a plant, sorted by where they act; each tuple empty unless given.

    `actuators` act on torques between controller and joints, and `sensors` on measurements between joints and
    controller, each in the order of the signal's way; `joints` are torques in the joints, `loads` change the inertial
    parameters, and `elastic` makes the joints elastic, None for rigid ones. A torque is delayed, then limited, then
    limited in rate, then lags; positions are read by encoders, then velocities are found from them. `PlantEffects.of`
    sorts and checks them; the class itself checks nothing.
    """

    actuators: tuple[ActuatorEffect, ...] = ()
    sensors: tuple[SensorEffect, ...] = ()
    joints: tuple[JointEffect, ...] = ()
    loads: tuple[LoadEffect, ...] = ()
    elastic: ElasticJoints | None = None

    @classmethod
    def of(cls, effects: Iterable[Effect]) -> PlantEffects:
        """The plant's effects, given in any order, sorted into their places.

        Raises `InputError` for what is no `Effect`, one alone that is not in a list, and two actuators, sensors or
        elastic joints of one kind.
        """
        given = listed(effects)
        for effect in given:
            if not isinstance(effect, Effect):
                raise InputError(f"effects: expected plant effects, such as ControlDelay(2), got {effect!r}")
        _require_single([e for e in given if isinstance(e, ActuatorEffect | SensorEffect | ElasticJoints)])
        return cls(
            tuple(sorted((e for e in given if isinstance(e, ActuatorEffect)), key=_rank)),
            tuple(sorted((e for e in given if isinstance(e, SensorEffect)), key=_rank)),
            tuple(e for e in given if isinstance(e, JointEffect)),
            tuple(e for e in given if isinstance(e, LoadEffect)),
            next((e for e in given if isinstance(e, ElasticJoints)), None),
        )

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` where an effect does not fit `dof` (r) joints, the names of the `links` or a control
        period (s), `NotFoundError` for a payload's link that is none of them."""
        elastic = () if self.elastic is None else (self.elastic,)
        for effect in (*self.actuators, *self.sensors, *self.joints, *self.loads, *elastic):
            effect.require(dof, links, control_period)

    @property
    def senses_motors(self) -> bool:
        """True if encoders sit on motors that springs separate from the links."""
        return self.elastic is not None and self.elastic.encoders == MOTOR

    @property
    def marks(self) -> tuple[str, ...]:
        """Names of the actuator effects that mark the control periods in which they change a torque, such as
        "torque_limited", in the order of the torque's way."""
        return tuple(effect.mark for effect in self.actuators if effect.mark is not None)

    def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
        """The inertial parameters (..., P), SI units, of `parameters` (..., P) with the loads of all effects at `time`
        (s) added. The first are ten for each of the `links`, named in their order: m, mc_x, mc_y, mc_z, I_xx, I_xy,
        I_yy, I_xz, I_yz, I_zz, in kg, kg m, kg m^2 about the origin of the link's frame. Raises `NotFoundError` for a
        payload's link that is none of them, `InputError` for parameters that do not fit."""
        for load in self.loads:
            parameters = load.loaded(parameters, links, time)
        return parameters

    def drive_memory(self, torque: Array, control_period: float) -> Array:
        """The actuators' memory (..., m) at rest, m numbers of all together, after the joints were held by a torque
        (..., r), N m (N for a prismatic joint); `control_period` is in s."""
        return _joined((effect.start(torque, control_period) for effect in self.actuators), torque.shape[:-1])

    def sensor_memory(self, p: Array, v: Array, control_period: float) -> Array:
        """The sensors' memory (..., m) before the first measurement, m numbers of all together, of arms at p (rad or m)
        with v (rad/s or m/s), (..., r) each; `control_period` is in s."""
        return _joined((effect.start(p, v, control_period) for effect in self.sensors), p.shape[:-1])

    def driven(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column, Column]:
        """The torque (r,) after all actuators, from the `torque` (r,) given, both N m (N for a prismatic joint), in one
        control period (s), their memory (m,) after it, of `memory` (m,) before it, and marks, one for each name in
        `PlantEffects.marks`: 1 where that effect changed the torque, else 0; over scalars of any kind. Raises
        `InputError` for effects that do not fit r joints."""
        still = np.zeros(len(torque))
        parts = _split(memory, [len(effect.start(still, control_period)) for effect in self.actuators])
        after: list[Column] = []
        marks: list[Scalar] = []
        for effect, part in zip(self.actuators, parts, strict=True):
            given, kept = effect.act(torque, part, control_period)
            if effect.mark is not None:
                marks.append(differs(torque, given))
            torque = given
            after.append(kept)
        return torque, Column(x for kept in after for x in kept), Column(marks)

    def measured(
        self, p: Column, v: Column, noise: Column, memory: Column, control_period: float
    ) -> tuple[Column, Column, Column]:
        """The positions (r,), rad or m, and velocities (r,), rad/s or m/s, as all sensors measure them, and their
        memory (m,) after it; from the true p and v (r,), in the same units, and `memory` (m,), the one before. `noise`
        (2r,) is standard normal, the positions' first; `control_period` is in s; over scalars of any kind. Raises
        `InputError` for effects that do not fit r joints."""
        still = np.zeros(len(p))
        parts = _split(memory, [len(effect.start(still, still, control_period)) for effect in self.sensors])
        after: list[Column] = []
        for effect, part in zip(self.sensors, parts, strict=True):
            p, v, kept = effect.measure(p, v, noise, part, control_period)
            after.append(kept)
        return p, v, Column(x for kept in after for x in kept)


def differs(asked: Column, given: Column) -> Scalar:
    """Mark of a torque that was changed: 1 where any joint got another torque than was asked, else 0; over scalars of
    any kind."""
    largest: Any = 0.0
    for x, y in zip(asked, given, strict=True):
        largest = maximum(largest, absolute(x - y))
    return where(largest > 0.0, 1.0, 0.0)


def _joined(memories: Iterable[Array], arms: tuple[int, ...]) -> Array:
    parts = [np.broadcast_to(memory, (*arms, memory.shape[-1])) for memory in memories]
    return np.concatenate(parts, axis=-1) if parts else np.zeros((*arms, 0))


def _split(memory: Column, sizes: Sequence[int]) -> list[Column]:
    parts, start = [], 0
    for size in sizes:
        parts.append(Column(memory.of[start : start + size]))
        start += size
    return parts


def _rank(effect: Any) -> int:
    return int(effect.rank)


def listed(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """The effects, given in any order. Raises `InputError` for one alone that is not in a list."""
    if not isinstance(effects, Iterable):
        raise InputError(f"effects: expected several, such as [ControlDelay(2)], got {effects!r}")
    return tuple(effects)


def _require_single(chain: list[ActuatorEffect | SensorEffect | ElasticJoints]) -> None:
    kinds = [type(effect) for effect in chain]
    for kind in kinds:
        if kinds.count(kind) > 1:
            raise InputError(f"effects: {kind.__name__} is given {kinds.count(kind)} times, expected once")
