"""Terms of joints' drives in the equations of motion."""

from __future__ import annotations

from typing import NamedTuple

from adaptctl.description.drive import DriveParameter
from adaptctl.scalars import Column, Scalar, sqrt

SLOW = 0.01
"""Speed (rad/s, m/s) below which Coulomb friction fades: a step would stop every integrator."""
STRIBECK_SPEED = 0.1
"""Speed (rad/s, m/s) at which half of Stribeck's excess of static friction is gone."""


class DriveTerm(NamedTuple):
    """One parameter of one drive: its share of energy and torque per unit.

    `arms` are the joints that the drive's shaft turns with, its own first, and the ratios of their speeds.
    """

    arms: tuple[tuple[int, float], ...]
    kind: DriveParameter

    @property
    def joint(self) -> int:
        """Index of the joint that the shaft drives."""
        return self.arms[0][0]

    def speed(self, v: Column) -> Scalar:
        """The shaft's speed for joint velocities v (r,), or its acceleration for accelerations."""
        (own, _), *others = self.arms
        return sum((ratio * v[joint] for joint, ratio in others), v[own])

    def energy(self, v: Column) -> Scalar:
        """Energy (J per unit of the parameter): s^2/2 of a rotor at speed s, zero of friction."""
        s = self.speed(v)
        return 0.0 if self.kind.is_friction else 0.5 * s * s

    def torque(self, v: Column, a: Column) -> Scalar:
        """Torque about the shaft per unit of the parameter: its acceleration for a rotor, else friction's law at its
        speed, the sign smoothed."""
        match self.kind:
            case DriveParameter.ROTOR_INERTIA:
                return self.speed(a)
            case DriveParameter.VISCOUS:
                return self.speed(v)
            case DriveParameter.OFFSET:
                return 1.0
        return self.speed(v) / self._smoothed(v)

    def damping(self, v: Column) -> Scalar:
        """Friction about the shaft over its speed, the secant of its curve; 0 for what does not depend on speed."""
        match self.kind:
            case DriveParameter.VISCOUS:
                return 1.0
            case DriveParameter.ROTOR_INERTIA | DriveParameter.OFFSET:
                return 0.0
        return 1.0 / self._smoothed(v)

    def _smoothed(self, v: Column) -> Scalar:
        """The speed that friction's curve divides the shaft's by, never zero."""
        s = self.speed(v)
        size = sqrt(s * s + SLOW * SLOW)
        match self.kind:
            case DriveParameter.SQUARE_ROOT:
                return sqrt(size)
            case DriveParameter.STRIBECK:
                return size * (1.0 + s * s * (1.0 / STRIBECK_SPEED**2))
        return size

    def on_joints(self, share: Scalar) -> list[tuple[int, Scalar]]:
        """Pairs of a joint and its torque, for a torque about the shaft."""
        return [(joint, share if ratio == 1.0 else ratio * share) for joint, ratio in self.arms]
