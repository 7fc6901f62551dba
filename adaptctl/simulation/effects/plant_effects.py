"""All effects of a plant."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError, shown
from adaptctl.scalars import Column, Scalar, absolute, maximum, where
from adaptctl.simulation.effects.effect import ActuatorEffect, Effect, JointEffect, LoadEffect, SensorEffect
from adaptctl.simulation.effects.joints import MOTOR, ElasticJoints

KINDS = (ActuatorEffect, SensorEffect, JointEffect, LoadEffect, ElasticJoints)
"""base classes that a plant accepts"""


@dataclass(frozen=True)
class PlantEffects:
    """
    Effects of one plant, sorted by where they act.

    Parameters
    ----------
    actuators : tuple of ActuatorEffect, default ()
        Effects on torques, in the order in which these pass: delay, limit, rate limit, lag.
    sensors : tuple of SensorEffect, default ()
        Effects on measurements, in the order in which these pass: encoders, then velocities from positions.
    joints : tuple of JointEffect, default ()
        Torques in the joints, such as friction.
    loads : tuple of LoadEffect, default ()
        Changes of the inertial parameters, such as payloads.
    elastic : ElasticJoints, optional
        Springs of elastic joints. Default: rigid joints.

    Examples
    --------
    >>> from adaptctl.simulation.effects import ActuatorLag, ControlDelay, PlantEffects
    >>> [type(effect).__name__ for effect in PlantEffects.of([ActuatorLag(0.01), ControlDelay(1)]).actuators]
    ['ControlDelay', 'ActuatorLag']
    """

    actuators: tuple[ActuatorEffect, ...] = ()
    sensors: tuple[SensorEffect, ...] = ()
    joints: tuple[JointEffect, ...] = ()
    loads: tuple[LoadEffect, ...] = ()
    elastic: ElasticJoints | None = None

    @classmethod
    def of(cls, effects: Iterable[Effect]) -> PlantEffects:
        """
        Sort effects by where they act.

        Parameters
        ----------
        effects : iterable of Effect
            Effects in any order.

        Returns
        -------
        PlantEffects
            The effects, sorted.

        Raises
        ------
        InputError
            If an element is no such effect, or two actuator effects, sensor effects or elastic joints are of one class.
        """
        given = listed(effects)
        for effect in given:
            if not isinstance(effect, Effect):
                raise InputError(f"effects: expected plant effects, such as ControlDelay(2), got {shown(effect)}")
            if not isinstance(effect, KINDS):
                names = ", ".join(kind.__name__ for kind in KINDS[:3])
                raise InputError(f"effects: expected effects derived from {names} or LoadEffect, got {shown(effect)}")
        joints = tuple(e for e in given if isinstance(e, JointEffect))
        single = [e for e in given if isinstance(e, ActuatorEffect | SensorEffect | ElasticJoints)]
        _validate_single(single + [e for e in joints if e.has_state])
        return cls(
            tuple(sorted((e for e in given if isinstance(e, ActuatorEffect)), key=_rank)),
            tuple(sorted((e for e in given if isinstance(e, SensorEffect)), key=_rank)),
            joints,
            tuple(e for e in given if isinstance(e, LoadEffect)),
            next((e for e in given if isinstance(e, ElasticJoints)), None),
        )

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """
        Raise an error where an effect does not fit a plant.

        Parameters
        ----------
        dof : int
            Number r of joints.
        links : tuple of str
            Names of the links with ten inertial parameters each.
        control_period : float
            Control period in s.

        Raises
        ------
        InputError
            If a setting is out of range or has not one number or r, or a filter's cutoff is too high.
        NotFoundError
            If a payload's link is not among `links`.
        """
        elastic = () if self.elastic is None else (self.elastic,)
        for effect in (*self.actuators, *self.sensors, *self.joints, *self.loads, *elastic):
            effect.validate(dof, links, control_period)

    @property
    def senses_motors(self) -> bool:
        """True if encoders are on the motors."""
        return self.elastic is not None and self.elastic.encoders == MOTOR

    def friction_size(self, dof: int) -> int:
        """
        Return the number of states of joint effects, such as deflections of bristles.

        Parameters
        ----------
        dof : int
            Number r of joints.

        Returns
        -------
        int
            Number r for each effect that has a state.
        """
        return dof * sum(one.has_state for one in self.joints)

    def moved_size(self, dof: int) -> int:
        """
        Return the number of the drives' states that move with the joints.

        Parameters
        ----------
        dof : int
            Number r of joints.

        Returns
        -------
        int
            Number of states of joint effects, and of positions and velocities of motors behind springs.
        """
        return self.friction_size(dof) + (2 * dof if self.elastic is not None else 0)

    @property
    def flags(self) -> tuple[str, ...]:
        """Names of the actuator effects' flags."""
        return tuple(effect.flag for effect in self.actuators if effect.flag is not None)

    def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
        """
        Return the parameters with all loads added.

        Parameters
        ----------
        parameters : ndarray
            Inertial and friction parameters (..., P) without loads, SI units.
        links : tuple of str
            Names of the links with ten inertial parameters each, in their order.
        time : float
            Time in s.

        Returns
        -------
        ndarray
            Parameters (..., P) in SI units.

        Raises
        ------
        InputError
            If there are too few parameters.
        NotFoundError
            If a payload's link is not among `links`.
        """
        for load in self.loads:
            parameters = load.loaded(parameters, links, time)
        return parameters

    def drive_memory(self, torque: Array, control_period: float) -> Array:
        """
        Return the initial internal states of all actuator effects.

        Parameters
        ----------
        torque : ndarray
            Torque (..., r) that held the joints, N m (N if prismatic).
        control_period : float
            Control period in s.

        Returns
        -------
        ndarray
            Internal states (..., h) in units of the effects, one effect after the other.

        Examples
        --------
        >>> from adaptctl.simulation.effects import ActuatorLag
        >>> from adaptctl.simulation.effects.plant_effects import PlantEffects
        >>> PlantEffects.of([ActuatorLag(0.01)]).drive_memory(np.zeros(2), period).shape
        (2,)
        """
        return _joined((effect.initial_state(torque, control_period) for effect in self.actuators), torque.shape[:-1])

    def sensor_memory(self, p: Array, v: Array, control_period: float) -> Array:
        """
        Return the initial internal states of all sensor effects.

        Parameters
        ----------
        p : ndarray
            Positions (..., r) in rad (m if prismatic).
        v : ndarray
            Velocities (..., r) in rad/s (m/s).
        control_period : float
            Control period in s.

        Returns
        -------
        ndarray
            Internal states (..., h) in units of the effects, one effect after the other.
        """
        return _joined((effect.initial_state(p, v, control_period) for effect in self.sensors), p.shape[:-1])

    def driven(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column, Column]:
        """
        Return the torque after all actuator effects.

        Parameters
        ----------
        torque : Column
            Commanded torque (r,) in N m (N if prismatic).
        memory : Column
            Internal states (h,) before the period, in SI units.
        control_period : float
            Control period in s.

        Returns
        -------
        tuple of Column
            Torque (r,) in N m (N), internal states (h,) and flags (k,), 1 where an effect changed a torque.
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
        """
        Return the measurements after all sensor effects.

        Parameters
        ----------
        p : Column
            True positions (r,), rad (m if prismatic); the motors' where encoders sit on these.
        v : Column
            True velocities (r,), likewise, rad/s (m/s).
        noise : Column
            Standard normal numbers (2r,) without a unit, the positions' first.
        memory : Column
            Internal states (h,) before the measurement, in SI units.
        control_period : float
            Control period in s.

        Returns
        -------
        tuple of Column
            Positions (r,) in rad (m), velocities (r,) in rad/s (m/s) and internal states (h,).
        """
        still = np.zeros(len(p))
        parts = _split(memory, [len(effect.initial_state(still, still, control_period)) for effect in self.sensors])
        after: list[Column] = []
        for effect, part in zip(self.sensors, parts, strict=True):
            p, v, kept = effect.measure(p, v, noise, part, control_period)
            after.append(kept)
        return p, v, Column(x for kept in after for x in kept)


def differs(asked: Column, given: Column) -> Scalar:
    """Flag, 1 where any torque differs from the given one."""
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
    """Effects as a tuple, else `InputError`."""
    if isinstance(effects, str) or not isinstance(effects, Iterable):
        raise InputError(f"effects: expected a sequence, such as [ControlDelay(2)], got {shown(effects)}")
    return tuple(effects)


def _validate_single(chain: list[Effect]) -> None:
    kinds = [type(effect) for effect in chain]
    for kind in kinds:
        if kinds.count(kind) > 1:
            raise InputError(f"effects: {kind.__name__} is given {kinds.count(kind)} times, expected once")
