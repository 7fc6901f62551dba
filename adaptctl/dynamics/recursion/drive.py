"""What a joint's drive adds to the equations of motion."""

from __future__ import annotations

from dataclasses import dataclass

from adaptctl.description.drive import DriveParameter
from adaptctl.scalars import Scalar, sqrt

SLOW = 0.01
"""Speed (rad/s, m/s) below which Coulomb friction fades: a step would stop every integrator."""


@dataclass(frozen=True)
class DriveTerm:
    """One parameter of one joint's drive: its share of energy and torque per unit."""

    joint: int
    kind: DriveParameter

    def energy(self, v: Scalar) -> Scalar:
        """v^2/2 for a rotor, nothing for friction."""
        return 0.0 if self.kind.is_friction else 0.5 * v * v

    def damping(self, v: Scalar) -> Scalar:
        """Friction at v over v, the secant of its curve: 1 for viscous friction; 0 for a rotor."""
        if not self.kind.is_friction:
            return 0.0
        return 1.0 if self.kind is DriveParameter.VISCOUS else 1.0 / sqrt(v * v + SLOW * SLOW)

    def torque(self, v: Scalar, a: Scalar) -> Scalar:
        """a for a rotor, v for viscous friction, the sign of v, smoothed, for Coulomb friction."""
        if self.kind is DriveParameter.ROTOR_INERTIA:
            return a
        return v if self.kind is DriveParameter.VISCOUS else v / sqrt(v * v + SLOW * SLOW)
