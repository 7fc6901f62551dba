"""The springs between the motors and the links of one mechanism, over scalars of any kind."""

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
    """Motors of r elastic joints, before the springs, reflected to the joints (as seen through the gears). They have
    positions `theta`, rad (m if prismatic), velocities `w`, rad/s (m/s), and inertias `inertia`, kg m^2 (kg): Columns
    (r,), vectors of scalars of any kind (floats, arrays, or symbols to be compiled). Nothing is checked."""

    theta: Column
    w: Column
    inertia: Column


class Springs(NamedTuple):
    """Torque f (r,) of the springs and dampers of r elastic joints on their links over an integration step of `dt` (s),
    as an affine function of the links' joint velocities v_1 (r,) at the step's end: joint by joint, f = held + slope
    (w_1 - v_1), where the motor's velocity w_1 at the end follows from f.

    The fields are Columns (r,), vectors of scalars of any kind (floats, arrays, or symbols to be compiled). The motors
    have positions theta and velocities w, the links' joints p and v; the index 1 is for the end of the step. The
    springs' stretch at the end is taken to be (theta - p) + dt (u + u_1)/2, where u = w - v. The motors' equation, J
    (w_1 - w) = dt (tau - f), is solved for w_1, J being their reflected inertias and tau their torque, which leaves f
    affine in v_1. With dt = 0, f is the springs' and dampers' torque at the beginning.

    `held`, N m (N if prismatic), is f for w_1 = v_1; `slope`, N m s/rad (N s/m), is the change of f per unit of w_1 -
    v_1; `v`, rad/s (m/s), are the joint velocities at the beginning; `motors` has theta, w and J then; `given`, N m
    (N), is tau. Nothing is checked.
    """

    held: Column
    slope: Column
    v: Column
    motors: Motors
    given: Column
    dt: float

    @property
    def firm(self) -> Column:
        """The damping (r,), N m s/rad (N s/m if prismatic), by which the springs' torque on the links of r elastic
        joints decreases for every rad/s (m/s) that a link's joint velocity gains by the end of the integration step. It
        is positive, a `Column` (vector of scalars of any kind), and depends on the springs' stiffness and damping, the
        motors' inertia and the step's length."""
        return self._share * self.motors.inertia

    @property
    def torque(self) -> Column:
        """The torque (r,), N m (N if prismatic), of the springs on the links of r elastic joints over an integration
        step, for links' joint velocities that are at the step's end what they were at its beginning; a `Column` (vector
        of scalars of any kind). For other velocities it decreases by the property `firm` times their gain."""
        driven = self.motors.inertia * (self.motors.w - self.v) + self.dt * (self.given - self.held)
        return self.held + self._share * driven

    def spin(self, after: Column) -> Column:
        """The mean acceleration (r,), rad/s^2 (m/s^2 if prismatic), of the motors of r elastic joints over the
        integration step, reflected to the joints (as seen through the gears), a `Column` (vector of scalars of any
        kind). `after` (r,), rad/s (m/s), are the links' joint velocities at the step's end. Raises `ValueError` for
        another number of joints than r."""
        return self._yielding * (self.given - self.held - self.slope * (self.motors.w - after))

    @property
    def _share(self) -> Column:
        return self.slope * self._yielding

    @property
    def _yielding(self) -> Column:
        return Column(1.0 / (J + self.dt * slope) for J, slope in zip(self.motors.inertia, self.slope, strict=True))


@dataclass(frozen=True, eq=False)
class Transmission:
    """The transmission of a mechanism's r elastic joints: the springs and dampers between its motors and its links.
    `Transmission.of` makes and checks it; the class itself checks nothing.

    `stiffness`, N m/rad (N/m if prismatic), and `damping`, N m s/rad (N s/m), are (r,) arrays; so is `inertia`, kg m^2
    (kg), the motors' reflected inertia (as seen at the joint, through the gears) besides the rotors modelled. `rotors`
    (r,) has for each joint the index of its rotor's inertia among the mechanism's P inertial and friction parameters
    (in the order of `Mechanism.parameter_names`), None where it has none; `primary` (r,) are the indices of the primary
    (independent) joints among the spanning tree's n.
    """

    stiffness: Array
    damping: Array
    inertia: Array
    rotors: tuple[int | None, ...]
    primary: tuple[int, ...]

    @classmethod
    def of(cls, mechanism: Mechanism, joints: ElasticJoints) -> Transmission:
        """The `Transmission` of a `mechanism` whose r joints are elastic, with the springs, dampers and motor inertias
        of `joints`. Raises `InputError` for settings of `joints` that are negative, not finite or do not fit r joints,
        where a joint's motor has no inertia, a rotor turns with several joints, or linear relations bind the inertial
        parameters."""
        description, r = mechanism.description, mechanism.dof
        if len(mechanism.inertial_parameters) < len(description.inertial_parameters):
            raise InputError(
                f"elastic joints: {mechanism.name} has relations among its parameters: take the mechanism without them"
            )
        stiffness, damping, inertia = (joints.each(name, r) for name in ("stiffness", "damping", "motor_inertia"))
        found = cls(stiffness, damping, inertia, _rotors(mechanism), _primary(mechanism))
        motors = found.motors(column(mechanism.inertial_parameters)).of
        for joint, motor in zip(mechanism.primary_joints, motors, strict=True):
            if not motor > 0.0:
                raise InputError(
                    f"elastic joints: the motor of {joint.name} of {mechanism.name} has no inertia: give "
                    "motor_inertia, in kg m^2 behind the gears, or a drive with rotor_inertia"
                )
        return found

    def motors(self, parameters: Column) -> Column:
        """Reflected inertias (r,) of the motors of r elastic joints, kg m^2 (kg of a prismatic joint): their inertias
        as seen at the joints, through the gears, rotors included. The rotors' are taken from `parameters` (P,), the
        mechanism's P inertial and friction parameters in SI units, in the order of `Mechanism.parameter_names`. Both
        are Columns, vectors of scalars of any kind (floats, arrays, or symbols to be compiled). Raises `IndexError`
        where `parameters` is too short."""
        own = self.inertia.tolist()
        return Column(x if j is None else x + parameters[j] for x, j in zip(own, self.rotors, strict=True))

    def links(self, parameters: Column) -> Column:
        """Inertial and friction parameters (P,) without rotors, SI units: the mechanism's P `parameters` (P,), in the
        order of `Mechanism.parameter_names`, with the rotors' inertias replaced by zero, over Columns, vectors of
        scalars of any kind (floats, arrays, or symbols to be compiled). Nothing is checked."""
        return Column(0.0 if j in self.rotors else x for j, x in enumerate(parameters))

    def springs(self, q: Column, v: Column, motors: Motors, torque: Column, dt: float) -> Springs:
        """The torques of the springs of r elastic joints over an integration step of `dt` (s), a `Springs`. The links'
        joints are at positions q (n,), rad (m if prismatic), of all n of the spanning tree, and velocities v (r,),
        rad/s (m/s); the `motors` have positions and velocities of their own, and are driven by a `torque` (r,), N m
        (N). All are Columns, vectors of scalars of any kind (floats, arrays, or symbols to be compiled). Raises
        `ValueError` or `IndexError` for columns that are too short."""
        half = (0.5 * dt) * column(self.stiffness)
        held = column(self.stiffness) * self._stretch(q, motors) + half * (motors.w - v)
        return Springs(held, column(self.damping) + half, v, motors, torque, dt)

    def energy(self, q: Column, motors: Motors) -> Scalar:
        """Kinetic energy of the motors plus elastic energy of the springs of r elastic joints, J, a scalar of the kind
        given. The joints are at positions q (n,), rad (m if prismatic), of all n of the spanning tree; the `motors`
        have positions, velocities and inertias (r,). All are Columns, vectors of scalars of any kind (floats, arrays,
        or symbols to be compiled). Raises `ValueError` or `IndexError` for columns that are too short."""
        stretch = self._stretch(q, motors)
        total: Scalar = 0.5 * (motors.w @ (motors.inertia * motors.w) + stretch @ (column(self.stiffness) * stretch))
        return total

    def _stretch(self, q: Column, motors: Motors) -> Column:
        return motors.theta - Column(q[i] for i in self.primary)

    def rates(self, mechanism: Mechanism, p: Array) -> tuple[float, float]:
        """The fastest oscillation of the springs, rad/s, and the fastest decay by the dampers, 1/s, two floats, at any
        of k positions p (k, r), rad (m if prismatic), of the `mechanism`'s r primary (independent) joints. Raises
        `InputError` where the mass matrix without rotors is singular."""
        own = column(mechanism.inertial_parameters)
        links = mechanism.with_parameters(np.array(self.links(own).of, dtype=np.float64))
        mass = links.mass_matrix(p)
        if not np.all(np.linalg.eigvalsh(mass)[:, 0] > 1e-12 * np.linalg.eigvalsh(mass)[:, -1]):
            raise InputError(
                f"elastic joints: {mechanism.name}: without its rotors the mass matrix is singular: behind a spring, "
                "every joint needs links with inertia"
            )
        motors = np.array(self.motors(own).of, dtype=np.float64)
        return float(np.sqrt(_fastest(mass, motors, self.stiffness))), _fastest(mass, motors, self.damping)


def _fastest(mass: Array, motors: Array, springs: Array) -> float:
    """The largest eigenvalue of what springs (r,) do between links M (samples, r, r) and motors (r,), over inertia."""
    r = len(motors)
    inverse, pull = np.zeros((len(mass), 2 * r, 2 * r)), np.zeros((2 * r, 2 * r))
    inverse[:, :r, :r], inverse[:, r:, r:] = np.linalg.inv(mass), np.diag(1.0 / motors)
    pull[:r, :r] = pull[r:, r:] = np.diag(springs)
    pull[:r, r:] = pull[r:, :r] = -np.diag(springs)
    return float(np.abs(np.linalg.eigvals(inverse @ pull)).max())


def _rotors(mechanism: Mechanism) -> tuple[int | None, ...]:
    """The parameter of each primary joint's rotor, None where none is modelled."""
    description, first = mechanism.description, 10 * len(mechanism.description.bodies)
    found: dict[int, int] = {}
    for k, (joint, kind) in enumerate(description.drive_parameters):
        if kind is DriveParameter.ROTOR_INERTIA:
            found[joint] = first + k
    for joint in found:
        if joint in description.primary and len(description.drive_coupling(joint)) > 1:
            raise InputError(
                f"elastic joints: the rotor of {description.joint_names[joint]} of {mechanism.name} turns with several "
                "joints, and a spring is taken to be in one: take the mechanism without `turns_with`"
            )
    return tuple(found.get(joint) for joint in _primary(mechanism))


def _primary(mechanism: Mechanism) -> tuple[int, ...]:
    return tuple(mechanism.description.primary)
