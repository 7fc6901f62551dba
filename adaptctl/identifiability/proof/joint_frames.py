"""Canonical joint frames, with simple rational angles and lengths."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

from adaptctl.description import GROUND, Description, Pose
from adaptctl.dynamics.recursion.segment import AxisRotation
from adaptctl.scalars import Mat, Vec, cross, dot, product

# Parts of one in which floats are read.
_UNITS = 10**15


# Axes (0, 1, 2 for x, y, z) and angles (rad): the product of the turns about them, in this order.
Turns = tuple[tuple[int, float], ...]
QUARTER = math.pi / 2


class Precision(NamedTuple):
    """Tolerances of angles (rad), lengths and other numbers."""

    angle: float
    # Lengths shorter than this, of the mechanism's, are meant to be zero.
    length: float
    number: float


# Round-off. A file that says 1.57079632679 misses a right angle by 5e-12.
AS_GIVEN = Precision(1e-11, 1e-11, 1e-12)
# What a person who rounds may have meant.
AS_MEANT = Precision(1e-3, 1e-4, 1e-5)


class Turn(NamedTuple):
    """Angle as quarter turns and the rational half-angle tangent of the rest."""

    quarters: int
    half_tangent: Fraction

    @property
    def cosine_and_sine(self) -> tuple[Fraction, Fraction]:
        """Cosine and sine as fractions on the unit circle."""
        square = self.half_tangent**2
        c, s = (1 - square) / (1 + square), 2 * self.half_tangent / (1 + square)
        return ((c, s), (-s, c), (-c, -s), (s, -c))[self.quarters]


def simplest_rational(x: float, size: float = 1.0, precision: Precision = AS_GIVEN) -> Fraction:
    """Fraction of least denominator near a float, such as 1/3 for 0.333333333333."""
    return Fraction(0) if abs(x) <= precision.length * size else _near(x, size, precision.number)


def _near(x: float, size: float, distance: float) -> Fraction:
    power, (over, under) = math.floor(math.log10(size)), abs(x).as_integer_ratio()
    up, down = 10 ** max(power, 0), 10 ** max(-power, 0)  # the unit is up/down
    middle, around = round(Fraction(over * down * _UNITS, under * up)), round(distance * _UNITS)
    n, d = _simplest(max(middle - around, 1), middle + around, _UNITS)
    return Fraction((n if x > 0.0 else -n) * up, d * down)


def turn(angle: float, precision: Precision = AS_GIVEN) -> Turn:
    """Angle in rad as exact numbers."""
    quarters = round(angle / (math.pi / 2))
    rest = angle - quarters * (math.pi / 2)
    small = abs(rest) <= precision.angle
    return Turn(quarters % 4, Fraction(0) if small else _near(math.tan(0.5 * rest), 1.0, precision.number))


def _simplest(low: int, high: int, over: int) -> tuple[int, int]:
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
    """Coordinate rotations whose product is a rotation matrix."""
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
    """Angle, snapped to a multiple of 90 degrees."""
    quarters = round(angle / QUARTER)
    return quarters * QUARTER if abs(angle - quarters * QUARTER) <= precision.angle else angle


def turned(axis: int, c: Any, s: Any) -> Mat:
    """Rotation matrix about a coordinate axis, from cosine and sine."""
    return AxisRotation(axis, c, -s)


class FloatFrame(NamedTuple):
    """Pose of a frame in Python floats."""

    rotation: Mat
    origin: Vec

    @classmethod
    def of(cls, pose: Pose) -> FloatFrame:
        """Pose as Python floats."""
        return cls(Mat(*(Vec(*row) for row in pose.rotation.tolist())), Vec(*pose.translation.tolist()))

    def __matmul__(self, inner: FloatFrame) -> FloatFrame:
        """Frame that is at `inner` in this one."""
        return FloatFrame(product(self.rotation, inner.rotation), self.rotation @ inner.origin + self.origin)

    @property
    def inverse(self) -> FloatFrame:
        """Inverse pose."""
        back = self.rotation.T
        return FloatFrame(back, -(back @ self.origin))


class FramePlacement(NamedTuple):
    """Pose of a frame, by angles in rad and lengths in m."""

    turns: Turns
    bearing: float
    radius: float
    height: float

    @classmethod
    def of(cls, frame: FloatFrame, length: float, precision: Precision) -> FramePlacement:
        """Pose of a frame with nearly special values made exact."""
        radius = _across(frame.origin)
        angle = _bearing(frame.origin, precision) if radius > precision.length * length else 0.0
        return cls(turns_of(frame.rotation, precision), angle, radius, _height(frame.origin))


@dataclass(frozen=True)
class CanonicalJoint:
    """Placements of a joint and of its link."""

    joint: FramePlacement
    link: FramePlacement
    shift: float


@dataclass(frozen=True)
class CanonicalFrames:
    """Joint poses from axis to axis, independent of the file's frames."""

    joints: tuple[CanonicalJoint, ...]
    on_links: tuple[FloatFrame, ...]
    length: float
    precision: Precision

    def placement(self, link: int, pose: Pose) -> FramePlacement:
        """Pose of a frame fixed to a link, in the link's joint frame."""
        return FramePlacement.of(self.on_links[link].inverse @ FloatFrame.of(pose), self.length, self.precision)


def canonical_frames(description: Description, length: float, precision: Precision) -> CanonicalFrames:
    """Canonical joint poses of a tree (Denavit and Hartenberg 1955)."""
    links = description.links
    children: dict[int, list[int]] = {i: [] for i in range(GROUND, len(links))}
    for i, link in enumerate(links):
        children[link.parent].append(i)
    nears = [FloatFrame.of(link.parent_to_joint) for link in links]
    axes = [Vec(*link.joint.axis.tolist()) for link in links]

    def gauged(frame: FloatFrame, link: int) -> tuple[FloatFrame, float]:
        back = frame.inverse
        angle = _gauge(((back @ nears[k], axes[k]) for k in children[link]), back.rotation, length, precision)
        return FloatFrame(product(frame.rotation, turned(2, math.cos(angle), math.sin(angle))), frame.origin), angle

    on_links = {GROUND: gauged(_upright(description), GROUND)[0]}
    joints = []
    for i, link in enumerate(links):
        at_joint = on_links[link.parent].inverse @ nears[i]
        turns = link.joint.kind.is_revolute
        placed = _axis_frame(at_joint, axes[i], turns, length, precision)
        on_link, shift = FloatFrame.of(link.joint_to_link).inverse @ at_joint.inverse @ placed, 0.0
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


def _axis_frame(at_joint: FloatFrame, axis: Vec, turns: bool, length: float, precision: Precision) -> FloatFrame:
    u, m = at_joint.rotation @ axis, at_joint.origin
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
    for at_joint, axis in carried:
        u, m = at_joint.rotation @ axis, at_joint.origin
        if _across(u) > precision.angle:
            return _bearing(_normal(u), precision)
        if _across(m) > precision.length * length:
            return _bearing(m, precision)
    up = link.T.z
    return _bearing(_normal(up) if _across(up) > precision.angle else link.T.x, precision)


def _across(u: Vec) -> float:
    x, y, _ = u
    return math.hypot(x, y)


def _height(u: Vec) -> float:
    _, _, z = u
    return float(z)


def _normal(u: Vec) -> Vec:
    return Vec(-u.y, u.x, 0.0)


def _bearing(u: Vec, precision: Precision) -> float:
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
