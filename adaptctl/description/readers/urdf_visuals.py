"""Reader of what URDF links look like. What cannot be shown is left out: no picture is worth refusing a robot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.description.description import GROUND
from adaptctl.description.pose import Pose, roll_pitch_yaw
from adaptctl.description.readers.xml_elements import attribute, number, numbers, required
from adaptctl.description.visual import Box, Color, Cylinder, Mesh, Solid, Sphere, Visual
from adaptctl.errors import InputError

SUFFIXES = (".dae", ".glb", ".obj", ".stl")
"""Kinds of meshes that stand in one file."""
SMALLEST, LARGEST = 200, 8_000_000
"""Bytes of a mesh that is shown. What is smaller only points to where the mesh is stored."""


def materials(robot: Element) -> dict[str, Color]:
    """The colours that a robot's file gives names."""
    colors = ((element.get("name", ""), _own_color(element)) for element in robot.iter("material"))
    return {name: color for name, color in colors if name and color is not None}


def visuals(body: Element, file: Path, colors: Mapping[str, Color]) -> Iterator[Visual]:
    """The shapes of a link of the file, in the link's frame."""
    for element in body.findall("visual"):
        try:
            solid = _solid(element, file)
            pose = _pose(element)
        except InputError:
            continue
        if solid is not None:
            yield Visual(GROUND, pose, solid, _color(element, colors))


def _solid(visual: Element, file: Path) -> Solid | None:
    """The solid of a <visual>; none where a mesh cannot be shown."""
    geometry = required(visual, "geometry", "visual")
    for element in geometry:
        if element.tag == "mesh":
            path = found(attribute(element, "filename", "mesh"), file)
            scale = numbers(element, "scale", 3, "mesh") if "scale" in element.attrib else (1.0, 1.0, 1.0)
            return None if path is None else Mesh(path, (scale[0], scale[1], scale[2]))
        if element.tag == "box":
            x, y, z = numbers(element, "size", 3, "box")
            return Box((x, y, z))
        if element.tag == "cylinder":
            return Cylinder(number(element, "radius", "cylinder"), number(element, "length", "cylinder"))
        if element.tag == "sphere":
            return Sphere(number(element, "radius", "sphere"))
    return None


def found(name: str, file: Path) -> Path | None:
    """The mesh of that name: its path is relative to the file's folder, or to one of the folders above.

    So is a ``package://`` path, with its package's name or, for a package that was renamed, without.
    """
    scheme, _, rest = name.rpartition("://")
    path = PurePosixPath(rest)
    if scheme not in ("", "file", "package") or path.suffix.lower() not in SUFFIXES:
        return None
    tails = [path, PurePosixPath(*path.parts[1:])] if scheme == "package" and len(path.parts) > 1 else [path]
    for folder in file.absolute().parents:
        for tail in tails:
            if _is_shown(folder / tail):
                return folder / tail
    return None


def _is_shown(path: Path) -> bool:
    try:
        return path.is_file() and SMALLEST <= path.stat().st_size <= LARGEST
    except (OSError, ValueError):
        return False


def _pose(visual: Element) -> Pose:
    origin = visual.find("origin")
    if origin is None:
        return Pose.identity()
    rpy, xyz = (numbers(origin, key, 3, "visual") if key in origin.attrib else [0.0] * 3 for key in ("rpy", "xyz"))
    return Pose(roll_pitch_yaw(rpy), np.array(xyz))


def _color(visual: Element, colors: Mapping[str, Color]) -> Color | None:
    material = visual.find("material")
    if material is None:
        return None
    return _own_color(material) or colors.get(material.get("name", ""))


def _own_color(material: Element) -> Color | None:
    color = material.find("color")
    try:
        values = numbers(color, "rgba", 4, "color") if color is not None else []
    except InputError:
        return None
    if not values or not all(0.0 <= value <= 1.0 for value in values):
        return None
    return values[0], values[1], values[2], values[3]
