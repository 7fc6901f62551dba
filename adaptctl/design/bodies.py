"""Bodies that are fixed to links: solids of even density, and what arms commonly carry."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, real_number
from adaptctl.description.description import LARGEST_INERTIA
from adaptctl.errors import InputError
from adaptctl.simulation.effects import Payload

STEEL = 7850.0
"""kg/m^3"""
LEAST, MOST = 1e-100, 1e100
"""Lengths (m) and densities (kg/m^3) with which every solid's numbers are finite."""


def point(mass: float, place: ArrayLike = (0.0, 0.0, 0.0)) -> Payload:
    """A point mass (kg), as a `Payload` without inertia about its centre, at the position `place` (3,), m, in its
    link's frame, by default the origin. Raises `InputError` for a mass below zero, above 1e20 kg or not finite, for a
    position that is not three finite numbers, and for inertial parameters about the frame's origin above 1e20 (SI
    units)."""
    given: Any = mass
    number: Any = given[()] if isinstance(given, np.ndarray) and given.ndim == 0 else given
    return Payload(number, frozen_array(place, (3,), "place"))


def sphere(mass: float, place: ArrayLike = (0.0, 0.0, 0.0), *, density: float = STEEL) -> Payload:
    """A solid ball, as a `Payload`, of a mass (kg) and a density (kg/m^3; steel's 7850 by default) with its centre at
    the position `place` (3,), m, in its link's frame, by default the origin. Raises `InputError` for a mass below zero,
    above 1e20 kg or not finite, for a density not from 1e-100 to 1e100, for a position that is not three finite
    numbers, and for inertial parameters about the frame's origin above 1e20 (SI units)."""
    density, mass = _size("density", density), _mass(mass)
    return Payload(mass, frozen_array(place, (3,), "place"), ball_moment(mass, density) * np.eye(3))


def box(mass: float, size: ArrayLike, place: ArrayLike = (0.0, 0.0, 0.0)) -> Payload:
    """A solid box of uniform density, as a `Payload`, of a mass (kg), whose edges, of lengths `size` (3,) in m, lie
    along the axes of its link's frame. `place` (3,) is the position of its centre in the link's frame, m, by default
    the origin. Raises `InputError` for a mass below zero, above 1e20 kg or not finite, for lengths that are not three
    numbers from 1e-100 to 1e100, for a position that is not three finite numbers, and for inertial parameters about the
    frame's origin above 1e20 (SI units)."""
    edges = frozen_array(size, (3,), "size").tolist()
    x, y, z = (_size(f"size: {axis}", edge) for axis, edge in zip("xyz", edges, strict=True))
    mass = _mass(mass)
    tensor = mass / 12.0 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y])
    return Payload(mass, frozen_array(place, (3,), "place"), tensor)


def cylinder(
    mass: float,
    radius: float,
    length: float,
    place: ArrayLike = (0.0, 0.0, 0.0),
    *,
    axis: ArrayLike = (0.0, 0.0, 1.0),
) -> Payload:
    """A solid cylinder of uniform density, as a `Payload`, of a mass (kg), a radius and a length (m). `place` (3,) is
    the position of its centre in the link's frame, m, by default the origin. `axis` (3,), of any length within the
    bounds below, is its direction in that frame, by default z. Raises `InputError` for a mass below zero, above 1e20 kg
    or not finite, for a radius, a length or an axis shorter than 1e-100 or longer than 1e100, for a position or an axis
    that is not three finite numbers, and for inertial parameters about the frame's origin above 1e20 (SI units)."""
    radius, length, mass = _size("radius", radius), _size("length", length), _mass(mass)
    along = frozen_array(axis, (3,), "axis")
    size = _size("axis", float(np.linalg.norm(along)))
    outer = np.outer(along, along) / size**2
    about, across = mass * radius**2 / 2.0, mass * (3.0 * radius**2 + length**2) / 12.0
    return Payload(mass, frozen_array(place, (3,), "place"), about * outer + across * (np.eye(3) - outer))


def gripper(place: ArrayLike = (0.0, 0.0, 0.0)) -> Payload:
    """A two-finger gripper, as a `Payload`: 0.9 kg, a solid cylinder 75 mm across and 160 mm long, along z of its
    link's frame. `place` (3,) is the position of its centre in that frame, m, by default the origin. Raises
    `InputError` for a position that is not three finite numbers, or so far that an inertial parameter is above 1e20 (SI
    units)."""
    return cylinder(0.9, 0.0375, 0.16, place)


def camera(place: ArrayLike = (0.0, 0.0, 0.0)) -> Payload:
    """A depth camera with its mount, as a `Payload`: 0.2 kg, a solid box of 90, 25 and 25 mm along x, y and z of its
    link's frame. `place` (3,) is the position of its centre in that frame, m, by default the origin. Raises
    `InputError` for a position that is not three finite numbers, or so far that an inertial parameter is above 1e20 (SI
    units)."""
    return box(0.2, (0.09, 0.025, 0.025), place)


def motor(place: ArrayLike = (0.0, 0.0, 0.0)) -> Payload:
    """A joint's motor, as a `Payload`, its rotor at rest: 1.5 kg, a solid cylinder 70 mm across and 90 mm long, along z
    of its link's frame. `place` (3,) is the position of its centre in that frame, m, by default the origin. Raises
    `InputError` for a position that is not three finite numbers, or so far that an inertial parameter is above 1e20 (SI
    units)."""
    return cylinder(1.5, 0.035, 0.09, place)


CATALOGUE = {"gripper": gripper, "camera": camera, "motor": motor}
"""Bodies by name."""


EVEN = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0])
"""The ten of a tensor that is the same about every axis."""


def ball_moment(mass: float, density: float) -> float:
    """The moment of inertia (kg m^2), about its centre, of a solid ball of a mass (kg) and a density (kg/m^3); 0 for an
    infinite density. Arguments are not checked: floats raise `ZeroDivisionError` for a density of 0, and `TypeError`
    where mass / density is negative."""
    return float(0.4 * mass * (3.0 * mass / (4.0 * np.pi * density)) ** (2.0 / 3.0))


def ball_tens(masses: ArrayLike, places: ArrayLike, density: float = np.inf) -> Array:
    """The ten inertial parameters (..., 10) of solid balls of masses (...), kg, with centres at the positions `places`
    (..., 3), m, in a link's frame, and one density (kg/m^3): mass m (kg), first moments mc_x, mc_y, mc_z (kg m) and
    inertia tensor's entries I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg m^2), about the frame's origin. By default the
    density is infinite: point masses. Masses and positions broadcast; raises `ValueError` where they do not. Values are
    not checked: a negative mass at a finite density gives NaN."""
    m, x = np.asarray(masses, dtype=np.float64), np.asarray(places, dtype=np.float64)
    own = 0.4 * m * (3.0 * m / (4.0 * np.pi * density)) ** (2.0 / 3.0)
    return np.asarray(m[..., None] * _per_mass(x) + own[..., None] * EVEN)


def ball_tens_slopes(masses: Array, places: Array, density: float) -> Array:
    """Derivatives (..., 10, 4) of the ten inertial parameters of solid balls with respect to, along the last axis, the
    mass (per kg) and the three coordinates of the centre (per m). The balls have masses (...), kg, centres at the
    positions `places` (..., 3), m, in a link's frame, and one density (kg/m^3); the parameters are mass m (kg), first
    moments mc_x, mc_y, mc_z (kg m) and inertia tensor's entries I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (kg m^2), about the
    frame's origin. Masses and positions are arrays that broadcast; raises `ValueError` where they do not. Values are
    not checked."""
    own = (2.0 / 3.0) * (3.0 * masses / (4.0 * np.pi * density)) ** (2.0 / 3.0)
    with_mass = _per_mass(places) + own[..., None] * EVEN
    slopes = [with_mass]
    for i in range(3):
        # The tens per mass are quadratic in each coordinate, so central differences are exact.
        step = np.eye(3)[i]
        slopes.append(0.5 * masses[..., None] * (_per_mass(places + step) - _per_mass(places - step)))
    return np.stack(slopes, axis=-1)


def _per_mass(places: Array) -> Array:
    """The tens (..., 10) of a point of 1 kg."""
    x, y, z = np.moveaxis(places, -1, 0)
    return np.stack([np.ones_like(x), x, y, z, y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y], -1)


def _mass(value: float) -> float:
    mass = real_number(value, "mass")
    if not 0.0 <= mass <= LARGEST_INERTIA:
        raise InputError(f"mass: expected a number of at least 0 kg and at most {LARGEST_INERTIA:g}, got {value!r}")
    return mass


def _size(name: str, value: float) -> float:
    size = real_number(value, name)
    if not LEAST <= size <= MOST:
        raise InputError(f"{name}: expected a number above 0, from {LEAST:g} to {MOST:g}, got {value!r}")
    return size
