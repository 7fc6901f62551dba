"""Forward kinematics: poses of frames in the world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from numpy.typing import ArrayLike

from adaptctl.arrays import Array, stacked
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.dynamics.recursion.motion import GROUND
from adaptctl.dynamics.recursion.segment import Placement, Segment, placements
from adaptctl.scalars import ZERO, Column, Mat, Vec, column

_WORLD_AXES = Mat.of(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))


class Frame:
    """A link in the world: `rotation` turns its coordinates into the world's, `origin` is its origin (m)."""

    __slots__ = ("origin", "rotation")

    def __init__(self, rotation: Mat, origin: Vec) -> None:
        self.rotation, self.origin = rotation, origin


class LinkPoses(NamedTuple):
    """Link frames in the world, N links: `world = rotations[i] @ own + translations[i]`."""

    rotations: Array
    """(..., N, 3, 3)"""
    translations: Array
    """(..., N, 3), m"""


class JointAxes(NamedTuple):
    """Axes of the joints in the world: a point (..., N, 3) on each, m, and its direction (..., N, 3)."""

    positions: Array
    """(..., N, 3), m: the origin of the joint's frame before it moves"""
    directions: Array
    """(..., N, 3), unit vectors"""


def frames(links: Sequence[Segment], q: Column) -> list[Frame]:
    """Poses in the world of every link's frame at tree configuration q (n,), m."""
    out: list[Frame] = []
    for place in placements(tuple(links), q):
        base = _base(place.segment, out)
        rotation = _turned(base.rotation, place)
        out.append(Frame(rotation, _joint_position(place.segment, base) + rotation @ place.shift))
    return out


def link_poses(mechanism: Mechanism, p: ArrayLike) -> LinkPoses:
    """Poses in the world of every link's frame at positions p (..., r): rotations (..., N, 3, 3) and translations (...,
    N, 3), m.

    Raises `InputError` on a wrong shape and `NonFiniteError` on NaN or infinity.
    """
    placed, samples = _placed(mechanism, p)
    n = len(placed)
    rotations = stacked([entry for frame in placed for row in _rows(frame.rotation) for entry in row], samples)
    translations = stacked([entry for frame in placed for entry in frame.origin], samples)
    return LinkPoses(rotations.reshape(*samples, n, 3, 3), translations.reshape(*samples, n, 3))


def joint_axes(mechanism: Mechanism, p: ArrayLike) -> JointAxes:
    """Points and directions (..., N, 3) of every joint's axis in the world at positions p (..., r), m. Raises as
    `link_poses` does."""
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
    return placed[segment.parent] if segment.parent != GROUND else Frame(_WORLD_AXES, ZERO)


def _joint_position(segment: Segment, base: Frame) -> Vec:
    return base.origin + base.rotation @ segment.near


def _turned(base: Mat, place: Placement) -> Mat:
    """The link's rotation, row by row: a row of it is the base's row in the link's coordinates."""
    return Mat(place.down(base.x), place.down(base.y), place.down(base.z))


def _rows(matrix: Mat) -> tuple[Vec, Vec, Vec]:
    return matrix.x, matrix.y, matrix.z
