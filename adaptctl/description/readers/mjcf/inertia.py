"""The inertia of an MJCF body: written out, or that of its geoms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_center_of_mass, transformed
from adaptctl.description.pose import Pose
from adaptctl.description.readers.mjcf.frames import facing, placed
from adaptctl.description.readers.mjcf.settings import Settings
from adaptctl.description.readers.xml_elements import named, number, numbers, refuse
from adaptctl.errors import InputError

WATER = 1000.0
"""kg/m^3, a geom's density unless it says otherwise"""
SHORTEST = 1e-9
"""m, of a geom's sizes: volumes of shorter ones become zero"""
_SHAPES = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
_WITHOUT_MASS = ("plane", "hfield")


def body_inertia(
    inertial: Element | None, geoms: Sequence[tuple[Element, Pose]], settings: Settings, where: str
) -> Array:
    """The ten inertial parameters (10,) of a body of an MJCF file, about the origin of its frame: m, mc_x, mc_y, mc_z,
    I_xx, I_xy, I_yy, I_xz, I_yz, I_zz (mass in kg, first moment in kg m, inertia tensor in kg m^2).

    They are those of its <inertial> element, or else the sum of those of its geoms, as the compiler setting
    inertiafromgeom decides; zero where neither counts. `inertial` is None where there is none; `geoms` are pairs of a
    geom, with its defaults, and the pose, in the body, of the body or <frame> that contains it; `settings` are the
    file's. Raises `InputError` for missing or wrong numbers, a negative mass or density, and geoms of other shapes than
    spheres, capsules, ellipsoids, cylinders and boxes; `where` begins the message.
    """
    if inertial is not None and (settings.inertia_from_geoms != "true" or not geoms):
        return _written(inertial, settings, where)
    if settings.inertia_from_geoms == "false":
        return np.zeros(10)
    first, last = settings.inertia_groups
    counted = [(g, at) for g, at in geoms if first <= (number(g, "group", where) if "group" in g.attrib else 0) <= last]
    return np.sum([_geom(geom, at, settings, where) for geom, at in counted] or [np.zeros(10)], axis=0)


def _written(inertial: Element, settings: Settings, where: str) -> Array:
    if "pos" not in inertial.attrib:
        raise InputError(f"{where}: <inertial> needs the attribute pos")
    pose, mass = placed(inertial, settings, where), number(inertial, "mass", where)
    if mass < 0.0:
        refuse(inertial, f"{where}: mass must not be negative, got {mass}")
    if ("fullinertia" in inertial.attrib) == ("diaginertia" in inertial.attrib):
        raise InputError(f"{where}: <inertial> needs one of diaginertia and fullinertia")
    if "diaginertia" in inertial.attrib:
        tensor = np.diag(numbers(inertial, "diaginertia", 3, where))
    else:
        xx, yy, zz, xy, xz, yz = numbers(inertial, "fullinertia", 6, where)
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return from_center_of_mass(mass, pose.translation, pose.rotation @ tensor @ pose.rotation.T)


def _geom(geom: Element, at: Pose, settings: Settings, where: str) -> Array:
    """The ten of one solid, in the body's frame."""
    kind, what = geom.get("type", "sphere"), f"{where}: {named(geom)}"
    density = number(geom, "density", what) if "density" in geom.attrib else WATER
    given = number(geom, "mass", what) if "mass" in geom.attrib else None
    if density < 0.0 or (given is not None and given < 0.0):
        refuse(geom, f"{what}: mass and density must not be negative, got {density if given is None else given}")
    if given == 0.0 or (given is None and density == 0.0) or kind in _WITHOUT_MASS:
        return np.zeros(10)
    if kind not in _SHAPES:
        raise InputError(f"{what}: the inertia of a {kind} is not worked out: give the body an <inertial>, or mass='0'")
    if geom.get("shellinertia") == "true":
        raise InputError(f"{what}: shellinertia is not read: give the body an <inertial>")
    pose, size = _solid(geom, kind, settings, what)
    volume, per_mass = _unit_inertia(kind, size)
    mass = density * volume if given is None else given
    return transformed(from_center_of_mass(mass, np.zeros(3), mass * np.diag(per_mass)), at @ pose)


def _solid(geom: Element, kind: str, settings: Settings, where: str) -> tuple[Pose, list[float]]:
    """The geometry's pose, and its three sizes as MuJoCo has them: radius and half length, or half axes."""
    least = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}[kind]
    if "size" in geom.attrib and not all(length >= SHORTEST for length in _sizes(geom, least, where)):
        refuse(geom, f"{where}: size: expected lengths of at least {SHORTEST:g} m, got {geom.attrib['size']!r}")
    if "fromto" not in geom.attrib:
        return placed(geom, settings, where), numbers(geom, "size", range(least, 4), where)
    if kind == "sphere":
        raise InputError(f"{where}: a sphere has no fromto")
    ends = np.array(numbers(geom, "fromto", 6, where)).reshape(2, 3)
    way = ends[0] - ends[1]
    length = float(np.linalg.norm(way))
    if length == 0.0:
        raise InputError(f"{where}: fromto ends where it begins")
    radius = numbers(geom, "size", range(1, 4), where)[0]
    pose = Pose(facing(way / length), ends.mean(axis=0))
    return pose, [radius, length / 2.0] if least == 2 else [radius, radius, length / 2.0]


def _sizes(geom: Element, least: int, where: str) -> list[float]:
    """The sizes that count: of more, as defaults leave them, the rest may be zero."""
    return numbers(geom, "size", range(1, 4), where)[: 1 if "fromto" in geom.attrib else least]


def _unit_inertia(kind: str, size: Sequence[float]) -> tuple[float, list[float]]:
    """Volume (m^3), and the principal inertias of 1 kg (m^2)."""
    if kind == "sphere":
        return 4.0 / 3.0 * math.pi * size[0] ** 3, [0.4 * size[0] ** 2] * 3
    if kind == "capsule":
        return _capsule(size[0], size[1])
    if kind == "cylinder":
        r, h = size[0], 2.0 * size[1]
        across = (3.0 * r * r + h * h) / 12.0
        return math.pi * r * r * h, [across, across, r * r / 2.0]
    a, b, c = (x * x for x in size[:3])
    share, volume = (1.0 / 5.0, 4.0 / 3.0 * math.pi) if kind == "ellipsoid" else (1.0 / 3.0, 8.0)
    return volume * math.prod(size[:3]), [share * (b + c), share * (a + c), share * (a + b)]


def _capsule(r: float, half: float) -> tuple[float, list[float]]:
    """A cylinder and two half balls, whose own centres are 3r/8 beyond its ends."""
    rod, ball = math.pi * r * r * 2.0 * half, 4.0 / 3.0 * math.pi * r**3
    total = rod + ball
    along = (rod * r * r / 2.0 + ball * 0.4 * r * r) / total
    across_rod = rod * (3.0 * r * r + 4.0 * half * half) / 12.0
    across_ball = ball * (0.4 * r * r + half * half + 0.75 * half * r)
    across = (across_rod + across_ball) / total
    return total, [across, across, along]
