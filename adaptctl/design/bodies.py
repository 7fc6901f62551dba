"""Bodies that are fixed to links."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, real_number
from adaptctl.description.link import MAX_INERTIAL_PARAMETER
from adaptctl.errors import InputError
from adaptctl.simulation.effects import Payload

# Density of steel in kg/m^3.
STEEL_DENSITY = 7850.0
# Lengths (m) and densities (kg/m^3) with which every solid's numbers are finite.
MIN_SIZE, MAX_SIZE = 1e-100, 1e100


def point(mass: float, place: ArrayLike = (0.0, 0.0, 0.0)) -> Payload:
    """
    Return a point mass.

    Parameters
    ----------
    mass : float
        Mass in kg, from 0 to 1e20.
    place : array_like, optional
        Position (3,) in the link's frame in m; the origin by default.

    Returns
    -------
    Payload
        Point mass, without inertia about its center.

    Raises
    ------
    InputError
        If a number is out of range or not finite, or a shape is wrong.

    Examples
    --------
    >>> from adaptctl.design import point
    >>> point(0.5, [0.1, 0.0, 0.0]).mass
    0.5
    """
    given: Any = mass
    number: Any = given[()] if isinstance(given, np.ndarray) and given.ndim == 0 else given
    return Payload(number, frozen_array(place, (3,), "place"))


def sphere(mass: float, place: ArrayLike = (0.0, 0.0, 0.0), *, density: float = STEEL_DENSITY) -> Payload:
    """
    Return a solid ball.

    Parameters
    ----------
    mass : float
        Mass in kg, from 0 to 1e20.
    place : array_like, optional
        Position (3,) of its center in the link's frame in m; the origin by default.
    density : float, default 7850.0
        Density in kg/m^3; that of steel by default.

    Returns
    -------
    Payload
        Ball with its inertia.

    Raises
    ------
    InputError
        If a number is out of range or not finite, or a shape is wrong.

    Examples
    --------
    >>> from adaptctl.design import sphere
    >>> sphere(2.0).inertia.shape
    (3, 3)
    """
    density, mass = _size("density", density), _mass(mass)
    return Payload(mass, frozen_array(place, (3,), "place"), ball_moments(mass, density) * np.eye(3))


def box(mass: float, size: ArrayLike, place: ArrayLike = (0.0, 0.0, 0.0)) -> Payload:
    """
    Return a solid box whose edges are along the axes of the link's frame.

    Parameters
    ----------
    mass : float
        Mass in kg, from 0 to 1e20.
    size : array_like
        Lengths (3,) of the edges in m.
    place : array_like, optional
        Position (3,) of its center in the link's frame in m; the origin by default.

    Returns
    -------
    Payload
        Box with its inertia.

    Raises
    ------
    InputError
        If a number is out of range or not finite, or a shape is wrong.

    Examples
    --------
    >>> from adaptctl.design import box
    >>> round(float(box(1.2, (0.1, 0.2, 0.3)).inertia[0, 0]), 3)
    0.013
    """
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
    """
    Return a solid cylinder.

    Parameters
    ----------
    mass : float
        Mass in kg, from 0 to 1e20.
    radius : float
        Radius in m.
    length : float
        Length in m.
    place : array_like, optional
        Position (3,) of its center in the link's frame in m; the origin by default.
    axis : array_like, optional
        Direction (3,) without a unit in that frame, of any length; z by default.

    Returns
    -------
    Payload
        Cylinder with its inertia.

    Raises
    ------
    InputError
        If a number is out of range or not finite, or a shape is wrong.

    Examples
    --------
    >>> from adaptctl.design import cylinder
    >>> round(float(cylinder(2.0, 0.1, 0.3).inertia[2, 2]), 3)
    0.01
    """
    radius, length, mass = _size("radius", radius), _size("length", length), _mass(mass)
    along = frozen_array(axis, (3,), "axis")
    size = _size("axis", float(np.linalg.norm(along)))
    outer = np.outer(along, along) / size**2
    about, across = mass * radius**2 / 2.0, mass * (3.0 * radius**2 + length**2) / 12.0
    return Payload(mass, frozen_array(place, (3,), "place"), about * outer + across * (np.eye(3) - outer))


def gripper(place: ArrayLike = (0.0, 0.0, 0.0)) -> Payload:
    """
    Return a two-finger gripper of 0.9 kg: a cylinder 75 mm across and 160 mm long, along z.

    Parameters
    ----------
    place : array_like, optional
        Position (3,) of its center in the link's frame in m; the origin by default.

    Returns
    -------
    Payload
        Gripper with its inertia.

    Raises
    ------
    InputError
        If the position is not three finite numbers, or too far.

    Examples
    --------
    >>> from adaptctl.design import gripper
    >>> gripper([0.0, 0.0, 0.1]).mass
    0.9
    """
    return cylinder(0.9, 0.0375, 0.16, place)


def camera(place: ArrayLike = (0.0, 0.0, 0.0)) -> Payload:
    """
    Return a depth camera with its mount of 0.2 kg: a box of 90, 25 and 25 mm.

    Parameters
    ----------
    place : array_like, optional
        Position (3,) of its center in the link's frame in m; the origin by default.

    Returns
    -------
    Payload
        Camera with its inertia.

    Raises
    ------
    InputError
        If the position is not three finite numbers, or too far.

    Examples
    --------
    >>> from adaptctl.design import camera
    >>> camera().mass
    0.2
    """
    return box(0.2, (0.09, 0.025, 0.025), place)


def motor(place: ArrayLike = (0.0, 0.0, 0.0)) -> Payload:
    """
    Return a joint's motor of 1.5 kg, rotor at rest: a cylinder 70 mm across and 90 mm long, along z.

    Parameters
    ----------
    place : array_like, optional
        Position (3,) of its center in the link's frame in m; the origin by default.

    Returns
    -------
    Payload
        Motor with its inertia.

    Raises
    ------
    InputError
        If the position is not three finite numbers, or too far.

    Examples
    --------
    >>> from adaptctl.design import motor
    >>> motor().mass
    1.5
    """
    return cylinder(1.5, 0.035, 0.09, place)


# Bodies by name.
CATALOGUE = {"gripper": gripper, "camera": camera, "motor": motor}


# Ten parameters of a tensor that is the same about every axis.
ISOTROPIC_TENSOR = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0])


def ball_radii(masses: ArrayLike, density: float) -> Array:
    """Return the radii in m of solid balls."""
    return np.asarray(np.cbrt(3.0 * np.asarray(masses) / (4.0 * np.pi * density)), dtype=np.float64)


def ball_moments(masses: ArrayLike, density: float) -> Array:
    """Return the moments of inertia in kg m^2 of solid balls about their centers."""
    return np.asarray(0.4 * np.asarray(masses) * ball_radii(masses, density) ** 2)


def ball_tens(masses: ArrayLike, places: ArrayLike, density: float = np.inf) -> Array:
    """Return the ten inertial parameters (..., 10) in SI units of solid balls, as in `Link.inertia`."""
    m, x = np.asarray(masses, dtype=np.float64), np.asarray(places, dtype=np.float64)
    own = ball_moments(m, density)
    return np.asarray(m[..., None] * _per_mass(x) + own[..., None] * ISOTROPIC_TENSOR)


def ball_tens_slopes(masses: Array, places: Array, density: float) -> Array:
    """Return derivatives (..., 10, 4) of the balls' inertial parameters with respect to mass and position."""
    own = 5.0 / 3.0 * ball_moments(1.0, density) * masses ** (2.0 / 3.0)  # moments grow with the mass's power of 5/3
    with_mass = _per_mass(places) + own[..., None] * ISOTROPIC_TENSOR
    slopes = [with_mass]
    for i in range(3):
        # The tens per mass are quadratic in each coordinate, so central differences are exact.
        step = np.eye(3)[i]
        slopes.append(0.5 * masses[..., None] * (_per_mass(places + step) - _per_mass(places - step)))
    return np.stack(slopes, axis=-1)


def _per_mass(places: Array) -> Array:
    x, y, z = np.moveaxis(places, -1, 0)
    return np.stack([np.ones_like(x), x, y, z, y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y], -1)


def _mass(value: float) -> float:
    mass = real_number(value, "mass")
    if not 0.0 <= mass <= MAX_INERTIAL_PARAMETER:
        raise InputError(
            f"mass: expected a number of at least 0 kg and at most {MAX_INERTIAL_PARAMETER:g}, got {value!r}"
        )
    return mass


def _size(name: str, value: float) -> float:
    size = real_number(value, name)
    if not MIN_SIZE <= size <= MAX_SIZE:
        raise InputError(f"{name}: expected a number above 0, from {MIN_SIZE:g} to {MAX_SIZE:g}, got {value!r}")
    return size
