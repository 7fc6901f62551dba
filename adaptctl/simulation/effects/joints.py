"""Friction in the joints that the controller's model need not know."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.description.drive import DriveParameter
from adaptctl.dynamics.recursion.drive import SLOW, friction
from adaptctl.errors import InputError
from adaptctl.scalars import Column
from adaptctl.simulation.effects.effect import Effect, JointEffect, at_least_zero, require_positive

KINDS = (DriveParameter.VISCOUS, DriveParameter.COULOMB, DriveParameter.STRIBECK)


@dataclass(frozen=True, eq=False)
class Friction(JointEffect):
    """Joint friction: viscous, Coulomb and Stribeck friction, greatest at the start of a motion and falling while the
    lubricant's film builds up.

        torque = viscous v + (coulomb + stribeck/(1 + (v/speed)^2)) sign(v)

    (Hess and Soom 1990; Armstrong-Helouvry, Dupont and Canudas de Wit 1994, section 2.2.) v are the joints' velocities
    in rad/s (m/s of a prismatic joint). `stribeck` is the excess of static over Coulomb friction, half of which is gone
    at `speed` (rad/s, m/s), one number, 0.1 by default. `viscous` (N m s/rad, N s/m), `coulomb` and `stribeck` (N m, N)
    are one number or one a joint (r,), zero by default. The sign is smoothed to v/sqrt(v^2 + 0.01^2), also for a
    drive's Coulomb friction, so the arm creeps where a real one sticks.

    This friction acts on the r primary (independent) joints of the plant alone; the controller's model has none of it.
    The friction of the mechanism's drives is in the plant and in the model, where it can be adapted; this comes on top.
    Raises `InputError` for a speed that is not positive and finite; a `Plant` raises it for other numbers that are
    negative, not finite or do not fit its r joints.
    """

    viscous: ArrayLike = 0.0
    coulomb: ArrayLike = 0.0
    stribeck: ArrayLike = 0.0
    speed: float = 0.1

    def __post_init__(self) -> None:
        require_positive(self.speed, "friction: speed", "rad/s")

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless each of `viscous`, `coulomb` and `stribeck` is one finite number of at least 0 or
        one for each of `dof` (r) joints. The names `links` and `control_period` (s) are not used."""
        if not np.isfinite(self._each(dof)).all():
            raise InputError("friction: expected finite numbers")

    def torque(self, v: Column) -> Column:
        """The friction torque (r,) of r joints, N m (N for a prismatic joint), at their velocities v (r,), rad/s (m/s).
        It has the sign of v, so the equations of motion subtract it from the drives' torque. Both are Columns,
        vectors of scalars of any kind: floats, arrays, or symbols to be compiled. Raises `InputError` for settings that
        are negative, NaN or do not fit r joints."""
        terms = zip(KINDS, self._each(len(v)).tolist(), strict=True)
        each = (Column(values) * Column(friction(kind, x, self.speed) for x in v) for kind, values in terms)
        return sum(each, Column.zeros(len(v)))

    def steepest(self, dof: int) -> Array:
        """The greatest slope (r,) of each joint's friction torque over its velocity, N m s/rad (N s/m for a prismatic
        joint), for `dof` (r) joints: the one at rest, viscous + (coulomb + stribeck)/0.01. Raises `InputError` for
        settings that are negative, NaN or do not fit r joints."""
        viscous, coulomb, stribeck = self._each(dof)
        return viscous + (coulomb + stribeck) / SLOW

    def _each(self, dof: int) -> Array:
        """The three (3, r)."""
        given = ((kind.value, getattr(self, kind.value)) for kind in KINDS)
        return np.array([at_least_zero(values, dof, f"friction: {name}") for name, values in given])


LINK, MOTOR = "link", "motor"
"""Places of encoders: behind the spring or before it."""


@dataclass(frozen=True, eq=False)
class ElasticJoints(Effect):
    """Plant effect of elastic joints: the motors of r joints turn the links through springs and dampers (Spong 1987).

        J w' = torque - f,   M(q) v' + C v + g + friction = f,   f = stiffness (theta - p) + damping (w - v)

    The motors, reflected to the joints (as seen through the gears), have positions theta and velocities w, the joints p
    and v: (r,) each, in rad and rad/s (m and m/s for a prismatic joint); a prime is a time derivative. `torque` (r,) is
    the motors' and f the springs', N m (N). M is the links' mass matrix at the configuration q (n,) of all n joints of
    the spanning tree, C v the velocity torques, g gravity's. J is the motors' inertia, kg m^2 (kg): the rotor inertia
    of the mechanism's drives, which then no longer turns with the links, plus `motor_inertia`. The stiffer the springs,
    the nearer is the plant to the rigid one with that rotor inertia. Friction stays with the links. Rotors turn about
    their joints' axes alone, as Spong assumes: their energy does not depend on how the links that carry them move.

    `stiffness` (N m/rad, N/m), `damping` (N m s/rad, N s/m) and `motor_inertia` are one number or one a joint (r,), the
    last two zero by default. `encoders` says where the encoders are: "link" (the default), behind the spring, or
    "motor", before it, where controllers measure theta and w, as on most robots. The last 2r numbers of
    `PlantState.drives` are theta, then w.

    Construction raises `InputError` for other `encoders` and checks nothing else. A `Plant` raises it unless stiffness
    is positive, damping and motor inertia are at least 0, all are finite and fit its r joints, and every J is positive.
    A `Plant` also raises it for a rotor that turns with several joints, relations among the inertial parameters, a mass
    matrix that is singular without the rotors, and too few substeps for an explicit integrator.
    """

    stiffness: ArrayLike
    damping: ArrayLike = 0.0
    motor_inertia: ArrayLike = 0.0
    encoders: str = LINK

    def __post_init__(self) -> None:
        if not isinstance(self.encoders, str) or self.encoders not in (LINK, MOTOR):
            raise InputError(f"elastic joints: encoders: expected {LINK!r} or {MOTOR!r}, got {self.encoders!r}")

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless stiffness is positive, damping and motor inertia are at least 0, all are finite,
        and each is one number or one for each of `dof` (r) joints. The names `links` and `control_period` (s) are not
        used."""
        stiffness = self.each("stiffness", dof)
        if not np.all(stiffness > 0.0):
            raise InputError(f"elastic joints: stiffness: expected positive numbers, got {stiffness.tolist()}")
        self.each("damping", dof), self.each("motor_inertia", dof)

    def each(self, name: str, dof: int) -> Array:
        """The values (r,) of one setting, one for each of `dof` (r) joints, read-only: `name` is "stiffness" (N m/rad,
        N/m of a prismatic joint), "damping" (N m s/rad, N s/m) or "motor_inertia" (kg m^2, kg).

        Raises `InputError` for values that are no numbers, negative, not finite or of another shape than one number or
        (r,), `AttributeError` for a `name` that is no attribute of the class.
        """
        values = at_least_zero(getattr(self, name), dof, f"elastic joints: {name}")
        if not np.isfinite(values).all():
            raise InputError(f"elastic joints: {name}: expected finite numbers, got {getattr(self, name)}")
        return values
