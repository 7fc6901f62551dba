"""Drive terms of the equations of motion."""

from __future__ import annotations

from typing import NamedTuple

from adaptctl.description.drive import DriveParameter
from adaptctl.scalars import Column, Scalar, sqrt

COULOMB_SMOOTHING_SPEED = 0.01
"""Speed (rad/s, m/s) below which Coulomb friction is smoothed."""
STRIBECK_SPEED = 0.1
"""Speed (rad/s, m/s) at which Stribeck friction has halved."""


def friction(kind: DriveParameter, s: Scalar, stribeck_speed: float = STRIBECK_SPEED) -> Scalar:
    """Friction torque per unit of its parameter."""
    match kind:
        case DriveParameter.VISCOUS:
            return s
        case DriveParameter.OFFSET:
            return 1.0
    return s / _smoothed(kind, s, stribeck_speed)


def _smoothed(kind: DriveParameter, s: Scalar, stribeck_speed: float = STRIBECK_SPEED) -> Scalar:
    size = sqrt(s * s + COULOMB_SMOOTHING_SPEED * COULOMB_SMOOTHING_SPEED)
    match kind:
        case DriveParameter.SQUARE_ROOT:
            return sqrt(size)
        case DriveParameter.STRIBECK:
            return size * (1.0 + s * s * (1.0 / stribeck_speed**2))
    return size


class DriveTerm(NamedTuple):
    """Rotor inertia or friction term, linear in its parameter."""

    arms: tuple[tuple[int, float], ...]
    kind: DriveParameter

    @property
    def joint(self) -> int:
        """Index of the drive's joint."""
        return self.arms[0][0]

    def speed(self, v: Column) -> Scalar:
        """Speed (or acceleration) of the shaft."""
        (own, _), *others = self.arms
        return sum((ratio * v[joint] for joint, ratio in others), v[own])

    def energy(self, v: Column) -> Scalar:
        """Kinetic energy in J per unit of the parameter."""
        s = self.speed(v)
        return 0.0 if self.kind.is_friction else 0.5 * s * s

    def torque(self, v: Column, a: Column) -> Scalar:
        """Torque at the shaft per unit of the parameter."""
        return friction(self.kind, self.speed(v)) if self.kind.is_friction else self.speed(a)

    def damping(self, v: Column) -> Scalar:
        """Friction torque divided by velocity, per unit of the parameter."""
        match self.kind:
            case DriveParameter.VISCOUS:
                return 1.0
            case DriveParameter.ROTOR_INERTIA | DriveParameter.OFFSET:
                return 0.0
        return 1.0 / _smoothed(self.kind, self.speed(v))

    def on_joints(self, share: Scalar) -> list[tuple[int, Scalar]]:
        """Pairs (joint index, torque) of a shaft torque."""
        return [(joint, share if ratio == 1.0 else ratio * share) for joint, ratio in self.arms]
