"""Rewards for tracking."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from adaptctl.arrays import real_number
from adaptctl.errors import InputError


@dataclass(frozen=True)
class RewardWeights:
    """Weights of the reward for tracking a reference: factors of the squared errors and torques, summed over the
    joints, that are subtracted at each control period.

    `position`, per rad^2 (m^2 if prismatic) of position error; `velocity`, per (rad/s)^2 ((m/s)^2) of velocity error;
    `torque`, unitless, per square of the ratio torque/limit; `termination`, unitless, is subtracted once when an
    episode is terminated, as by an error that passes its bound. Without it a learner whose every reward is negative
    would do best by ending the episode at once. Raises `InputError` at construction for a weight that is no number,
    negative or not finite.
    """

    position: float = 1.0
    """per rad^2 (m^2) of tracking error"""
    velocity: float = 0.1
    """per (rad/s)^2 ((m/s)^2) of velocity error"""
    torque: float = 0.001
    """no unit, per square of torque over its limit"""
    termination: float = 1000.0
    """no unit, once where an episode is terminated"""

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = getattr(self, name)
            if not 0.0 <= real_number(value, f"reward weight of {name}") < np.inf:
                raise InputError(f"reward weight of {name}: expected a number of at least 0, got {value}")

    def cost(self, position: Any, velocity: Any, torque: Any) -> Any:
        """Tracking cost of a control period, unitless, without the penalty for termination: the sum of the arguments,
        each times this object's weight of the same name. The arguments are sums over the joints, `position` of squared
        position errors, rad^2 (m^2), `velocity` of squared velocity errors, (rad/s)^2 ((m/s)^2), and `torque` of
        (torque/limit)^2, unitless: scalars, or arrays that broadcast, of any kind of number. Nothing is checked."""
        return self.position * position + self.velocity * velocity + self.torque * torque
