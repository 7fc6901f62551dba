"""Effects at the joints: friction and springs that a model need not know, and bodies that links carry."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, frozen_array, numbers, real_number, whole_number
from adaptctl.caching import sent_as_made
from adaptctl.description.description import MAX_INERTIAL_PARAMETER
from adaptctl.description.drive import DriveParameter
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.dynamics.recursion.drive import COULOMB_SMOOTHING_SPEED, friction
from adaptctl.errors import InputError, NotFoundError
from adaptctl.scalars import Column
from adaptctl.simulation.effects.effect import Effect, JointEffect, LoadEffect, at_least_zero, validate_positive

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
        validate_positive(self.speed, "friction: speed", "rad/s")

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
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

    def max_slope(self, dof: int) -> Array:
        """The greatest slope (r,) of each joint's friction torque over its velocity, N m s/rad (N s/m for a prismatic
        joint), for `dof` (r) joints: the one at rest, viscous + (coulomb + stribeck)/0.01. Raises `InputError` for
        settings that are negative, NaN or do not fit r joints."""
        viscous, coulomb, stribeck = self._each(dof)
        return viscous + (coulomb + stribeck) / COULOMB_SMOOTHING_SPEED

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

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
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


SYMMETRIC = 1e-9
"""Parts of a tensor's largest entry that round-off, or the digits of a file, may make two of its entries differ."""


@sent_as_made
@dataclass(frozen=True, eq=False)
class Payload:
    """Payload, a rigid body held by a link of a robot: `mass` in kg, `center` of mass (3,) in m in that link's frame,
    and `inertia` tensor (3, 3) in kg m^2 about that centre, along the same axes. Centre and inertia are zero by
    default: a point mass in the frame's origin.

    Raises `InputError` for a `mass` that is negative or not a number (a boolean is not one), a wrong shape, numbers
    that are not finite or that make an inertial parameter above 1e20, and an inertia, unless zero, that no rigid body
    has: not symmetric within 1e-9 of its largest entry, or principal moments that break the triangle inequality.
    `inertia` is made exactly symmetric.
    """

    mass: float
    center: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", real_number(self.mass, "payload: mass"))
        if not 0.0 <= self.mass <= MAX_INERTIAL_PARAMETER:
            raise InputError(f"payload: expected a mass of at least 0 kg, got {self.mass!r}")
        object.__setattr__(self, "center", frozen_array(self.center, (3,), "payload: center"))
        tensor = frozen_array(self.inertia, (3, 3), "payload: inertia")
        _validate_bounded(self.mass, self.center, tensor)
        if tensor.any() and not _is_inertia(tensor):
            raise InputError(
                f"payload: no body has the inertia {tensor.tolist()}: expected a symmetric tensor whose "
                "principal moments satisfy the triangle inequality"
            )
        object.__setattr__(self, "inertia", frozen(0.5 * (tensor + tensor.T)))

    @classmethod
    def of(cls, given: float | Mapping[str, Any] | Payload) -> Payload:
        """A `Payload`, a rigid body held by a link, made of what is `given`: a mass in kg, or a mapping with `mass`
        (kg) and perhaps `center` of mass (3,) in m, in that link's frame, and `inertia` tensor (3, 3) in kg m^2 about
        the centre of mass, zero by default; a `Payload` is returned as it is.

        Raises `InputError` for anything else, for a mass that is missing or negative, a wrong shape, numbers that are
        not finite or too large, and an inertia that no rigid body has; `NotFoundError`, a subclass of it, for an
        unknown entry.
        """
        if isinstance(given, Payload):
            return given
        if not isinstance(given, Mapping):
            return cls(given)
        known = ("mass", "center", "inertia")
        if unknown := [key for key in given if key not in known]:
            raise NotFoundError(f"payload: unknown entry {unknown[0]!r}; entries: {', '.join(known)}")
        if "mass" not in given:
            raise InputError(f"payload: the mass is missing; entries: {', '.join(known)}")
        return cls(**given)

    def added_to(self, parameters: ArrayLike, link: int) -> Array:
        """The P inertial and friction parameters (..., P) of a mechanism with the payload added to the link of
        zero-based index `link`: a copy of `parameters` (..., P), SI units, in which that link's ten are changed.

        The parameters begin with ten a link: m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz, in kg, kg m, kg
        m^2 about the origin of the link's frame; the drives' (rotor inertias and friction), if any, follow. Raises
        `InputError` for parameters that are no numbers or too few to include the link's, and for a `link` that is not a
        whole number of at least 0; NaN and infinity among the parameters pass.
        """
        loaded = numbers(parameters, "payload: parameters").copy()
        whole_number(link, "payload: link", 0, (loaded.shape[-1] if loaded.ndim else 0) // 10 - 1)
        loaded[..., 10 * link : 10 * link + 10] += from_center_of_mass(self.mass, self.center, self.inertia)
        return loaded


def _validate_bounded(mass: float, center: Array, tensor: Array) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        parameters = from_center_of_mass(mass, center, tensor)
    if not np.abs(parameters).max() <= MAX_INERTIAL_PARAMETER:
        raise InputError(
            f"payload: expected inertial parameters of at most {MAX_INERTIAL_PARAMETER:g}, got a mass of {mass:g} kg, "
            f"a center {center.tolist()} and an inertia {tensor.tolist()}"
        )


def _is_inertia(tensor: Array) -> bool:
    """True if a body has this tensor (3, 3) about its centre of mass."""
    if np.abs(tensor - tensor.T).max() > SYMMETRIC * np.abs(tensor).max():
        return False
    second_moments = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    return bool(np.linalg.eigvalsh(second_moments)[0] >= -1e-12 * np.trace(tensor))


@dataclass(frozen=True, eq=False)
class PayloadHeld(LoadEffect):
    """Plant effect of a payload, a rigid body that a link holds from the time `start` until the time `stop` (s): from 0
    on and for ever by default. `link` is the link's name, None, the default, for the last link that has mass.

    `payload` is a `Payload`, a mass in kg, or a mapping with `mass` (kg) and perhaps `center` of mass (3,) in m, in the
    link's frame, and `inertia` tensor (3, 3) in kg m^2 about the centre; it is stored as a `Payload`. When it is picked
    up it already moves with the link, and when it is dropped it moves on: the arm's velocities do not jump.

    Raises `InputError` where `payload` cannot be made into a `Payload`, such as a mapping without `mass` or a negative
    mass, and unless `start` is finite and before `stop`; `NotFoundError`, a subclass of it, for a mapping with unknown
    entries. A `Plant` raises `NotFoundError` for a link that it does not have or that has no mass, `InputError` for a
    mechanism with relations among its inertial parameters.
    """

    payload: Payload | float | Mapping[str, Any]
    start: float = 0.0
    stop: float = math.inf
    link: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "payload", Payload.of(self.payload))
        start, stop = real_number(self.start, "payload: start"), real_number(self.stop, "payload: stop")
        if not (math.isfinite(start) and start < stop):
            raise InputError(f"payload: expected a start before its stop, got {self.start} and {self.stop} s")

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `NotFoundError` unless this effect's `link`, the name of the link that holds the payload, is None or
        among `links`, the names of the links with ten inertial parameters each. The number of joints `dof` and
        `control_period` (s) are not used."""
        self._place(links)

    def mass(self, time: float) -> float:
        """The mass, kg, that the payload adds at `time` (s): its own while it is held, `start` <= `time` < `stop` of
        this effect, else 0. Nothing is raised."""
        return Payload.of(self.payload).mass if self.start <= time < self.stop else 0.0

    def next_change_time(self, time: float) -> float:
        """The first time after `time` (s) at which the payload is picked up or dropped, s; infinity where there is
        none. Nothing is raised."""
        return next((change for change in (self.start, self.stop) if time < change), math.inf)

    def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
        """The P inertial and friction parameters (..., P) of a mechanism at `time` (s): while the payload is held, a
        copy of `parameters` (..., P), SI units, with the payload added to the ten of its link; otherwise `parameters`
        itself, unchecked.

        The parameters begin with ten for each of the `links` (names), in their order: m, mc_x, mc_y, mc_z, I_xx, I_xy,
        I_yy, I_xz, I_yz, I_zz, in kg, kg m, kg m^2 about the origin of the link's frame; the drives' (rotor inertias
        and friction), if any, follow. While the payload is held, raises `NotFoundError` where its link is not among
        `links`, `InputError` for parameters that are no numbers or too few to include that link's.
        """
        if not self.start <= time < self.stop:
            return parameters
        return Payload.of(self.payload).added_to(parameters, self._place(links))

    def _place(self, links: tuple[str, ...]) -> int:
        """The index of the payload's link."""
        if self.link is None:
            return len(links) - 1
        if self.link not in links:
            raise NotFoundError(f"payload: there is no link {self.link!r}; links: {', '.join(links)}")
        return links.index(self.link)
