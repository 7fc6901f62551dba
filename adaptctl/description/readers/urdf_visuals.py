"""Reader of shapes in URDF; what cannot be shown is left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element

import numpy as np

from adaptctl.caching import cached_property
from adaptctl.description.link import GROUND
from adaptctl.description.pose import Pose, quaternion_rotation, roll_pitch_yaw
from adaptctl.description.readers.xml_elements import attribute, number, numbers, only, refuse, required
from adaptctl.description.visual import Box, Color, Cylinder, Mesh, Solid, Sphere, Visual
from adaptctl.errors import InputError

SUFFIXES = (".dae", ".glb", ".obj", ".stl")
"""Mesh formats of a single file."""
ROBOT_FOLDERS = ("urdf", "robots", "mjcf")
"""Names of folders in packages that hold robots' files beside folders of meshes."""
MIN_MESH_BYTES, MAX_MESH_BYTES = 200, 8_000_000
"""Bytes of a mesh that is shown. What is smaller only points to where the mesh is stored."""


def materials(robot: Element) -> dict[str, Color]:
    """Colours of all named <material> elements of a URDF file."""
    colors = ((element.get("name", ""), _own_color(element)) for element in robot.iter("material"))
    return {name: color for name, color in colors if name and color is not None}


def visuals(body: Element, meshes: Meshes, colors: Mapping[str, Color]) -> Iterator[Visual]:
    """Shapes to draw of a URDF <link> element."""
    for element in body.findall("visual"):
        try:
            solid = _solid(element, meshes)
            pose = origin_pose(element, "visual")
        except InputError:
            continue
        if solid is not None:
            yield Visual(GROUND, pose, solid, _color(element, colors))


def _solid(visual: Element, meshes: Meshes) -> Solid | None:
    geometry = required(visual, "geometry", "visual")
    for element in geometry:
        if element.tag == "mesh":
            path = meshes.found(attribute(element, "filename", "mesh"))
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


@dataclass
class Meshes:
    """Mesh files that the URDF file at `file` may show."""

    file: Path
    folders: Sequence[str | Path] = ()
    outside: list[str] = field(default_factory=list)

    def found(self, name: str) -> Path | None:
        """Path of a mesh file, None where none may be shown."""
        scheme, _, rest = name.rpartition("://")
        path = PurePosixPath(rest)
        if scheme not in ("", "file", "package") or path.suffix.lower() not in SUFFIXES:
            return None
        tails = [path, PurePosixPath(*path.parts[1:])] if scheme == "package" and len(path.parts) > 1 else [path]
        shown = [place for folder in self._places for tail in tails if _is_shown(place := folder / tail)]
        within = [place for place in shown if _is_within(place, self._roots)]
        if shown and not within:
            self.outside.append(name)
        return within[0] if within else None

    @cached_property
    def _roots(self) -> list[Path]:
        folder = self.file.absolute().parent
        above = dict.fromkeys(path for file in (self.file.absolute(), self.file.resolve()) for path in file.parents)
        packages = [path for path in above if (path / "package.xml").is_file()]
        return [folder, *([folder.parent] if folder.name in ROBOT_FOLDERS else []), *packages, *map(Path, self.folders)]

    @cached_property
    def _places(self) -> list[Path]:
        between = (folder for folder in self.file.absolute().parents if _is_within(folder, self._roots))
        return list(dict.fromkeys([*between, *self._roots, *(root.parent for root in self._roots)]))


def _is_within(path: Path, roots: Sequence[Path]) -> bool:
    """True where a path, links followed, is in one of the folders."""
    return any(path.resolve().is_relative_to(root.resolve()) for root in roots)


def _is_shown(path: Path) -> bool:
    try:
        return path.is_file() and MIN_MESH_BYTES <= path.stat().st_size <= MAX_MESH_BYTES
    except (OSError, ValueError):
        return False


def origin_pose(element: Element, where: str) -> Pose:
    """Pose of an element's <origin>, by rpy or quat_xyzw."""
    origin = only(element, "origin", where)
    if origin is None:
        return Pose.identity()
    rpy, xyz = (numbers(origin, name, 3, where) if name in origin.attrib else [0.0] * 3 for name in ("rpy", "xyz"))
    if "quat_xyzw" not in origin.attrib:
        return Pose(roll_pitch_yaw(rpy), np.array(xyz))
    if "rpy" in origin.attrib:
        refuse(origin, f"{where}: <origin> has rpy and quat_xyzw; give one of them")
    x, y, z, w = numbers(origin, "quat_xyzw", 4, where)
    try:
        return Pose(quaternion_rotation([w, x, y, z]), np.array(xyz))
    except InputError:
        refuse(origin, f"{where}: quat_xyzw of <origin> must not be zero")


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
