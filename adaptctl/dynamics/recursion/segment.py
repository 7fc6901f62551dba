"""The geometry of a link."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import Description, Link
from adaptctl.description.pose import exact_right_angles
from adaptctl.scalars import ZERO, Column, Mat, Scalar, Vec, cos, dot, product, sin


class Segment(NamedTuple):
    """Geometry of a link and its joint, in m."""

    parent: int
    turns: bool
    joint_axis: Vec
    axis: Vec
    inward: Mat | None
    outward: Mat | None
    parent_to_joint: Vec
    joint_to_link: Vec
    whole: tuple[Mat, Mat, Mat] | None = None

    @classmethod
    def of(cls, link: Link) -> Segment:
        """Geometry of a link of a description."""
        outward = link.joint_to_link.rotation.T
        return cls(
            parent=link.parent,
            turns=link.joint.kind.is_revolute,
            joint_axis=Vec(*link.joint.axis.tolist()),
            axis=Vec(*exact_right_angles(outward @ link.joint.axis).tolist()),
            inward=_matrix(link.parent_to_joint.rotation.T),
            outward=_matrix(outward),
            parent_to_joint=_vector(link.parent_to_joint.translation),
            joint_to_link=_vector(outward @ link.joint_to_link.translation + 0.0),
            whole=_whole(outward, link.joint.axis, link.parent_to_joint.rotation.T)
            if link.joint.kind.is_revolute
            else None,
        )

    @property
    def coordinates(self) -> int:
        """Number of scalars of the link's pose."""
        return 2 if self.turns else 1

    @property
    def fixed(self) -> tuple[Mat, ...]:
        """Rotations, up to two, from the parent's axes to the link's at zero."""
        return tuple(step for step in (self.inward, self.outward) if step is not None)

    def at(self, q: Scalar) -> Placement:
        """Pose in the parent at joint position `q`."""
        return self.placed((cos(q), sin(q)) if self.turns else (q,))

    def placed(self, coordinates: Sequence[Scalar]) -> Placement:
        """Pose in the parent, from the `coordinates` of the joint."""
        if self.whole is not None:
            return Placement(self, coordinates, (_sum(self.whole, *coordinates),), self.joint_to_link)
        turn = about(self.joint_axis, *coordinates) if self.turns else None
        turns = tuple(step for step in (self.inward, turn, self.outward) if step is not None)
        return Placement(
            self,
            coordinates,
            turns,
            self.joint_to_link if self.turns else self.joint_to_link + coordinates[0] * self.axis,
        )


class Placement:
    """Pose of a link in its parent."""

    __slots__ = ("coordinates", "near", "segment", "shift", "turn", "turns")

    def __init__(
        self,
        segment: Segment,
        coordinates: Sequence[Scalar],
        turns: Sequence[Mat],
        shift: Vec,
        turn: AxisRotation | None = None,
    ) -> None:
        self.segment, self.coordinates, self.turns, self.shift, self.turn = segment, coordinates, turns, shift, turn
        self.near = segment.parent_to_joint

    def down(self, u: Vec) -> Vec:
        """Vector (3,) from the parent's axes to the link's."""
        for turn in self.turns:
            u = turn @ u
        return u

    def up(self, u: Vec) -> Vec:
        """Vector (3,) from the link's axes to the parent's."""
        for turn in reversed(self.turns):
            u = turn.T @ u
        return u


def segments(description: Description) -> tuple[Segment, ...]:
    """Geometry of every link of a description."""
    return tuple(Segment.of(link) for link in description.links)


def placements(links: tuple[Segment, ...], q: Column) -> list[Placement]:
    """Poses of links in their parents at a configuration (n,)."""
    return [link.at(q[i]) for i, link in enumerate(links)]


class AxisRotation(Mat):
    """Rotation (3, 3) about a coordinate axis."""

    __slots__ = ("axis", "cosine", "sine")

    def __init__(self, axis: int, cosine: Scalar, sine: Scalar) -> None:
        self.axis, self.cosine, self.sine = axis, cosine, sine
        c, s = cosine, sine
        if axis == 0:
            super().__init__(Vec(1.0, 0.0, 0.0), Vec(0.0, c, s), Vec(0.0, -s, c))
        elif axis == 1:
            super().__init__(Vec(c, 0.0, -s), Vec(0.0, 1.0, 0.0), Vec(s, 0.0, c))
        else:
            super().__init__(Vec(c, s, 0.0), Vec(-s, c, 0.0), Vec(0.0, 0.0, 1.0))

    @overload
    def __matmul__(self, other: Vec) -> Vec: ...
    @overload
    def __matmul__(self, other: Mat) -> Mat: ...
    def __matmul__(self, other: Vec | Mat) -> Vec | Mat:
        if isinstance(other, Mat):
            return super().__matmul__(other)
        c, s, (x, y, z) = self.cosine, self.sine, other
        if self.axis == 0:
            return Vec(x, c * y + s * z, -s * y + c * z)
        if self.axis == 1:
            return Vec(c * x + -s * z, y, s * x + c * z)
        return Vec(c * x + s * y, -s * x + c * y, z)

    @property
    def T(self) -> AxisRotation:
        """Transpose (3, 3), which turns back."""
        return AxisRotation(self.axis, self.cosine, -self.sine)


def axis_rotation(a: Vec, c: Scalar, s: Scalar) -> AxisRotation | None:
    """Rotation about a coordinate axis; None for another axis."""
    if not (all(isinstance(x, float) for x in a) and sorted(map(abs, a)) == [0.0, 0.0, 1.0]):
        return None
    axis, sign = next((k, x) for k, x in enumerate(a) if x != 0.0)
    return AxisRotation(axis, c, sign * s)


def about(a: Vec, c: Scalar, s: Scalar) -> Mat:
    """Rotation (3, 3) about a unit axis (Rodrigues), transposed."""
    along = axis_rotation(a, c, s)
    if along is not None:
        return along

    def entry(u: Scalar, v: Scalar, on_diagonal: float, k: Scalar) -> Scalar:
        return u * v + (on_diagonal - u * v) * c + k * s

    return Mat(
        Vec(entry(a.x, a.x, 1.0, 0.0), entry(a.x, a.y, 0.0, a.z), entry(a.x, a.z, 0.0, -a.y)),
        Vec(entry(a.y, a.x, 0.0, -a.z), entry(a.y, a.y, 1.0, 0.0), entry(a.y, a.z, 0.0, a.x)),
        Vec(entry(a.z, a.x, 0.0, a.y), entry(a.z, a.y, 0.0, -a.x), entry(a.z, a.z, 1.0, 0.0)),
    )


MIN_TURNED_VECTORS = 8
"""Vectors that a placement turns, at least."""


def _whole(outward: Array, axis: Array, inward: Array) -> tuple[Mat, Mat, Mat] | None:
    along, cross = np.outer(axis, axis), np.cross(axis, np.eye(3))
    parts = [outward @ part @ inward for part in (along, np.eye(3) - along, cross)]
    turn = (along != 0.0) | np.eye(3, dtype=np.bool_) | (cross != 0.0)
    entries = (np.abs(outward) @ turn @ np.abs(inward)) != 0.0
    one_by_one = _cost(turn) + sum(_cost(fixed != 0.0) for fixed in (outward, inward) if np.count_nonzero(fixed) > 3)
    made = 4 * int(np.count_nonzero(entries))
    if MIN_TURNED_VECTORS * (one_by_one - _cost(entries)) <= made:
        return None
    return tuple(map(_mat, parts))  # type: ignore[return-value]  # as many as there are parts


def _cost(entries: NDArray[np.bool_]) -> int:
    return 2 * int(np.count_nonzero(entries)) - 3


def _mat(entries: Array) -> Mat:
    return Mat.of(entries.tolist())


def _sum(parts: tuple[Mat, Mat, Mat], c: Scalar, s: Scalar) -> Mat:
    """K_0 + K_c c + K_s s."""
    rows = zip(*parts, strict=True)
    return Mat(*(Vec(*(k + kc * c + ks * s for k, kc, ks in zip(*row, strict=True))) for row in rows))


def _vector(entries: Array) -> Vec:
    return Vec(*entries.tolist()) if entries.any() else ZERO


def _matrix(rotation: Array) -> Mat | None:
    return None if np.array_equal(rotation, np.eye(3)) else Mat.of(rotation.tolist())


def symmetric_up(place: Placement, tensor: Mat) -> Mat:
    """Symmetric tensor (3, 3) in the parent's axes."""
    for turn in reversed(place.turns):
        tensor = turned_back(turn, tensor) if isinstance(turn, AxisRotation) else congruent(turn.T, tensor)
    return tensor


def tensor_up(place: Placement, tensor: Mat) -> Mat:
    """Tensor (3, 3) in the parent's axes."""
    for turn in reversed(place.turns):
        tensor = turned_back(turn, tensor) if isinstance(turn, AxisRotation) else product(product(turn.T, tensor), turn)
    return tensor


def turned_back(turn: AxisRotation, tensor: Mat) -> Mat:
    """Product R' T R (3, 3) of an axis rotation."""
    k, c, s = turn.axis, turn.cosine, turn.sine
    i, j = (k + 1) % 3, (k + 2) % 3
    old = [list(row) for row in tensor]
    new = [list(row) for row in tensor]
    t = s * (old[i][i] - old[j][j]) + c * (old[i][j] + old[j][i])
    new[i][i], new[j][j] = old[i][i] - s * t, old[j][j] + s * t
    new[i][j], new[j][i] = c * t - old[j][i], c * t - old[i][j]
    new[k][i], new[k][j] = c * old[k][i] - s * old[k][j], s * old[k][i] + c * old[k][j]
    new[i][k], new[j][k] = c * old[i][k] - s * old[j][k], s * old[i][k] + c * old[j][k]
    return Mat(*(Vec(*row) for row in new))


def congruent(rotation: Mat, s: Mat) -> Mat:
    """Symmetric product R S R' (3, 3)."""
    half_x, half_y, half_z = s @ rotation.x, s @ rotation.y, s @ rotation.z
    xy, xz, yz = dot(rotation.x, half_y), dot(rotation.x, half_z), dot(rotation.y, half_z)
    return Mat(
        Vec(dot(rotation.x, half_x), xy, xz),
        Vec(xy, dot(rotation.y, half_y), yz),
        Vec(xz, yz, dot(rotation.z, half_z)),
    )
