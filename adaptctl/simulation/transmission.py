"""Springs between motors and links."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.drive import DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Scalar, column
from adaptctl.simulation.effects import ElasticJoints


class Motors(NamedTuple):
    """Positions, velocities and inertias (r,), joint side."""

    theta: Column
    w: Column
    inertia: Column


class Springs(NamedTuple):
    """Spring torque over a step, affine in the links' final velocities."""

    held: Column
    slope: Column
    v: Column
    motors: Motors
    given: Column
    dt: float

    @property
    def firm(self) -> Column:
        """Damping (r,) of the links over the step."""
        return self._share * self.motors.inertia

    @property
    def torque(self) -> Column:
        """Torque (r,) on the links at constant velocities."""
        driven = self.motors.inertia * (self.motors.w - self.v) + self.dt * (self.given - self.held)
        return self.held + self._share * driven

    def spin(self, after: Column) -> Column:
        """Mean acceleration (r,) of the motors, joint side."""
        return self._yielding * (self.given - self.held - self.slope * (self.motors.w - after))

    @property
    def _share(self) -> Column:
        return self.slope * self._yielding

    @property
    def _yielding(self) -> Column:
        return Column(1.0 / (J + self.dt * slope) for J, slope in zip(self.motors.inertia, self.slope, strict=True))


@dataclass(frozen=True, eq=False)
class Transmission:
    """Springs, dampers and motors of elastic joints."""

    stiffness: Array
    damping: Array
    inertia: Array
    rotors: tuple[int | None, ...]
    primary: tuple[int, ...]

    @classmethod
    def of(cls, mechanism: Mechanism, joints: ElasticJoints) -> Transmission:
        """Checked transmission of a mechanism."""
        description, r = mechanism.description, mechanism.dof
        if len(mechanism.inertial_parameters) < len(description.inertial_parameters):
            raise InputError(
                f"elastic joints: {mechanism.name} has constraints on its parameters: use the mechanism without them"
            )
        stiffness, damping, inertia = (joints.each(name, r) for name in ("stiffness", "damping", "motor_inertia"))
        found = cls(stiffness, damping, inertia, _rotors(mechanism), _primary(mechanism))
        motors = found.motors(column(mechanism.inertial_parameters)).of
        for joint, motor in zip(mechanism.primary_joints, motors, strict=True):
            if not motor > 0.0:
                raise InputError(
                    f"elastic joints: the motor of joint {joint.name} of {mechanism.name} has no inertia: give "
                    "motor_inertia, in kg m^2 behind the gears, or a drive with rotor_inertia"
                )
        return found

    def motors(self, parameters: Column) -> Column:
        """Motor inertias (r,) with rotors, joint side."""
        own = self.inertia.tolist()
        return Column(x if j is None else x + parameters[j] for x, j in zip(own, self.rotors, strict=True))

    def links(self, parameters: Column) -> Column:
        """Parameters (P,) with zero rotor inertias."""
        return Column(0.0 if j in self.rotors else x for j, x in enumerate(parameters))

    def springs(self, q: Column, v: Column, motors: Motors, torque: Column, dt: float) -> Springs:
        """`Springs` of an integration step of `dt` (s)."""
        half = (0.5 * dt) * column(self.stiffness)
        held = column(self.stiffness) * self._stretch(q, motors)
        return Springs(held, column(self.damping) + half, v, motors, torque, dt)

    def energy(self, q: Column, motors: Motors) -> Scalar:
        """Kinetic energy of motors plus elastic energy (J)."""
        stretch = self._stretch(q, motors)
        total: Scalar = 0.5 * (motors.w @ (motors.inertia * motors.w) + stretch @ (column(self.stiffness) * stretch))
        return total

    def _stretch(self, q: Column, motors: Motors) -> Column:
        return motors.theta - Column(q[i] for i in self.primary)

    def rates(self, mechanism: Mechanism, p: Array) -> tuple[float, float]:
        """Fastest oscillation (rad/s) and decay (1/s) at positions (k, r)."""
        own = column(mechanism.inertial_parameters)
        links = mechanism.with_parameters(np.array(self.links(own).of, dtype=np.float64))
        mass = links.mass_matrix(p)
        if not np.all(np.linalg.eigvalsh(mass)[:, 0] > 1e-12 * np.linalg.eigvalsh(mass)[:, -1]):
            raise InputError(
                f"elastic joints: {mechanism.name}: without rotors the mass matrix is singular. Behind a spring, "
                "every joint needs links with inertia"
            )
        motors = np.array(self.motors(own).of, dtype=np.float64)
        return float(np.sqrt(_fastest(mass, motors, self.stiffness))), _fastest(mass, motors, self.damping)


def _fastest(mass: Array, motors: Array, springs: Array) -> float:
    """Largest eigenvalue of springs (r,) between links M (samples, r, r) and motors (r,)."""
    r = len(motors)
    inverse, pull = np.zeros((len(mass), 2 * r, 2 * r)), np.zeros((2 * r, 2 * r))
    inverse[:, :r, :r], inverse[:, r:, r:] = np.linalg.inv(mass), np.diag(1.0 / motors)
    pull[:r, :r] = pull[r:, r:] = np.diag(springs)
    pull[:r, r:] = pull[r:, :r] = -np.diag(springs)
    return float(np.abs(np.linalg.eigvals(inverse @ pull)).max())


def _rotors(mechanism: Mechanism) -> tuple[int | None, ...]:
    """Rotor parameter of each primary joint, or None."""
    description, first = mechanism.description, 10 * len(mechanism.description.bodies)
    found: dict[int, int] = {}
    for k, (joint, kind) in enumerate(description.drive_parameters):
        if kind is DriveParameter.ROTOR_INERTIA:
            found[joint] = first + k
    for joint in found:
        if joint in description.primary and len(description.drive_coupling(joint)) > 1:
            raise InputError(
                f"elastic joints: the rotor of {description.joint_names[joint]} of {mechanism.name} is coupled to "
                "several joints, but a spring is modelled in a single joint: use the mechanism without `turns_with`"
            )
    return tuple(found.get(joint) for joint in _primary(mechanism))


def _primary(mechanism: Mechanism) -> tuple[int, ...]:
    return tuple(mechanism.description.primary)
