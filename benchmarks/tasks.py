"""The arms whose control is timed: what they follow, how, and from where."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

import adaptctl
from adaptctl.arrays import Array
from adaptctl.control import Gains, ReferencePoint

PERIOD = 1e-3
"""s, of control and of integration"""

BANDWIDTH = 8.0


@dataclass(frozen=True, eq=False)
class Task:
    """An arm that learns to follow sinusoids, from knowing nothing."""

    model: adaptctl.ReducedModel
    damping: Array
    gain: Array
    reference: adaptctl.Sinusoids

    @property
    def arm(self) -> adaptctl.Mechanism:
        """The true arm."""
        return self.model.mechanism

    @cached_property
    def controller(self) -> adaptctl.SlotineLi:
        """Slotine and Li's, with the gradient law."""
        return adaptctl.SlotineLi(
            self.model, np.full(self.arm.dof, BANDWIDTH), self.damping, self.gain, control_period=PERIOD
        )

    def references(self, steps: int) -> ReferencePoint:
        """The reference (steps, r) at each tick."""
        return self.reference(PERIOD * np.arange(steps))

    def starts(self, arms: int) -> tuple[Array, Array]:
        """Positions and velocities (arms, r) near the reference's beginning."""
        rng, r = np.random.default_rng(arms), self.arm.dof
        return self.reference.center + rng.uniform(-0.05, 0.05, (arms, r)), rng.uniform(-0.1, 0.1, (arms, r))


@cache
def puma() -> Task:
    """The PUMA 560 with consistent inertias, and 36 parameters to learn."""
    return _task(adaptctl.load("puma560_measured"), _PUMA_DAMPING, 6e-4, _PUMA_REFERENCE)


@cache
def puma_at_joints() -> Task:
    """The same arm with its links' frames at their joints, where Pinocchio has them: the same parameters to learn."""
    model = adaptctl.load("puma560_measured").to_pinocchio()
    return _task(adaptctl.Mechanism.from_pinocchio(model), _PUMA_DAMPING, 6e-4, _PUMA_REFERENCE)


@cache
def semi_direct_drive() -> Task:
    """The semi-direct-drive arm with its loop."""
    arm = adaptctl.load("semi_direct_drive")
    middle = np.array([0.0, -1.57, -3.14])
    return _task(arm, np.full(3, 60.0), 0.06, adaptctl.Sinusoids(middle, np.full(3, 0.3), np.full(3, 0.2)))


# Without its motors the wrist has so little inertia that a period of 1 ms carries little damping and slow learning.
_PUMA_DAMPING = np.array([30.0, 50.0, 20.0, 0.25, 0.12, 0.05])
_PUMA_REFERENCE = adaptctl.Sinusoids(
    center=np.array([0.0, -0.6, 0.8, 0.0, 0.5, 0.0]),
    amplitude=np.full(6, 0.4),
    frequency=np.array([0.1, 0.125, 0.15, 0.175, 0.2, 0.225]),
)


def _task(arm: adaptctl.Mechanism, damping: Array, rate: float, reference: adaptctl.Sinusoids) -> Task:
    model = adaptctl.ReducedModel(arm)
    gains = Gains(np.full(arm.dof, BANDWIDTH), damping)
    return Task(
        model, damping, adaptctl.adaptation_gain(model, gain_scale=rate, gains=gains, control_period=PERIOD), reference
    )
