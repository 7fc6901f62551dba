"""Conditions of a contest: effects on a plant, its true parameters, period and reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.contest.scene import Scene
from adaptctl.control import StoppedReference
from adaptctl.control.controller import Reference
from adaptctl.description.drive import Drive
from adaptctl.description.link import Link
from adaptctl.dynamics import Mechanism
from adaptctl.scalars import Column, where
from adaptctl.simulation import Plant
from adaptctl.simulation.effects import (
    ControlDelay,
    ElasticJoints,
    Encoder,
    FilteredDifferences,
    Friction,
    LuGre,
    PayloadHeld,
)
from adaptctl.simulation.effects.effect import ActuatorEffect, Effect
from adaptctl.simulation.effects.plant_effects import PlantEffects
from adaptctl.simulation.integrator import integration
from adaptctl.simulation.transmission import Transmission
from adaptctl.tuning.verification import scaled_links

FILTER = 60.0
"""Hz, cutoff of the filter of encoder differences"""
PUSHED, RELEASED, DROPPED = 6.0, 11.0, 8.0
"""s at which a push begins and ends, and a payload is dropped"""
RISE = 2.0
"""s in which a ramped push rises"""
DEFLECTION = 2e-4
"""rad (m) by which Coulomb friction bends bristles"""


@dataclass(frozen=True)
class Push(ActuatorEffect):
    """Constant torques (r,) in N m on the joints between two times in s, after a linear rise."""

    rank: ClassVar[int] = 9

    torque: tuple[float, ...]
    rise: float = 1e-6

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Accept any plant."""

    def initial_state(self, torque: Array, control_period: float) -> Array:
        """Time of an arm in s."""
        return np.zeros((*torque.shape[:-1], 1))

    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """Torque with the push, and the time after the period."""
        t = memory[0]
        risen = (t - PUSHED) / self.rise
        level = where(t < PUSHED, 0.0, where(t < RELEASED, where(risen < 1.0, risen, 1.0), 0.0))
        return torque + Column(level * x for x in self.torque), Column((t + control_period,))


@dataclass(frozen=True)
class PlantCondition:
    """Effects in a scene, true parameters (P,) by seed, control period in s, limits, halt, end of an event, and whether
    other engines can have it."""

    meaning: str
    effects: Callable[[Scene], tuple[Effect, ...]] = lambda scene: ()
    parameters: Callable[[Scene, int], Array] = lambda scene, seed: scene.mechanism.inertial_parameters
    control_period: float = 1e-3
    limit_share: float = 1.0
    halt: float = 0.0
    event: float | None = None
    foreign: bool = True

    def reference(self, followed: Reference) -> Reference:
        """Reference with the halt, if there is one."""
        return StoppedReference(followed, self.halt) if self.halt else followed

    def plant(self, scene: Scene) -> Plant:
        """Plant of an arm under this condition."""
        effects, tuning = self.effects(scene), scene.tuning
        found = PlantEffects.of(effects)
        springs = None if found.elastic is None else Transmission.of(scene.mechanism, found.elastic)
        steps = integration(self._rubbing(scene), found.joints, tuning.control_period, None, springs)
        limits = self.limit_share * tuning.torque_limits
        return Plant(scene.mechanism, tuning.control_period, *steps, torque_limits=limits, effects=effects)

    def loaded(self, scene: Scene, parameters: Array, time: float) -> Array:
        """True parameters (P,) at a time in s, with the payloads of then."""
        return PlantEffects.of(self.effects(scene)).loaded(parameters, scene.mechanism.description.body_names, time)

    def _rubbing(self, scene: Scene) -> Mechanism:
        """Arm with the friction that it has under this condition."""
        values = dict(zip(scene.mechanism.parameter_names, self.parameters(scene, 0), strict=True))

        def drive(link: Link) -> Drive:
            named = {kind: values.get(f"{link.joint.name}.{kind}") for kind in ("viscous", "coulomb")}
            return replace(link.joint.drive, **{kind: x for kind, x in named.items() if x is not None})

        return scene.mechanism.with_drives([drive(link) for link in scene.mechanism.links])


def _encoder(bits: int) -> tuple[Effect, ...]:
    return Encoder(resolution=2.0 * np.pi / 2**bits), FilteredDifferences(FILTER)


def _elastic(scene: Scene, encoders: str) -> tuple[Effect, ...]:
    """Springs of 10,000 N m/rad, with a fifth of the inertia that the damping is for on the motors' side."""
    inertia = 0.4 * scene.tuning.gains.damping * scene.tuning.control_period
    return (ElasticJoints(1e4, damping=2.0 * np.sqrt(1e4 * inertia) * 0.1, motor_inertia=inertia, encoders=encoders),)


def _lugre(viscous: Array, coulomb: Array) -> Effect:
    return LuGre(coulomb, coulomb / DEFLECTION, stribeck=0.5 * coulomb, viscous=viscous)


def _second(scene: Scene) -> int:
    return min(1, scene.mechanism.dof - 1)


CONDITIONS = {
    "clean": PlantCondition("1 kHz, nothing else"),
    "noise": PlantCondition("velocity noise of 0.03 rad/s", lambda s: (Encoder(velocity_noise=0.03),), foreign=False),
    "encoder-12": PlantCondition("12-bit encoders, filtered differences", lambda s: _encoder(12), foreign=False),
    "encoder-16-200-hz": PlantCondition(
        "16-bit encoders, filtered differences, 200 Hz", lambda s: _encoder(16), control_period=5e-3, foreign=False
    ),
    "clean-500-hz": PlantCondition("500 Hz", control_period=2e-3),
    "low-rate": PlantCondition("200 Hz", control_period=5e-3),
    "late": PlantCondition("torques a control period late", lambda s: (ControlDelay(1),)),
    "links-wrong": PlantCondition(
        "each link 30 % lighter or heavier than in the file, by seed",
        parameters=lambda s, seed: scaled_links(s.mechanism, 0.3, seed),
    ),
    "friction": PlantCondition("viscous and Coulomb friction", parameters=lambda s, seed: s.rubbing),
    "stribeck": PlantCondition(
        "friction and 50 % static friction, in no model",
        lambda s: (Friction(0.0, 0.0, 0.5 * s.friction[1]),),
        lambda s, seed: s.rubbing,
        foreign=False,
    ),
    "lugre": PlantCondition(
        "LuGre friction that deflects joints by 0.2 mrad and is 50 % higher at rest, in no model",
        lambda s: (_lugre(*s.friction),),
        foreign=False,
    ),
    "saturation": PlantCondition("torque limits of 60 %", limit_share=0.6),
    "payload": PlantCondition(
        "5 % of the mass picked up at 6 s, for good",
        lambda s: (PayloadHeld(max(0.05 * s.mass, 0.02), start=PUSHED),),
        event=PUSHED,
    ),
    "dropped": PlantCondition(
        "5 % of the mass dropped at 8 s",
        lambda s: (PayloadHeld(max(0.05 * s.mass, 0.02), stop=DROPPED),),
        event=DROPPED,
    ),
    "halt": PlantCondition(
        "reference stops at 12 s, in velocity noise",
        lambda s: (Encoder(velocity_noise=0.03),),
        halt=12.0,
        foreign=False,
    ),
    "push": PlantCondition(
        "10 % of joint 2's limit pushes from 6 to 11 s", lambda s: (Push(s.pushed(0.1, _second(s))),), event=RELEASED
    ),
    "push-ramped": PlantCondition(
        "the same push, rising for 2 s", lambda s: (Push(s.pushed(0.1, _second(s)), RISE),), event=RELEASED
    ),
    "push-all": PlantCondition(
        "5 % of all limits pushes from 6 to 11 s", lambda s: (Push(s.pushed(0.05)),), event=RELEASED
    ),
    "elastic-motor": PlantCondition(
        "springs of 10,000 N m/rad, encoders on motors", lambda s: _elastic(s, "motor"), foreign=False
    ),
    "elastic-link": PlantCondition(
        "springs of 10,000 N m/rad, encoders on links", lambda s: _elastic(s, "link"), foreign=False
    ),
}
"""Conditions by name."""
