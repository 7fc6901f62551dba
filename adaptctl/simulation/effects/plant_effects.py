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
from adaptctl.simulation.effects.joints import MOTOR, ElasticJoints

KINDS = (ActuatorEffect, SensorEffect, JointEffect, LoadEffect, ElasticJoints)
"""Base classes of the effects that a plant has a place for; it refuses others."""


@dataclass(frozen=True)
class PlantEffects:
    """Effects of one plant, what it has besides rigid links and ideal drives, sorted by where they act; each tuple is
    empty by default.

    `actuators` change torques between controller and joints, and `sensors` measurements between joints and controller,
    each in the order in which the signal passes them; `joints` are torques in the joints, `loads` change the inertial
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
        """The `PlantEffects` of a plant, made of `effects`, a list or another iterable of effects in any order: sorted
        into actuator, sensor, joint and load effects and elastic joints. Actuator and sensor effects are ordered by
        their `rank`, the order in which signals pass them.

        Raises `InputError` for an element that is no `Effect`, for an effect of none of these five kinds, for an effect
        alone that is not in a list, and for two actuator effects, two sensor effects or two elastic joints of one
        class; joint and load effects may repeat.
        """
        given = listed(effects)
        for effect in given:
            if not isinstance(effect, Effect):
                raise InputError(f"effects: expected plant effects, such as ControlDelay(2), got {effect!r}")
            if not isinstance(effect, KINDS):
                names = ", ".join(kind.__name__ for kind in KINDS[:3])
                raise InputError(f"effects: expected effects derived from {names} or LoadEffect, got {effect!r}")
        _validate_single([e for e in given if isinstance(e, ActuatorEffect | SensorEffect | ElasticJoints)])
        return cls(
            tuple(sorted((e for e in given if isinstance(e, ActuatorEffect)), key=_rank)),
            tuple(sorted((e for e in given if isinstance(e, SensorEffect)), key=_rank)),
            tuple(e for e in given if isinstance(e, JointEffect)),
            tuple(e for e in given if isinstance(e, LoadEffect)),
            next((e for e in given if isinstance(e, ElasticJoints)), None),
        )

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` where an effect's settings do not fit a plant of `dof` (r) joints, as its own `require`
        finds. Such are settings that are negative, NaN or neither one number nor one for each joint, and a filter's
        cutoff too high for the `control_period` (s). Raise `NotFoundError`, a subclass of it, where a payload's link is
        not among `links`, the names of those with ten inertial parameters each."""
        elastic = () if self.elastic is None else (self.elastic,)
        for effect in (*self.actuators, *self.sensors, *self.joints, *self.loads, *elastic):
            effect.validate(dof, links, control_period)

    @property
    def senses_motors(self) -> bool:
        """True if the encoders sit on the motors of elastic joints, before the springs; False for encoders on the links
        and for rigid joints."""
        return self.elastic is not None and self.elastic.encoders == MOTOR

    @property
    def flags(self) -> tuple[str, ...]:
        """Names of the flags of the actuator effects that flag control periods in which they change a torque, such as
        "torque_limited", in the order in which a torque passes the effects; empty where none has a flag."""
        return tuple(effect.flag for effect in self.actuators if effect.flag is not None)

    def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
        """The P inertial and friction parameters (..., P) of a mechanism with all loads at `time` (s), such as
        payloads, added to `parameters` (..., P), SI units, those without loads; these themselves where there is no
        load.

        The parameters begin with ten for each of the `links` (names), in their order: m, mc_x, mc_y, mc_z, I_xx, I_xy,
        I_yy, I_xz, I_yz, I_zz, in kg, kg m, kg m^2 about the origin of the link's frame; the drives' (rotor inertias
        and friction), if any, follow. While a payload is held, raises `NotFoundError` where its link is not among
        `links`, `InputError` for parameters that are no numbers or too few to include that link's.
        """
        for load in self.loads:
            parameters = load.loaded(parameters, links, time)
        return parameters

    def drive_memory(self, torque: Array, control_period: float) -> Array:
        """The initial internal states of all actuator effects, concatenated to one array (..., h) in the order in which
        a torque passes the effects; h is the number of scalars that the effects keep, 0 without actuator effects.
        `torque` (..., r), N m (N for a prismatic joint), is the torque that has held the r joints; `control_period` is
        in s. Nothing is checked."""
        return _joined((effect.initial_state(torque, control_period) for effect in self.actuators), torque.shape[:-1])

    def sensor_memory(self, p: Array, v: Array, control_period: float) -> Array:
        """The initial internal states of all sensor effects, concatenated to one array (..., h) in the order in which
        measurements pass the effects; h is the number of scalars that the effects keep, 0 without sensor effects. The
        arms of r joints are at positions p (..., r), rad (m if prismatic), and velocities v (..., r), rad/s (m/s), of
        the first measurement; `control_period` is in s. Nothing is checked."""
        return _joined((effect.initial_state(p, v, control_period) for effect in self.sensors), p.shape[:-1])

    def driven(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column, Column]:
        """The torque (r,) that all actuator effects together pass on to r joints over one `control_period` (s), the
        effects' internal state (h,) after it, and flags (k,). Torques are in N m (N for a prismatic joint). There is a
        flag for each of the k names in this object's property `flags`: 1 where that effect changed any joint's torque,
        else 0.

        `torque` (r,) is the one commanded, `memory` (h,) the effects' internal state after the period before, one
        effect after the other. Vectors are Columns of scalars of any kind: floats, arrays, or symbols to be compiled.
        Raises `InputError` for settings that do not fit r joints; a lag or a rate limit raises `ValueError` for an
        internal state that is too short.
        """
        still = np.zeros(len(torque))
        parts = _split(memory, [len(effect.initial_state(still, control_period)) for effect in self.actuators])
        after: list[Column] = []
        flags: list[Scalar] = []
        for effect, part in zip(self.actuators, parts, strict=True):
            given, kept = effect.apply(torque, part, control_period)
            if effect.flag is not None:
                flags.append(differs(torque, given))
            torque = given
            after.append(kept)
        return torque, Column(x for kept in after for x in kept), Column(flags)

    def measured(
        self, p: Column, v: Column, noise: Column, memory: Column, control_period: float
    ) -> tuple[Column, Column, Column]:
        """The positions (r,), rad (m if prismatic), and velocities (r,), rad/s (m/s), of r joints as all sensor effects
        together measure them, and the effects' internal state (h,) after the measurement.

        `p` and `v` (r,), in the same units, are the true ones, of the motors where encoders sit on these (this object's
        property `senses_motors`); `memory` (h,) is the effects' internal state before the measurement, one effect after
        the other; `noise` (2r,) has standard normal numbers (unitless), the positions' first, each effect getting the
        same ones; `control_period` is in s. Vectors are Columns of scalars of any kind: floats, arrays, or symbols to
        be compiled. Raises `InputError` for settings that do not fit r joints, `ValueError`, with filtered differences,
        for an internal state that is too short and, with encoders, for noise of another length.
        """
        still = np.zeros(len(p))
        parts = _split(memory, [len(effect.initial_state(still, still, control_period)) for effect in self.sensors])
        after: list[Column] = []
        for effect, part in zip(self.sensors, parts, strict=True):
            p, v, kept = effect.measure(p, v, noise, part, control_period)
            after.append(kept)
        return p, v, Column(x for kept in after for x in kept)


def differs(asked: Column, given: Column) -> Scalar:
    """Flag, a scalar, of a torque that was changed: 1 where any of r joints was `given` another torque than `asked`,
    else 0. Both are Columns (r,), N m (N if prismatic): vectors of scalars of any kind (floats, arrays, or symbols to
    be compiled). Raises `ValueError` for columns of unlike lengths."""
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
    """The `effects`, a list or another iterable in any order, as a tuple in that order. The elements are not checked.
    Raises `InputError` where `effects` is not iterable, such as one effect alone."""
    if not isinstance(effects, Iterable):
        raise InputError(f"effects: expected several, such as [ControlDelay(2)], got {effects!r}")
    return tuple(effects)


def _validate_single(chain: list[ActuatorEffect | SensorEffect | ElasticJoints]) -> None:
    kinds = [type(effect) for effect in chain]
    for kind in kinds:
        if kinds.count(kind) > 1:
            raise InputError(f"effects: {kind.__name__} is given {kinds.count(kind)} times, expected once")
