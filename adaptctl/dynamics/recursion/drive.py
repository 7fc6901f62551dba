"""Terms of joints' drives in the equations of motion."""

from __future__ import annotations

from typing import NamedTuple

from adaptctl.description.drive import DriveParameter
from adaptctl.scalars import Column, Scalar, sqrt

SLOW = 0.01
"""Speed (rad/s, m/s) below which Coulomb friction fades: a step would stop every integrator."""
STRIBECK_SPEED = 0.1
"""Speed (rad/s, m/s) at which half of Stribeck's excess of static friction is gone."""


def friction(kind: DriveParameter, s: Scalar, stribeck_speed: float = STRIBECK_SPEED) -> Scalar:
    """Friction torque, N m (N if prismatic), of one kind and per unit of its parameter at a speed s, rad/s (m/s)."""
    match kind:
        case DriveParameter.VISCOUS:
            return s
        case DriveParameter.OFFSET:
            return 1.0
    return s / _smoothed(kind, s, stribeck_speed)


def _smoothed(kind: DriveParameter, s: Scalar, stribeck_speed: float = STRIBECK_SPEED) -> Scalar:
    """The speed that friction's curve divides the shaft's by, never zero."""
    size = sqrt(s * s + SLOW * SLOW)
    match kind:
        case DriveParameter.SQUARE_ROOT:
            return sqrt(size)
        case DriveParameter.STRIBECK:
            return size * (1.0 + s * s * (1.0 / stribeck_speed**2))
    return size


class DriveTerm(NamedTuple):
    """One term (rotor inertia or a kind of friction) of a joint's drive, whose energy and torque are linear in its
    parameter.

    `arms` has pairs (zero-based joint index, ratio) of the joints that the drive's shaft turns with, its own first with
    ratio 1: the shaft's speed is the sum of their velocities times the ratios. `kind` is a `DriveParameter`: the
    rotor's inertia, or viscous, Coulomb, square-root, Stribeck or constant (offset) friction. Nothing is checked.
    """

    arms: tuple[tuple[int, float], ...]
    kind: DriveParameter

    @property
    def joint(self) -> int:
        """Zero-based index, among the spanning tree's n joints, of the joint that the drive is on."""
        return self.arms[0][0]

    def speed(self, v: Column) -> Scalar:
        """Speed of the drive's shaft, at velocities v (n,) of the tree's joints."""
        (own, _), *others = self.arms
        return sum((ratio * v[joint] for joint, ratio in others), v[own])

    def energy(self, v: Column) -> Scalar:
        """Kinetic energy in J per unit of the term's parameter at velocities `v` (n,) of the tree's joints."""
        s = self.speed(v)
        return 0.0 if self.kind.is_friction else 0.5 * s * s

    def torque(self, v: Column, a: Column) -> Scalar:
        """Torque about its shaft that the drive must exert against the term, N m (N if prismatic), per unit of the
        term's parameter, at velocities `v`, rad/s (m/s), and accelerations `a`, rad/s^2 (m/s^2), both (n,), of the
        spanning tree's n joints.

        It is the shaft's acceleration for a rotor's inertia, else `friction` at the shaft's speed. Arguments are not
        checked: too short a v or a raises `IndexError` where it is read.
        """
        return friction(self.kind, self.speed(v)) if self.kind.is_friction else self.speed(a)

    def damping(self, v: Column) -> Scalar:
        """Secant of the term's friction curve per unit of its parameter."""
        match self.kind:
            case DriveParameter.VISCOUS:
                return 1.0
            case DriveParameter.ROTOR_INERTIA | DriveParameter.OFFSET:
                return 0.0
        return 1.0 / _smoothed(self.kind, self.speed(v))

    def on_joints(self, share: Scalar) -> list[tuple[int, Scalar]]:
        """Torques on the joints that a drive's shaft turns with, as pairs (zero-based joint index, torque), for a
        torque about the shaft, `share`, N m (N if prismatic). Each is that torque times the joint's ratio, shaft speed
        over joint speed. Inertias and other quantities about the shaft are distributed by the same ratios, in the unit
        of `share`. Nothing is checked."""
        return [(joint, share if ratio == 1.0 else ratio * share) for joint, ratio in self.arms]
