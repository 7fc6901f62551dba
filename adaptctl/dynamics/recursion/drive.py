"""Drive terms of the equations of motion: rotors, friction and springs."""

from __future__ import annotations

from typing import NamedTuple

from adaptctl.description.drive import DriveParameter
from adaptctl.scalars import Column, Scalar, cos, sin, sqrt

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


def spring(kind: DriveParameter, q: Scalar) -> Scalar:
    """Torque of a position per unit of its parameter."""
    match kind:
        case DriveParameter.SINE:
            return sin(q)
        case DriveParameter.COSINE:
            return cos(q)
        case DriveParameter.SINE_2:
            return 2.0 * sin(q) * cos(q)
        case DriveParameter.COSINE_2:
            return 1.0 - 2.0 * sin(q) * sin(q)
    return q


def stored(kind: DriveParameter, q: Scalar) -> Scalar:
    """Energy that `spring` stores at a position, its integral."""
    match kind:
        case DriveParameter.SINE:
            return -cos(q)
        case DriveParameter.COSINE:
            return sin(q)
        case DriveParameter.SINE_2:
            return sin(q) * sin(q)
        case DriveParameter.COSINE_2:
            return sin(q) * cos(q)
    return 0.5 * q * q


class DriveTerm(NamedTuple):
    """Rotor inertia, friction or spring term, linear in its parameter."""

    arms: tuple[tuple[int, float], ...]
    kind: DriveParameter

    @property
    def joint(self) -> int:
        """Index of the drive's joint."""
        return self.arms[0][0]

    def speed(self, v: Column) -> Scalar:
        """Speed of the shaft, its acceleration from a, or its position from p."""
        (own, _), *others = self.arms
        return sum((ratio * v[joint] for joint, ratio in others), v[own])

    def energy(self, v: Column) -> Scalar:
        """Kinetic energy in J per unit of the parameter."""
        s = self.speed(v)
        return 0.5 * s * s if self.kind.is_rotor else 0.0

    def potential(self, p: Column) -> Scalar:
        """Energy in J stored at a position, per unit of the parameter."""
        if self.kind is DriveParameter.OFFSET:
            return self.speed(p)
        return stored(self.kind, p[self.joint]) if self.kind.is_spring else 0.0

    def torque(self, p: Column, v: Column, a: Column) -> Scalar:
        """Torque at the shaft, of springs at the joint, per unit of the parameter."""
        if self.kind.is_spring:
            return spring(self.kind, p[self.joint])
        return self.speed(a) if self.kind.is_rotor else friction(self.kind, self.speed(v))

    def damping(self, v: Column) -> Scalar:
        """Friction torque divided by velocity, per unit of the parameter."""
        if not self.kind.is_friction or self.kind is DriveParameter.OFFSET:
            return 0.0
        return 1.0 if self.kind is DriveParameter.VISCOUS else 1.0 / _smoothed(self.kind, self.speed(v))

    def on_joints(self, share: Scalar) -> list[tuple[int, Scalar]]:
        """Pairs (joint index, torque) of a shaft torque."""
        return [(joint, share if ratio == 1.0 else ratio * share) for joint, ratio in self.arms]
