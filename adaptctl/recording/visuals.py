"""Visuals of links (meshes and solids of robot files), in a rerun recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import rerun as rr

from adaptctl.description import Description
from adaptctl.description.visual import Box, Cylinder, Mesh, Visual
from adaptctl.recording.palette import Color

MEDIA = {
    ".dae": "model/vnd.collada+xml",
    ".glb": "model/gltf-binary",
    ".obj": "model/obj",
    ".stl": "model/stl",
}
"""Kinds of meshes that the viewer reads."""
WITHOUT_COLOR = (".stl",)
MOST = 12_000_000
"""Bytes of all meshes of an arm, which a recording holds once for the arm and once for each ghost."""


@dataclass(frozen=True)
class Visuals:
    """Shapes of a mechanism's links, as robot files have them for drawing: `of_link` maps the zero-based index of a
    link, or -1 for the ground, to its shapes (`Visual`: meshes and plain solids), and `contents` maps the path of each
    mesh file to its bytes. Nothing is checked at construction."""

    of_link: Mapping[int, Sequence[Visual]]
    contents: Mapping[Path, bytes]


def visuals(description: Description) -> Visuals:
    """Shapes, as `Visuals`, by which a mechanism's file draws its links, with the bytes of the mesh files (.dae, .glb,
    .obj, .stl). A link with a mesh of another kind or one that cannot be read is left out, and is then drawn by
    capsules. All are left out where the meshes have more than 12 MB together, too much for a recording. Nothing is
    raised."""
    contents = _contents(description)
    if sum(len(content) for content in contents.values()) > MOST:
        return Visuals({}, {})
    of_link: dict[int, list[Visual]] = {}
    for visual in description.visuals:
        of_link.setdefault(visual.link, []).append(visual)
    whole = {link: own for link, own in of_link.items() if all(_is_there(visual, contents) for visual in own)}
    return Visuals(whole, contents)


def log_visuals(
    recording: rr.RecordingStream, path: str, link: int, shown: Visuals, color: Color, opacity: int = 255
) -> bool:
    """Draw the shapes that a robot file has for one link, in a rerun recording, at all times; return True, or False
    where it has none. `link` is the link's index from 0, or -1 for the ground; `shown` has the shapes of all links and
    the bytes of their mesh files. The shapes become the entities `path`/visual/0, 1, ...

    With an `opacity` of 255, the default, shapes have their own colours, and `color` where they have none; meshes have
    those of their files, except STL files, which hold none. Below 255 the link is a translucent ghost, all of it in
    `color`. Raises `KeyError` for a mesh whose bytes `shown` lacks.
    """
    own = shown.of_link.get(link, ())
    for k, visual in enumerate(own):
        place = f"{path}/visual/{k}"
        scale = visual.solid.scale if isinstance(visual.solid, Mesh) else None
        pose = rr.Transform3D(translation=visual.pose.translation, mat3x3=visual.pose.rotation, scale=scale)
        recording.log(place, pose, _drawn(visual, shown, color, opacity), static=True)
    return bool(own)


def _contents(description: Description) -> dict[Path, bytes]:
    contents: dict[Path, bytes] = {}
    for path in {visual.solid.path: None for visual in description.visuals if isinstance(visual.solid, Mesh)}:
        try:
            if path.suffix.lower() in MEDIA:
                contents[path] = path.read_bytes()
        except OSError:  # it was there when the mechanism was read
            continue
    return contents


def _is_there(visual: Visual, contents: Mapping[Path, bytes]) -> bool:
    return not isinstance(visual.solid, Mesh) or visual.solid.path in contents


def _drawn(visual: Visual, shown: Visuals, color: Color, opacity: int) -> rr.AsComponents:
    solid, modes, ghost = visual.solid, rr.components.FillMode, opacity < 255
    own = [round(255 * part) for part in visual.color] if visual.color is not None else [*color, 255]
    paint = [*color, opacity] if ghost else own
    if isinstance(solid, Mesh):
        kind = solid.path.suffix.lower()
        albedo = paint if ghost or kind in WITHOUT_COLOR else None
        return rr.Asset3D(contents=shown.contents[solid.path], media_type=MEDIA[kind], albedo_factor=albedo)
    fill = modes.TransparentFillMajorWireframe if ghost else modes.Solid
    if isinstance(solid, Box):
        return rr.Boxes3D(sizes=[solid.size], colors=[paint], fill_mode=fill)
    if isinstance(solid, Cylinder):
        return rr.Cylinders3D(lengths=[solid.length], radii=[solid.radius], colors=[paint], fill_mode=fill)
    return rr.Ellipsoids3D(radii=[solid.radius], colors=[paint], fill_mode=fill)
