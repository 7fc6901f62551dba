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
from adaptctl.dynamics.loops.constraint import product
from adaptctl.identifiability.proof.simplest import Precision
from adaptctl.scalars import Mat, Vec, cross, dot


class Frame(NamedTuple):
    """A frame in another one, in floats."""

    rotation: Mat
    origin: Vec

    @classmethod
    def of(cls, pose: Pose) -> Frame:
        """The same as a pose."""
        return cls(Mat.of(pose.rotation.tolist()), Vec(*pose.translation.tolist()))

    def __matmul__(self, inner: Frame) -> Frame:
        """The frame that stands at `inner` in this one."""
        return Frame(product(self.rotation, inner.rotation), self.rotation @ inner.origin + self.origin)

    @property
    def inverse(self) -> Frame:
        """The other frame in this one."""
        back = self.rotation.T
        return Frame(back, -(back @ self.origin))


class Placement(NamedTuple):
    """A frame in another one: R = Rz(yaw) Rx(tilt) Rz(spin), origin (radius cos(bearing), radius sin(bearing), height).

    Angles in rad, lengths in m.
    """

    yaw: float
    tilt: float
    spin: float
    bearing: float
    radius: float
    height: float

    @classmethod
    def of(cls, frame: Frame, length: float, precision: Precision) -> Placement:
        """The same as a frame in a mechanism of a length (m); what is less than the precision is zero."""
        up, out = frame.rotation.T.z, frame.rotation.z
        across = math.hypot(up.x, up.y)
        tilt = math.atan2(across, up.z)
        if across <= precision.angle:
            first = frame.rotation.T.x
            yaw, spin = _bearing(first.x, first.y, precision), 0.0
        else:
            yaw, spin = _bearing(-up.y, up.x, precision), _bearing(out.y, out.x, precision)
        x, y, z = frame.origin
        radius = math.hypot(x, y)
        bearing = _bearing(x, y, precision) if radius > precision.length * length else 0.0
        return cls(yaw, tilt, spin, bearing, radius, z)


@dataclass(frozen=True)
class CanonicalJoint:
    """A joint by its frame in that of the joint before (world's, z up, on the ground) and its link's frame in its own.

    Its coordinate is the file's and `shift`.
    """

    joint: Placement
    link: Placement
    shift: float


@dataclass(frozen=True)
class CanonicalFrames:
    """All joints' placements, and frames on links by whom the placements of other things can be told."""

    joints: tuple[CanonicalJoint, ...]
    on_links: tuple[Frame, ...]
    """(N + 1,): every joint's frame in its link's; the last is the ground's, in the world"""
    length: float
    precision: Precision

    def placement(self, link: int, pose: Pose) -> Placement:
        """A frame that is fixed to a link, or to the ground (-1)."""
        return Placement.of(self.on_links[link].inverse @ Frame.of(pose), self.length, self.precision)


def canonical_frames(description: Description, length: float, precision: Precision) -> CanonicalFrames:
    """Of a mechanism's tree, links in depth-first order."""
    links = description.links
    children: dict[int, list[int]] = {i: [] for i in range(GROUND, len(links))}
    for i, link in enumerate(links):
        children[link.parent].append(i)
    nears = [Frame.of(link.near) for link in links]
    axes = [Vec(*link.joint.axis.tolist()) for link in links]

    def gauged(frame: Frame, link: int) -> tuple[Frame, float]:
        carried = ((frame.inverse @ nears[k], axes[k]) for k in children[link])
        angle = _gauge(carried, frame.inverse, length, precision)
        return Frame(product(frame.rotation, about_z(math.cos(angle), math.sin(angle))), frame.origin), angle

    on_links = {GROUND: gauged(_upright(description), GROUND)[0]}
    joints = []
    for i, link in enumerate(links):
        standing = on_links[link.parent].inverse @ nears[i]
        turns = link.joint.kind.turns
        placed = _axis_frame(standing, axes[i], turns, length, precision)
        on_link, shift = Frame.of(link.far).inverse @ standing.inverse @ placed, 0.0
        if turns:
            on_link, angle = gauged(on_link, i)
            shift = angle
        on_links[i] = on_link
        joints.append(
            CanonicalJoint(
                Placement.of(placed, length, precision), Placement.of(on_link.inverse, length, precision), shift
            )
        )
    return CanonicalFrames(tuple(joints), tuple(on_links[i] for i in (*range(len(links)), GROUND)), length, precision)


def about_z(c: float, s: float) -> Mat:
    """Child to parent coordinates after a turn about z."""
    return Mat(Vec(c, -s, 0.0), Vec(s, c, 0.0), Vec(0.0, 0.0, 1.0))


def _axis_frame(standing: Frame, axis: Vec, turns: bool, length: float, precision: Precision) -> Frame:
    """A frame on a joint's axis, x along the common normal with the z axis; at the foot of that normal if the joint
    turns, and else, since a sliding joint's axis has no place, at the origin."""
    u, m = standing.rotation @ axis, standing.origin
    across, radius = math.hypot(u.x, u.y), math.hypot(m.x, m.y)
    if across > precision.angle:
        normal = Vec(-u.y / across, u.x / across, 0.0)
        along = (m.x * u.x + m.y * u.y) / across
        slide = -along / across if abs(along) > precision.length * length else 0.0
    else:
        far = turns and radius > precision.length * length
        normal = Vec(m.x / radius, m.y / radius, 0.0) if far else Vec(1.0, 0.0, 0.0)
        u = Vec(0.0, 0.0, math.copysign(1.0, u.z))
        slide = -m.z / u.z
    rotation = Mat(normal, cross(u, normal), u).T
    return Frame(rotation, m + slide * u if turns else Vec(0.0, 0.0, 0.0))


def _gauge(carried: Iterable[tuple[Frame, Vec]], link: Frame, length: float, precision: Precision) -> float:
    """The bearing of the first joint that the link carries and that has one, else of the link's own frame."""
    for standing, axis in carried:
        u, m = standing.rotation @ axis, standing.origin
        if math.hypot(u.x, u.y) > precision.angle:
            return _bearing(-u.y, u.x, precision)
        if math.hypot(m.x, m.y) > precision.length * length:
            return _bearing(m.x, m.y, precision)
    return Placement.of(link, length, precision).yaw


def _bearing(x: float, y: float, precision: Precision) -> float:
    """The angle of a direction in the plane, a multiple of a right one where it nearly is."""
    angle = math.atan2(y, x)
    quarters = round(angle / (math.pi / 2))
    return quarters * (math.pi / 2) if abs(angle - quarters * (math.pi / 2)) <= precision.angle else angle


def _upright(description: Description) -> Frame:
    """The world, turned until z is up."""
    g = Vec(*description.gravity.tolist())
    strength = math.sqrt(dot(g, g))
    up = (-1.0 / strength) * g if strength > 0.0 else Vec(0.0, 0.0, 1.0)
    helper = min((Vec(1.0, 0.0, 0.0), Vec(0.0, 1.0, 0.0), Vec(0.0, 0.0, 1.0)), key=lambda e: abs(dot(e, up)))
    side = cross(helper, up)
    x = (1.0 / math.sqrt(dot(side, side))) * side
    return Frame(Mat(x, cross(up, x), up).T, Vec(0.0, 0.0, 0.0))
