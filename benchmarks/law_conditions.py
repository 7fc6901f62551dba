"""Conditions under which laws are compared: effects on a plant, and its parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.scalars import Column, where
from adaptctl.simulation.effects import (
    ControlDelay,
    ElasticJoints,
    Encoder,
    FilteredDifferences,
    Friction,
    PayloadHeld,
)
from adaptctl.simulation.effects.effect import ActuatorEffect, Effect
from adaptctl.tuning import Tuning
from adaptctl.tuning.verification import scaled_links

FILTER = 60.0
"""rad/s of the filter of encoder differences"""
PUSHED, RELEASED, DROPPED = 6.0, 11.0, 8.0
"""s at which a push begins and ends, and a payload is dropped"""
RISE = 2.0
"""s in which a ramped push rises"""


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


class Scene(NamedTuple):
    """Arm with friction parameters, and its tuning."""

    mechanism: Mechanism
    tuning: Tuning

    @property
    def friction(self) -> Array:
        """Viscous and Coulomb friction that differ by joint, at most 5 % of damping and limit, (2, r)."""
        damping = self.tuning.gains.damping
        return 0.05 * np.array([damping, np.minimum(self.tuning.torque_limits, damping)])

    @property
    def rubbing(self) -> Array:
        """Parameters (P,) with that friction."""
        found, names = self.mechanism.inertial_parameters.copy(), list(self.mechanism.parameter_names)
        for kind, values in zip(("viscous", "coulomb"), self.friction, strict=True):
            for joint, value in zip(self.mechanism.primary_joints, values, strict=True):
                found[names.index(f"{joint.name}.{kind}")] = value
        return found

    @property
    def mass(self) -> float:
        """Mass of the arm in kg."""
        named = zip(self.mechanism.parameter_names, self.mechanism.inertial_parameters, strict=True)
        return float(sum(value for name, value in named if name.endswith(".m")))

    def pushed(self, share: float, joint: int | None = None) -> tuple[float, ...]:
        """Torques of a share of the limits, of one joint or all."""
        torques = share * self.tuning.torque_limits
        return tuple(np.where(np.arange(len(torques)) == joint, torques, 0.0) if joint is not None else torques)


@dataclass(frozen=True)
class PlantCondition:
    """Effects in a scene, true parameters (P,) by seed, and the control period in s, if not 1 ms."""

    effects: Callable[[Scene], tuple[Effect, ...]] = lambda scene: ()
    parameters: Callable[[Scene, int], Array] = lambda scene, seed: scene.mechanism.inertial_parameters
    control_period: float = 1e-3


def _encoder(bits: int) -> tuple[Effect, ...]:
    return Encoder(resolution=2.0 * np.pi / 2**bits), FilteredDifferences(FILTER)


def _elastic(scene: Scene, encoders: str) -> tuple[Effect, ...]:
    """Springs of 10,000 N m/rad, with a fifth of the inertia that the damping is for on the motors' side."""
    inertia = 0.4 * scene.tuning.gains.damping * scene.tuning.control_period
    return (ElasticJoints(1e4, damping=2.0 * np.sqrt(1e4 * inertia) * 0.1, motor_inertia=inertia, encoders=encoders),)


CONDITIONS = {
    "clean": PlantCondition(),
    "noise": PlantCondition(lambda s: (Encoder(velocity_noise=0.03),)),
    "encoder-12": PlantCondition(lambda s: _encoder(12)),
    "encoder-16-200-hz": PlantCondition(lambda s: _encoder(16), control_period=5e-3),
    "clean-500-hz": PlantCondition(control_period=2e-3),
    "late": PlantCondition(lambda s: (ControlDelay(1),)),
    "links-wrong": PlantCondition(parameters=lambda s, seed: scaled_links(s.mechanism, 0.3, seed)),
    "friction": PlantCondition(parameters=lambda s, seed: s.rubbing),
    "stribeck": PlantCondition(lambda s: (Friction(0.0, 0.0, 0.5 * s.friction[1]),), lambda s, seed: s.rubbing),
    "dropped": PlantCondition(lambda s: (PayloadHeld(max(0.05 * s.mass, 0.02), stop=DROPPED),)),
    "push": PlantCondition(lambda s: (Push(s.pushed(0.1, min(1, s.mechanism.dof - 1))),)),
    "push-ramped": PlantCondition(lambda s: (Push(s.pushed(0.1, min(1, s.mechanism.dof - 1)), RISE),)),
    "push-all": PlantCondition(lambda s: (Push(s.pushed(0.05)),)),
    "elastic-motor": PlantCondition(lambda s: _elastic(s, "motor")),
    "elastic-link": PlantCondition(lambda s: _elastic(s, "link")),
}
