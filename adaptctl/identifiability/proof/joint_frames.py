"""Joint frames from axis to axis, and the simplest rational numbers near their angles and lengths."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

from adaptctl.description import GROUND, Description, Pose
from adaptctl.scalars import Mat, Vec, cross, dot, product

_UNITS = 10**15
"""Parts of one in which floats are read."""


Turns = tuple[tuple[int, float], ...]
"""Axes (0, 1, 2 for x, y, z) and angles (rad): the product of the turns about them, in this order."""
QUARTER = math.pi / 2


class Precision(NamedTuple):
    """The differences of floats that are taken as zero. `angle`, in rad, is how far from a multiple of a right angle an
    angle counts as one; lengths below `length` times the mechanism's characteristic length (the largest offset from
    joint to joint or to a link's frame) count as zero; numbers of size about one that differ by less than `number`
    count as the same. Nothing is checked."""

    angle: float
    length: float
    """Lengths shorter than this, of the mechanism's, are meant to be zero."""
    number: float


AS_GIVEN = Precision(1e-11, 1e-11, 1e-12)
"""Round-off. A file that says 1.57079632679 misses a right angle by 5e-12."""
AS_MEANT = Precision(1e-3, 1e-4, 1e-5)
"""What a person who rounds may have meant."""


class Turn(NamedTuple):
    """An angle as exact numbers: `quarters` times 90 degrees plus 2 atan(`half_tangent`), with `quarters` from 0 to 3
    and `half_tangent` a fraction, whose part of the angle is at most 45 degrees in size. Nothing is checked."""

    quarters: int
    half_tangent: Fraction

    @property
    def cosine_and_sine(self) -> tuple[Fraction, Fraction]:
        """The pair of the cosine and the sine of this angle, as fractions whose squares sum to exactly 1."""
        square = self.half_tangent**2
        c, s = (1 - square) / (1 + square), 2 * self.half_tangent / (1 + square)
        return ((c, s), (-s, c), (-c, -s), (s, -c))[self.quarters]


def simplest_rational(x: float, size: float = 1.0, precision: Precision = AS_GIVEN) -> Fraction:
    """The fraction of least denominator near a float `x`: 1/3 for 0.333333333333, 0 for 1e-13.

    `size`, positive and in the unit of x, is the typical size of such values (1 by default). x counts as zero where |x|
    is at most `precision.length` times `size`. Else, with u the power of ten at or below `size`, the result is u times
    the fraction of least denominator that differs from x/u by at most `precision.number`; `precision` is that of
    round-off by default. So floats that were computed in two ways from the same decimals become the same number again.
    By continued fractions (Knuth 1998, The Art of Computer Programming 2, section 4.5.3, exercise 39). Raises
    `ValueError` for NaN, `OverflowError` for infinity.
    """
    return Fraction(0) if abs(x) <= precision.length * size else _near(x, size, precision.number)


def _near(x: float, size: float, distance: float) -> Fraction:
    """The simplest fraction nearer to x, which is not zero, than a distance times a size."""
    unit = Fraction(10) ** math.floor(math.log10(size))
    middle, around = round(Fraction(abs(x)) / unit * _UNITS), round(distance * _UNITS)
    n, d = _simplest(max(middle - around, 1), middle + around, _UNITS)
    return (n if x > 0.0 else -n) * Fraction(1, d) * unit


def turn(angle: float, precision: Precision = AS_GIVEN) -> Turn:
    """An `angle` in rad as exact numbers, a `Turn`: quarter turns alone where it is within `precision.angle` of them
    (1e-11 rad by default), else also the simplest rational half tangent of the rest. Raises `ValueError` for NaN,
    `OverflowError` for infinity."""
    quarters = round(angle / (math.pi / 2))
    rest = angle - quarters * (math.pi / 2)
    small = abs(rest) <= precision.angle
    return Turn(quarters % 4, Fraction(0) if small else _near(math.tan(0.5 * rest), 1.0, precision.number))


def _simplest(low: int, high: int, over: int) -> tuple[int, int]:
    """Numerator and denominator of the simplest fraction between low/over and high/over, both positive."""
    a, b, c, d = low, over, high, over
    before, last = (0, 1), (1, 0)
    while True:
        whole = -(-a // b)
        if whole * d <= c:
            return whole * last[0] + before[0], whole * last[1] + before[1]
        whole -= 1
        before, last = last, (whole * last[0] + before[0], whole * last[1] + before[1])
        a, b, c, d = d, c - whole * d, b, a - whole * b


def turns_of(rotation: Mat, precision: Precision) -> Turns:
    """The two or three turns about coordinate axes, pairs of an axis (0, 1, 2 for x, y, z) and an angle in rad, whose
    product, in this order, is a `rotation` matrix R (3, 3) of floats. Entries of R, and differences of angles from
    right ones, that are below the `precision`'s angle in rad count as zero. Nothing is checked.

    The turns are chosen so that zeros of R come back as exact ones, with R_i(a) the turn by a about axis i. For a zero
    off the diagonal, in row i and column j, R = R_i(a) R_j(g). For one on the diagonal, in row i, R = R_i(a) R_j(90
    degrees) R_i(g), j being the axis after i. Without zeros, R = R_z(a) R_x(b) R_z(g). A rotation with more than one
    zero has at least four, all of which the two turns keep.
    """
    R = [list(row) for row in rotation]
    size, row, column = min((abs(R[i][j]), i, j) for i in range(3) for j in range(3))
    if size > precision.angle:
        tilt = math.atan2(math.hypot(R[0][2], R[1][2]), R[2][2])
        return (2, math.atan2(R[0][2], -R[1][2])), (0, tilt), (2, math.atan2(R[2][0], R[2][1]))
    j, k = (row + 1) % 3, (row + 2) % 3
    if row == column:
        a, g = math.atan2(R[j][row], -R[k][row]), math.atan2(R[row][j], R[row][k])
        return (row, bearing(a, precision)), (j, QUARTER), (row, bearing(g, precision))
    third = 3 - row - column
    sign = 1.0 if column == j else -1.0
    a, g = math.atan2(sign * R[third][column], R[column][column]), math.atan2(sign * R[row][third], R[row][row])
    return (row, bearing(a, precision)), (column, bearing(g, precision))


def bearing(angle: float, precision: Precision) -> float:
    """The `angle`, in rad, made the nearest multiple of a right angle where it is within the `precision`'s `angle` of
    that, else as given. Raises `ValueError` for NaN, `OverflowError` for infinity."""
    quarters = round(angle / QUARTER)
    return quarters * QUARTER if abs(angle - quarters * QUARTER) <= precision.angle else angle


def turned(axis: int, c: Any, s: Any) -> Mat:
    """The rotation matrix R (3, 3) of a turn about a coordinate `axis` (0, 1, 2 for x, y, z), from the cosine `c` and
    the sine `s` of its angle, scalars of any kind. It maps the coordinates y (3,) of a vector in the turned frame to
    those in the frame before the turn, R y. Nothing is checked."""
    if axis == 0:
        return Mat(Vec(1.0, 0.0, 0.0), Vec(0.0, c, -s), Vec(0.0, s, c))
    if axis == 1:
        return Mat(Vec(c, 0.0, s), Vec(0.0, 1.0, 0.0), Vec(-s, 0.0, c))
    return Mat(Vec(c, -s, 0.0), Vec(s, c, 0.0), Vec(0.0, 0.0, 1.0))


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
    nears = [FloatFrame.of(link.parent_to_joint) for link in links]
    axes = [Vec(*link.joint.axis.tolist()) for link in links]

    def gauged(frame: FloatFrame, link: int) -> tuple[FloatFrame, float]:
        carried = ((frame.inverse @ nears[k], axes[k]) for k in children[link])
        angle = _gauge(carried, frame.inverse.rotation, length, precision)
        return FloatFrame(product(frame.rotation, turned(2, math.cos(angle), math.sin(angle))), frame.origin), angle

    on_links = {GROUND: gauged(_upright(description), GROUND)[0]}
    joints = []
    for i, link in enumerate(links):
        standing = on_links[link.parent].inverse @ nears[i]
        turns = link.joint.kind.is_revolute
        placed = _axis_frame(standing, axes[i], turns, length, precision)
        on_link, shift = FloatFrame.of(link.joint_to_link).inverse @ standing.inverse @ placed, 0.0
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
