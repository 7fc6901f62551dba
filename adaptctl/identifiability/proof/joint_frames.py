"""The joints of a mechanism as angles and lengths that do not depend on how its file puts frames.

Every link gets a frame with z along its joint's axis, and x along the common normal of that axis and the first that it
carries (Denavit and Hartenberg 1955). Axes that are parallel, meet, or stand at right angles then have angles and
lengths of exactly zero or a quarter turn, up to round-off, however skew the file's frames are.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from adaptctl.description import GROUND, Description, Pose
from adaptctl.identifiability.proof.simplest import Precision
from adaptctl.identifiability.proof.turns import Turns, bearing, turned, turns_of
from adaptctl.scalars import Mat, Vec, cross, dot, product


class FloatFrame(NamedTuple):
    """The pose of a frame in another one, in floats: `rotation` (3, 3) turns its coordinates into the other's, `origin`
    (3,) is its origin there in m. `a @ b` is the pose, in the parent frame of `a`, of the frame whose pose in the frame
    of `a` is `b`. Nothing is checked."""

    rotation: Mat
    origin: Vec

    @classmethod
    def of(cls, pose: Pose) -> FloatFrame:
        """The `pose`, a rotation matrix and a translation in m, as a `FloatFrame`, whose entries are Python floats.
        Nothing is checked."""
        return cls(Mat.of(pose.rotation.tolist()), Vec(*pose.translation.tolist()))

    def __matmul__(self, inner: FloatFrame) -> FloatFrame:
        """The frame that stands at `inner` in this one."""
        return FloatFrame(product(self.rotation, inner.rotation), self.rotation @ inner.origin + self.origin)

    @property
    def inverse(self) -> FloatFrame:
        """The inverse pose, a `FloatFrame`: if this one is the pose of a frame B in a frame A, it is that of A in B,
        with its origin in m."""
        back = self.rotation.T
        return FloatFrame(back, -(back @ self.origin))


class FramePlacement(NamedTuple):
    """The pose of a frame in another one, by angles in rad and lengths in m. `turns` are the turns about coordinate
    axes whose product is its rotation, pairs of an axis (0, 1, 2 for x, y, z) and an angle, and its origin is (radius
    cos(bearing), radius sin(bearing), height). Nothing is checked."""

    turns: Turns
    bearing: float
    radius: float
    height: float

    @classmethod
    def of(cls, frame: FloatFrame, length: float, precision: Precision) -> FramePlacement:
        """The pose of a `frame` by angles in rad and lengths in m, from its rotation matrix and origin in floats, in a
        mechanism of characteristic `length` in m. Angles that are within the `precision` of a multiple of 90 degrees
        are made that multiple. So is the bearing, the angle about z from the x axis to the origin's projection on the
        xy plane; it is 0 for an origin on the z axis, up to the precision. Nothing is checked."""
        radius = _across(frame.origin)
        angle = _bearing(frame.origin, precision) if radius > precision.length * length else 0.0
        return cls(turns_of(frame.rotation, precision), angle, radius, _height(frame.origin))


@dataclass(frozen=True)
class CanonicalJoint:
    """A joint of a tree whose frame is fixed by joint axes and common normals alone (as Denavit and Hartenberg's are),
    not by the frames that a file uses. `joint` is the pose of its frame, with z along its axis, in the frame of the
    joint before it (for a joint on the ground, in the world turned until z is up), and `link` the pose of its link's
    frame in the joint's own frame; both are `FramePlacement`s, angles in rad and lengths in m. The joint's position is
    the file's plus `shift`, in rad for a revolute joint, 0 for a prismatic one. Nothing is checked."""

    joint: FramePlacement
    link: FramePlacement
    shift: float


@dataclass(frozen=True)
class CanonicalFrames:
    """The poses of all N joints of a tree from axis to axis, which do not depend on where the file puts frames.

    `joints` (N,) are in the links' order; `on_links` (N + 1,) are the poses of each joint's frame in the frame of its
    link, the last one being that of the ground (the world turned until z is up) in the world. `length` is the
    mechanism's characteristic length in m, `precision` the differences that were taken as round-off. Made by
    `canonical_frames`; nothing is checked.
    """

    joints: tuple[CanonicalJoint, ...]
    on_links: tuple[FloatFrame, ...]
    """(N + 1,): every joint's frame in its link's; the last is the ground's, in the world"""
    length: float
    precision: Precision

    def placement(self, link: int, pose: Pose) -> FramePlacement:
        """The pose, in the frame of a link's joint, of a frame fixed to that link at `pose` in the link's own frame, as
        a `FramePlacement`: angles in rad, lengths in m. `link` is the link's zero-based index; -1, or the number N of
        links, is the ground, for which `pose` is in the world and the result relative to the world turned until z is
        up. Raises `IndexError` for an index above N."""
        return FramePlacement.of(self.on_links[link].inverse @ FloatFrame.of(pose), self.length, self.precision)


def canonical_frames(description: Description, length: float, precision: Precision) -> CanonicalFrames:
    """Poses of all joints of a tree from axis to axis (Denavit and Hartenberg 1955), which do not depend on where its
    `description` puts frames, as `CanonicalFrames`. Each joint gets a frame with z along its axis; its pose is given in
    the frame of the joint before it.

    Of a revolute joint, x is along the common normal of its axis and that of the first joint on its link that
    determines one; failing that, along its normal with the z axis of the link's own frame, or along that frame's x axis
    where z is parallel. Of a prismatic joint, x is along the common normal with the z axis of the frame before, or
    along its x axis where they are parallel. `length` is the mechanism's characteristic length in m, `precision` the
    differences that are taken as round-off. Nothing is checked.
    """
    links = description.links
    children: dict[int, list[int]] = {i: [] for i in range(GROUND, len(links))}
    for i, link in enumerate(links):
        children[link.parent].append(i)
    nears = [FloatFrame.of(link.near) for link in links]
    axes = [Vec(*link.joint.axis.tolist()) for link in links]

    def gauged(frame: FloatFrame, link: int) -> tuple[FloatFrame, float]:
        carried = ((frame.inverse @ nears[k], axes[k]) for k in children[link])
        angle = _gauge(carried, frame.inverse.rotation, length, precision)
        return FloatFrame(product(frame.rotation, turned(2, math.cos(angle), math.sin(angle))), frame.origin), angle

    on_links = {GROUND: gauged(_upright(description), GROUND)[0]}
    joints = []
    for i, link in enumerate(links):
        standing = on_links[link.parent].inverse @ nears[i]
        turns = link.joint.kind.turns
        placed = _axis_frame(standing, axes[i], turns, length, precision)
        on_link, shift = FloatFrame.of(link.far).inverse @ standing.inverse @ placed, 0.0
        if turns:
            on_link, angle = gauged(on_link, i)
            shift = angle
        on_links[i] = on_link
        joints.append(
            CanonicalJoint(
                FramePlacement.of(placed, length, precision),
                FramePlacement.of(on_link.inverse, length, precision),
                shift,
            )
        )
    return CanonicalFrames(tuple(joints), tuple(on_links[i] for i in (*range(len(links)), GROUND)), length, precision)


def _axis_frame(standing: FloatFrame, axis: Vec, turns: bool, length: float, precision: Precision) -> FloatFrame:
    """A frame on a joint's axis, x along the common normal with the z axis; at the foot of that normal if the joint
    turns, and else, since a sliding joint's axis has no place, at the origin."""
    u, m = standing.rotation @ axis, standing.origin
    across, radius = _across(u), _across(m)
    if across > precision.angle:
        normal = (1.0 / across) * _normal(u)
        along = dot(m, cross(normal, Vec(0.0, 0.0, 1.0)))
        slide = -along / across if abs(along) > precision.length * length else 0.0
    else:
        far = turns and radius > precision.length * length
        normal = (1.0 / radius) * Vec(m.x, m.y, 0.0) if far else Vec(1.0, 0.0, 0.0)
        u = Vec(0.0, 0.0, math.copysign(1.0, _height(u)))
        slide = -m.z / u.z
    rotation = Mat(normal, cross(u, normal), u).T
    return FloatFrame(rotation, m + slide * u if turns else Vec(0.0, 0.0, 0.0))


def _gauge(carried: Iterable[tuple[FloatFrame, Vec]], link: Mat, length: float, precision: Precision) -> float:
    """The bearing of the first joint that the link carries and that has one, else of the link's own frame."""
    for standing, axis in carried:
        u, m = standing.rotation @ axis, standing.origin
        if _across(u) > precision.angle:
            return _bearing(_normal(u), precision)
        if _across(m) > precision.length * length:
            return _bearing(m, precision)
    up = link.T.z
    return _bearing(_normal(up) if _across(up) > precision.angle else link.T.x, precision)


def _across(u: Vec) -> float:
    """The length of a vector's share in the plane across z."""
    x, y, _ = u
    return math.hypot(x, y)


def _height(u: Vec) -> float:
    """A vector's share along z."""
    _, _, z = u
    return float(z)


def _normal(u: Vec) -> Vec:
    """z x u, which is along the common normal of z and a line along u."""
    return Vec(-u.y, u.x, 0.0)


def _bearing(u: Vec, precision: Precision) -> float:
    """The angle of a vector's share in that plane, a multiple of a right one where it nearly is."""
    x, y, _ = u
    return bearing(math.atan2(y, x), precision)


def _upright(description: Description) -> FloatFrame:
    """The world, turned until z is up."""
    g = Vec(*description.gravity.tolist())
    strength = math.sqrt(dot(g, g))
    up = (-1.0 / strength) * g if strength > 0.0 else Vec(0.0, 0.0, 1.0)
    shares = [abs(share) for share in up]
    level = shares.index(min(shares))  # the axis of the world that is nearest to level
    side = cross(Vec(*(float(k == level) for k in range(len(shares)))), up)
    x = (1.0 / math.sqrt(dot(side, side))) * side
    return FloatFrame(Mat(x, cross(up, x), up).T, Vec(0.0, 0.0, 0.0))
