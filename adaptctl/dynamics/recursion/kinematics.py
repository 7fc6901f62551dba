"""Forward kinematics: poses in the world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from numpy.typing import ArrayLike

from adaptctl.arrays import Array, stacked
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.dynamics.recursion.motion import AXES, GROUND
from adaptctl.dynamics.recursion.segment import Placement, Segment, placements
from adaptctl.scalars import ZERO, Column, Mat, Vec, column, cross, dot


class Frame:
    """Pose of a link's frame in the world."""

    __slots__ = ("origin", "rotation")

    def __init__(self, rotation: Mat, origin: Vec) -> None:
        self.rotation, self.origin = rotation, origin


class LinkPoses(NamedTuple):
    """Poses of the N links' frames in the world."""

    rotations: Array
    translations: Array


class JointAxes(NamedTuple):
    """Axes of the N links' joints in the world."""

    positions: Array
    directions: Array


def frames(links: Sequence[Segment], q: Column) -> list[Frame]:
    """Poses of the n links' frames in the world."""
    out: list[Frame] = []
    for place in placements(tuple(links), q):
        base = _base(place.segment, out)
        rotation = _turned(base.rotation, place)
        out.append(Frame(rotation, _joint_position(place.segment, base) + rotation @ place.shift))
    return out


def link_poses(mechanism: Mechanism, p: ArrayLike) -> LinkPoses:
    """Poses in the world of a mechanism's links."""
    placed, samples = _placed(mechanism, p)
    n = len(placed)
    rotations = stacked([entry for frame in placed for row in _rows(frame.rotation) for entry in row], samples)
    translations = stacked([entry for frame in placed for entry in frame.origin], samples)
    return LinkPoses(rotations.reshape(*samples, n, 3, 3), translations.reshape(*samples, n, 3))


def joint_axes(mechanism: Mechanism, p: ArrayLike) -> JointAxes:
    """Axes in the world of a mechanism's joints."""
    placed, samples = _placed(mechanism, p)
    links = mechanism.equations.links
    points = [_joint_position(link, _base(link, placed)) for link in links]
    directions = [frame.rotation @ link.axis for frame, link in zip(placed, links, strict=True)]
    shape = (*samples, len(links), 3)
    return JointAxes(
        stacked([entry for point in points for entry in point], samples).reshape(shape),
        stacked([entry for direction in directions for entry in direction], samples).reshape(shape),
    )


def _placed(mechanism: Mechanism, p: ArrayLike) -> tuple[list[Frame], tuple[int, ...]]:
    q = mechanism.configuration(p)
    return frames(mechanism.equations.links, column(q)), q.shape[:-1]


def _base(segment: Segment, placed: Sequence[Frame]) -> Frame:
    return placed[segment.parent] if segment.parent != GROUND else Frame(AXES, ZERO)


def _joint_position(segment: Segment, base: Frame) -> Vec:
    return base.origin + base.rotation @ segment.parent_to_joint


def _turned(base: Mat, place: Placement) -> Mat:
    return Mat(place.down(base.x), place.down(base.y), place.down(base.z))


def _rows(matrix: Mat) -> tuple[Vec, Vec, Vec]:
    return matrix.x, matrix.y, matrix.z


class MovingPoint:
    """Point of a link, with its Jacobian and that of the link's rotation."""

    __slots__ = ("columns", "position", "turns")

    def __init__(self, position: Vec, columns: Sequence[Vec], turns: Sequence[Vec]) -> None:
        self.position, self.columns, self.turns = position, tuple(columns), tuple(turns)

    def velocity(self, rates: Column) -> Vec:
        """Velocity (3,) of the point in m/s."""
        return _sum_of(self.columns, rates)

    def angular_velocity(self, rates: Column) -> Vec:
        """Angular velocity (3,) of the link in the world frame in rad/s."""
        return _sum_of(self.turns, rates)

    def torque(self, force: Vec, moment: Vec) -> Column:
        """Torque (r,) J' w of a force in N at the point and a moment in N m on the link."""
        return Column(dot(way, force) + dot(turn, moment) for way, turn in zip(self.columns, self.turns, strict=True))


def _sum_of(columns: Sequence[Vec], rates: Column) -> Vec:
    total = ZERO
    for rate, velocity in zip(rates, columns, strict=True):
        total = total + rate * velocity
    return total


def moving_point(links: Sequence[Segment], q: Column, link: int, offset: Vec) -> MovingPoint:
    """Position and Jacobian of a point of a link."""
    placed = frames(links, q)
    return point_at(links, placed, link, placed[link].origin + placed[link].rotation @ offset)


def point_at(links: Sequence[Segment], placed: Sequence[Frame], link: int, position: Vec) -> MovingPoint:
    """Point of a link that is at a position (3,) in m in the world frame, with its Jacobian."""
    columns, turns, i = [ZERO] * len(links), [ZERO] * len(links), link
    while i != GROUND:
        axis = placed[i].rotation @ links[i].axis
        joint = placed[i].origin - placed[i].rotation @ links[i].joint_to_link
        columns[i] = cross(axis, position - joint) if links[i].turns else axis
        turns[i] = axis if links[i].turns else ZERO
        i = links[i].parent
    return MovingPoint(position, columns, turns)
