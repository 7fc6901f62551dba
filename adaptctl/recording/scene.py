"""Arms in three dimensions, in a rerun recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import GROUND, Description
from adaptctl.description.visual import Box, Cylinder, Mesh, Visual
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import LinkPoses, link_poses
from adaptctl.recording.drawing import BASE, BODY, GOAL, Color
from adaptctl.recording.skeleton import ROOT_RADIUS, Shape, Skeleton, Solid, tip_path

TIMELINE = "sim_time"
WORLD = "world"

Solids = rr.Capsules3D | rr.Cylinders3D | rr.Ellipsoids3D


@dataclass(frozen=True)
class Look:
    """Appearance of an arm in a recording: the colours of its `links` and its `joints`, and its `opacity`, from 0 to
    255. At 255, the default, it is solid, below that a translucent ghost. Nothing is checked at construction."""

    links: Color
    joints: Color
    opacity: int = 255

    @property
    def fill_mode(self) -> rr.components.FillMode:
        """Rerun's mode of filling the arm's solids: solid at an opacity of 255, else translucent with edges drawn."""
        modes = rr.components.FillMode
        return modes.Solid if self.opacity == 255 else modes.TransparentFillMajorWireframe


def solid_look(joints: Color) -> Look:
    """The appearance, a `Look`, of an arm in the foreground: opaque, with light grey links and joints of the colour
    `joints`. Nothing is raised."""
    return Look(BODY, joints)


def ghost_look(color: Color) -> Look:
    """The appearance, a `Look`, of an arm shown for comparison, a translucent ghost: all of it of one `color`, at an
    opacity of 70 of 255. Nothing is raised."""
    return Look(color, color, opacity=70)


GOAL_LOOK = ghost_look(GOAL)


def log_arm(
    recording: rr.RecordingStream,
    name: str,
    mechanism: Mechanism,
    parts: Skeleton,
    time: Array,
    p: Array,
    look: Look,
) -> Array:
    """Draw a moving arm in a rerun recording, as the entities `name`/LINK below "world", LINK being a link's name, and
    return the path of its tip (T, 3), m in the world's frame. `p` (T, r) are the positions, rad (m if prismatic), of
    its r joints at T times `time` (T,), s.

    Links have the shapes and colours of the robot's file; where it has none they are capsules, with cylinders for
    joints, the shapes in `parts`, coloured by `look`. Raises `InputError` for positions of another number of joints,
    `NonFiniteError` for NaN and infinity, `LoopError` where kinematic loops cannot be closed, `SingularityError` near a
    singularity of these.
    """
    poses, shown = link_poses(mechanism, p), visuals(mechanism.description)
    for i, link in enumerate(mechanism.links):
        path = f"{WORLD}/{name}/{entity(link.name)}"
        recording.send_columns(path, [rr.TimeColumn(TIMELINE, duration=time)], _transforms(poses, i))
        own = log_visuals(recording, path, i, shown, look.links, look.opacity)
        for solid in (Solid.TOOL,) if own else Solid:
            shapes = [shape for shape in parts.shapes if shape.link == i and shape.solid is solid]
            if shapes:
                recording.log(f"{path}/{solid.value}", _geometry(solid, shapes, look), static=True)
    return tip_path(parts, *poses)


def log_trail(recording: rr.RecordingStream, name: str, time: Array, path: Array, color: Color) -> None:
    """Draw the trail of an arm's tip in a rerun recording, as the entity `name` below "world": the positions `path` (T,
    3), m in the world's frame, at T times `time` (T,), s, joined by pieces of line. A piece is logged at the time of
    its end; the view `views.arm` shows those of the last 4 s. Fewer than two samples draw nothing. Nothing is
    checked."""
    if len(path) < 2:
        return
    strips = np.stack([path[:-1], path[1:]], axis=1)
    count = len(strips)
    recording.send_columns(
        f"{WORLD}/{name}",
        [rr.TimeColumn(TIMELINE, duration=time[1:])],
        rr.LineStrips3D.columns(
            strips=strips.tolist(), radii=np.full(count, 0.0045), colors=np.full((count, 3), color)
        ),
    )


def log_path(recording: rr.RecordingStream, name: str, path: Array, color: Color) -> None:
    """Draw the whole path of an arm's tip in a rerun recording, as the entity `name` below "world", the same at all
    times: a faint line through T positions `path` (T, 3), m in the world's frame, in their order. Nothing is
    checked."""
    line = rr.LineStrips3D([path], radii=[0.002], colors=[(*color, 110)])
    recording.log(f"{WORLD}/{name}", line, static=True)


def log_base(
    recording: rr.RecordingStream, mechanism: Mechanism, parts: Skeleton, floor: float, name: str = "base"
) -> None:
    """Draw the fixed base of a mechanism in a rerun recording, as the entity `name` below "world": the shapes that the
    robot's file fixes to the ground, and a pedestal from each link on the ground down to the floor, whose height is
    `floor`, m. A body that hangs above its own links, such as a humanoid's hips, gets none. `parts` are the shapes that
    the mechanism is drawn by; they set the pedestals' size. Nothing is raised."""
    radius = 1.15 * ROOT_RADIUS * parts.reach
    feet = np.array([link.near.translation for link in mechanism.links if link.parent == GROUND])
    shown = visuals(mechanism.description)
    if log_visuals(recording, f"{WORLD}/{name}", GROUND, shown, BASE):
        lowest = min(float(visual.pose.translation[2]) for visual in shown.of_link[GROUND])
        feet[:, 2] = np.minimum(feet[:, 2], max(lowest, floor))
    feet = feet[_stands(mechanism, feet, 2.2 * radius)]
    if not len(feet):
        return
    heights = feet[:, 2] - floor
    centers = np.stack([feet[:, 0], feet[:, 1], floor + heights / 2.0], axis=-1)
    plate = np.stack([feet[:, 0], feet[:, 1], np.full(len(feet), floor + 0.1 * radius)], axis=-1)
    pedestal = rr.Cylinders3D(
        lengths=[*heights, *np.full(len(feet), 0.2 * radius)],
        radii=[*np.full(len(feet), radius), *np.full(len(feet), 2.2 * radius)],
        centers=np.concatenate([centers, plate]),
        colors=[BASE],
        fill_mode=rr.components.FillMode.Solid,
    )
    recording.log(f"{WORLD}/{name}", pedestal, static=True)


def _stands(mechanism: Mechanism, feet: Array, radius: float) -> NDArray[np.bool_]:
    """Mask of the feet (n,) that a pedestal may stand under: none of a body that hangs, as a humanoid's hips above its
    legs do."""
    if mechanism.description.loops is not None:  # linkages stand, and may not close with all joints at zero
        return np.ones(len(feet), dtype=np.bool_)
    origins = link_poses(mechanism, np.zeros(len(mechanism.primary_joints))).translations
    apart = np.linalg.norm(origins[None, :, :2] - feet[:, None, :2], axis=-1)
    below = origins[None, :, 2] < feet[:, None, 2] - radius
    return np.full(len(feet), not bool(((apart < radius) & below).any()))


def entity(name: str) -> str:
    """The text `name` as one part of an entity path of a rerun recording: letters, digits, "-", "_" and "." stay, every
    other character becomes an underscore. Nothing is raised."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name)


def _transforms(poses: LinkPoses, link: int) -> rr.ComponentColumnList:
    return rr.Transform3D.columns(
        translation=poses.translations[:, link], quaternion=quaternions(poses.rotations[:, link])
    )


def _geometry(solid: Solid, shapes: Sequence[Shape], look: Look) -> Solids:
    radii = [shape.radius for shape in shapes]
    color = [(*(look.links if solid is Solid.LINK else look.joints), look.opacity)]
    centers = [(shape.start + shape.end) / 2.0 for shape in shapes]
    if solid is Solid.TOOL:
        return rr.Ellipsoids3D(centers=centers, radii=radii, colors=color, fill_mode=look.fill_mode)
    lengths = [shape.length for shape in shapes]
    turns = [rr.Quaternion(xyzw=_along(shape.end - shape.start)) for shape in shapes]
    if solid is Solid.LINK:
        starts = [shape.start for shape in shapes]
        return rr.Capsules3D(
            lengths=lengths,
            radii=radii,
            translations=starts,
            quaternions=turns,
            colors=color,
            fill_mode=look.fill_mode,
        )
    return rr.Cylinders3D(
        lengths=lengths,
        radii=radii,
        centers=centers,
        quaternions=turns,
        colors=color,
        fill_mode=look.fill_mode,
    )


def quaternions(rotations: Array) -> Array:
    """Unit quaternions (T, 4), in the order x, y, z, w, of T rotation matrices (T, 3, 3). Raises `ValueError` for a
    matrix whose determinant is not positive, and for NaN."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotations).as_quat())


def _along(direction: Array) -> Array:
    """Unit quaternion, x y z w, that turns the z axis into a direction (3,)."""
    x, y, z = direction / np.linalg.norm(direction)
    if z < -1.0 + 1e-12:
        return np.array([1.0, 0.0, 0.0, 0.0])
    quaternion = np.array([-y, x, 0.0, 1.0 + z])
    return quaternion / np.linalg.norm(quaternion)


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
