"""Arms in three dimensions, in a rerun recording."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import GROUND, Description
from adaptctl.description.pose import rotation_quaternions
from adaptctl.description.visual import Box, Cylinder, Mesh, Visual
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import LinkPoses, link_poses
from adaptctl.recording.colors import BASE, BODY, Color
from adaptctl.recording.skeleton import ROOT_RADIUS, Shape, Skeleton, Solid, tip_path
from adaptctl.recording.views import TIMELINE

WORLD = "world"
# Quaternion x, y, z, w of no turn
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
# Size of an arrow of no force
LEAST_SCALE = 1e-6
# Opacity of what is translucent, of 255
GHOST_OPACITY = 70


def log_poses(recording: rr.RecordingStream, name: str, mechanism: Mechanism, time: Array, poses: LinkPoses) -> None:
    """Let entities below "world" move as the links of a mechanism, by their poses (T, N)."""
    turns = np.roll(rotation_quaternions(poses.rotations), -1, axis=-1)  # x, y, z, w
    for i, link in enumerate(mechanism.links):
        turned = np.ascontiguousarray(turns[:, i])
        moved = rr.Transform3D.columns(translation=poses.translations[:, i], quaternion=turned)
        recording.send_columns(f"{WORLD}/{name}/{entity(link.name)}", [rr.TimeColumn(TIMELINE, duration=time)], moved)


def log_arm(
    recording: rr.RecordingStream,
    name: str,
    mechanism: Mechanism,
    parts: Skeleton,
    time: Array,
    p: Array,
    color: Color,
    *,
    ghost: bool = False,
) -> Array:
    """Draw a moving arm, and return the path (T, 3) of its tip in m in the world's frame."""
    poses, shown = link_poses(mechanism, p), visuals(mechanism.description)
    log_poses(recording, name, mechanism, time, poses)
    for i, link in enumerate(mechanism.links):
        path = f"{WORLD}/{name}/{entity(link.name)}"
        own = _log_visuals(recording, path, shown.get(i, ()), color if ghost else BODY, ghost)
        for solid in (Solid.TOOL,) if own else Solid:
            shapes = [shape for shape in parts.shapes if shape.link == i and shape.solid is solid]
            paint = BODY if solid is Solid.LINK and not ghost else color
            if shapes:
                recording.log(f"{path}/{solid.value}", _drawn(solid, shapes, paint, ghost), static=True)
    return tip_path(parts, *poses)


def log_trail(recording: rr.RecordingStream, name: str, time: Array, path: Array, color: Color) -> None:
    """Draw the trail of a tip, a piece at each time, of which `views.arm` shows the last 4 s."""
    if len(path) < 2:
        return
    strips = np.stack([path[:-1], path[1:]], axis=1, dtype=np.float32, casting="same_kind")
    count = len(strips)
    recording.send_columns(
        f"{WORLD}/{name}",
        [rr.TimeColumn(TIMELINE, duration=time[1:])],
        rr.LineStrips3D.columns(strips=strips, radii=np.full(count, 0.0045), colors=np.full((count, 3), color)),
    )


def log_arrows(
    recording: rr.RecordingStream, name: str, time: Array, points: Array, forces: Array, reach: float, color: Color
) -> None:
    """Draw forces (T, 3) in N as an arrow to points (T, 3), a third of the arm's reach for the largest."""
    length = [0, 0, reach / 3]  # from outside of the arm, whose links would hide one from the point on
    arrow = rr.Arrows3D(origins=[np.negative(length)], vectors=[length], radii=[reach / 90], colors=[color])
    recording.log(f"{WORLD}/{name}", arrow, static=True)
    sizes = np.linalg.norm(forces, axis=1)
    # An arrow of its own for each time would be drawn for all times of the trail's 4 s: poses are only the latest.
    moved = rr.Transform3D.columns(
        translation=points,
        quaternion=np.array([_turned_up(force) if force.any() else UPRIGHT for force in forces]),
        scale=np.repeat(np.maximum(sizes / sizes.max(), LEAST_SCALE)[:, None], 3, axis=1),
    )
    recording.send_columns(f"{WORLD}/{name}", [rr.TimeColumn(TIMELINE, duration=time)], moved)


def log_surroundings(recording: rr.RecordingStream, name: str, surroundings: Sequence[Visual]) -> None:
    """Draw what stands beside an arm, translucent, so that it hides neither arm nor force."""
    _log_visuals(recording, f"{WORLD}/{name}", surroundings, BODY, ghost=True)


def log_path(recording: rr.RecordingStream, name: str, path: Array, color: Color) -> None:
    """Draw the whole path (T, 3) of a tip, the same at all times."""
    line = rr.LineStrips3D([path], radii=[0.002], colors=[(*color, 110)])
    recording.log(f"{WORLD}/{name}", line, static=True)


def log_base(
    recording: rr.RecordingStream, mechanism: Mechanism, parts: Skeleton, floor: float, name: str = "base"
) -> None:
    """Draw the fixed shapes of a mechanism, and pedestals down to the floor."""
    radius = 1.15 * ROOT_RADIUS * parts.reach
    feet = np.array([link.parent_to_joint.translation for link in mechanism.links if link.parent == GROUND])
    shown = visuals(mechanism.description)
    if own := _log_visuals(recording, f"{WORLD}/{name}", shown.get(GROUND, ()), BASE, False):
        lowest = min(float(visual.pose.translation[2]) for visual in own)
        feet[:, 2] = np.minimum(feet[:, 2], max(lowest, floor))
    feet = feet[_may_have_pedestal(mechanism, feet, 2.2 * radius)]
    if not len(feet):
        return
    heights = feet[:, 2] - floor
    centers = np.column_stack([feet[:, 0], feet[:, 1], floor + heights / 2.0])
    plate = np.column_stack([feet[:, 0], feet[:, 1], np.full(len(feet), floor + 0.1 * radius)])
    pedestal = rr.Cylinders3D(
        lengths=[*heights, *np.full(len(feet), 0.2 * radius)],
        radii=[*np.full(len(feet), radius), *np.full(len(feet), 2.2 * radius)],
        centers=np.concatenate([centers, plate]),
        colors=[BASE],
        fill_mode=rr.components.FillMode.Solid,
    )
    recording.log(f"{WORLD}/{name}", pedestal, static=True)


def _may_have_pedestal(mechanism: Mechanism, feet: Array, radius: float) -> NDArray[np.bool_]:
    """Mask (n,) of the feet that a pedestal may be under: none of a body that hangs."""
    if mechanism.description.loops is not None:  # loops may not close with all joints at zero
        return np.ones(len(feet), dtype=np.bool_)
    origins = link_poses(mechanism, np.zeros(len(mechanism.primary_joints))).translations
    apart = np.linalg.norm(origins[None, :, :2] - feet[:, None, :2], axis=-1)
    below = origins[None, :, 2] < feet[:, None, 2] - radius
    return np.full(len(feet), not bool(((apart < radius) & below).any()))


def entity(name: str) -> str:
    """Name as one part of an entity path, other characters as underscores."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name)


def _look(color: Color, ghost: bool) -> dict[str, Any]:
    """Color and filling of a solid: opaque, or a translucent ghost."""
    modes = rr.components.FillMode
    filled = modes.TransparentFillMajorWireframe if ghost else modes.Solid
    return {"colors": [(*color, GHOST_OPACITY if ghost else 255)], "fill_mode": filled}


def _drawn(solid: Solid, shapes: Sequence[Shape], color: Color, ghost: bool) -> rr.AsComponents:
    given = {"radii": [shape.radius for shape in shapes], **_look(color, ghost)}
    centers = [(shape.start + shape.end) / 2.0 for shape in shapes]
    if solid is Solid.TOOL:
        return rr.Ellipsoids3D(centers=centers, **given)
    turns = [rr.Quaternion(xyzw=_turned_up(shape.end - shape.start)) for shape in shapes]
    given |= {"lengths": [shape.length for shape in shapes], "quaternions": turns}
    if solid is Solid.LINK:
        return rr.Capsules3D(translations=[shape.start for shape in shapes], **given)
    return rr.Cylinders3D(centers=centers, **given)


def _turned_up(axis: Array) -> Array:
    """Quaternion x, y, z, w that turns the z axis into another, by the shortest way."""
    x, y, z = axis / np.linalg.norm(axis)
    quaternion = np.array([-y, x, 0.0, 1.0 + z]) if z > -1.0 + 1e-12 else np.array([1.0, 0.0, 0.0, 0.0])
    return np.asarray(quaternion / np.linalg.norm(quaternion))


# Kinds of meshes that the viewer reads.
MEDIA_TYPES = {
    ".dae": "model/vnd.collada+xml",
    ".glb": "model/gltf-binary",
    ".obj": "model/obj",
    ".stl": "model/stl",
}
# Bytes of all meshes of an arm, which a recording holds once for the arm and once for each ghost.
MAX_MESH_BYTES = 12_000_000


def visuals(description: Description) -> dict[int, list[Visual]]:
    """Shapes of a robot's file by link (-1 for the ground), without links of which a mesh cannot be read."""
    meshes = {visual.solid.path for visual in description.visuals if isinstance(visual.solid, Mesh)}
    shown = {path for path in meshes if path.suffix.lower() in MEDIA_TYPES and os.access(path, os.R_OK)}
    if sum(path.stat().st_size for path in shown) > MAX_MESH_BYTES:
        return {}
    found: dict[int, list[Visual]] = {}
    for visual in description.visuals:
        found.setdefault(visual.link, []).append(visual)
    hidden = {v.link for v in description.visuals if isinstance(v.solid, Mesh) and v.solid.path not in shown}
    return {link: own for link, own in found.items() if link not in hidden}


def _log_visuals(
    recording: rr.RecordingStream, path: str, own: Sequence[Visual], color: Color, ghost: bool
) -> Sequence[Visual]:
    for k, visual in enumerate(own):
        scale = visual.solid.scale if isinstance(visual.solid, Mesh) else None
        pose = rr.Transform3D(translation=visual.pose.translation, mat3x3=visual.pose.rotation, scale=scale)
        recording.log(f"{path}/visual/{k}", pose, _drawn_visual(visual, color, ghost), static=True)
    return own


def _drawn_visual(visual: Visual, color: Color, ghost: bool) -> rr.AsComponents:
    solid, look = visual.solid, _look(color, ghost)
    if visual.color is not None and not ghost:
        look["colors"] = [[round(255 * part) for part in visual.color]]
    if isinstance(solid, Mesh):
        kind = solid.path.suffix.lower()  # files but STL's have colours of their own
        albedo = look["colors"][0] if ghost or kind == ".stl" else None
        return rr.Asset3D(contents=solid.path.read_bytes(), media_type=MEDIA_TYPES[kind], albedo_factor=albedo)
    if isinstance(solid, Box):
        return rr.Boxes3D(sizes=[solid.size], **look)
    if isinstance(solid, Cylinder):
        return rr.Cylinders3D(lengths=[solid.length], radii=[solid.radius], **look)
    return rr.Ellipsoids3D(radii=[solid.radius], **look)
