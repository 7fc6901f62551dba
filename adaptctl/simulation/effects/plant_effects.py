"""All effects of a plant, in the order of their places."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from adaptctl.errors import InputError
from adaptctl.simulation.effects.effect import ActuatorEffect, Effect, JointEffect, LoadEffect, SensorEffect


@dataclass(frozen=True)
class PlantEffects:
    """Effects by their places; those between controller and joint, and back, in the order of the signal's way.

    A torque is delayed, then limited, then limited in rate, then lags; positions are read by encoders, then
    velocities are found from them.
    """

    actuators: tuple[ActuatorEffect, ...] = ()
    sensors: tuple[SensorEffect, ...] = ()
    joints: tuple[JointEffect, ...] = ()
    loads: tuple[LoadEffect, ...] = ()

    @classmethod
    def of(cls, effects: Iterable[Effect] | PlantEffects) -> PlantEffects:
        """Effects, given in any order, in their places.

        Raises `InputError` for what is none, and for two of a kind in one chain.
        """
        if isinstance(effects, PlantEffects):
            return effects
        given = tuple(effects)
        for effect in given:
            if not isinstance(effect, Effect):
                raise InputError(f"effects: expected plant effects, such as ControlDelay(2), got {effect!r}")
        _require_single([e for e in given if isinstance(e, ActuatorEffect | SensorEffect)])
        return cls(
            tuple(sorted((e for e in given if isinstance(e, ActuatorEffect)), key=_rank)),
            tuple(sorted((e for e in given if isinstance(e, SensorEffect)), key=_rank)),
            tuple(e for e in given if isinstance(e, JointEffect)),
            tuple(e for e in given if isinstance(e, LoadEffect)),
        )

    def __bool__(self) -> bool:
        return bool(self.actuators or self.sensors or self.joints or self.loads)

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` where an effect does not fit."""
        for effect in (*self.actuators, *self.sensors, *self.joints, *self.loads):
            effect.require(dof, links, control_period)


def _rank(effect: Any) -> int:
    return int(effect.rank)


def _require_single(chain: list[ActuatorEffect | SensorEffect]) -> None:
    kinds = [type(effect) for effect in chain]
    for kind in kinds:
        if kinds.count(kind) > 1:
            raise InputError(f"effects: {kind.__name__} is given {kinds.count(kind)} times, expected once")
