"""The geometry of a link, as the equations see it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.description import Description, Link
from adaptctl.description.pose import exact_right_angles
from adaptctl.scalars import Column, Mat, Scalar, Vec, cos, sin


class Segment(NamedTuple):
    """The geometry of one link and its joint, all lengths in m.

    `inward` turns the parent link's coordinates into the joint's, `outward` the moved joint's into the
    link's; None is the identity. `near` leads from the parent's origin to the joint, in the parent's frame;
    `far` from the joint to the link's origin, in the link's frame.
    """

    parent: int
    turns: bool
    joint_axis: Vec
    axis: Vec
    inward: Mat | None
    outward: Mat | None
    near: Vec
    far: Vec
    whole: tuple[Mat, Mat, Mat] | None = None
    """K_0, K_c, K_s of all three turns at once, K_0 + K_c cos q + K_s sin q, where that costs less than one by one"""

    @classmethod
    def of(cls, link: Link) -> Segment:
        """The geometry of a link and its joint."""
        outward = link.far.rotation.T
        return cls(
            parent=link.parent,
            turns=link.joint.kind.turns,
            joint_axis=Vec(*link.joint.axis.tolist()),
            axis=Vec(*exact_right_angles(outward @ link.joint.axis).tolist()),
            inward=_matrix(link.near.rotation.T),
            outward=_matrix(outward),
            near=Vec(*link.near.translation.tolist()),
            far=Vec(*(outward @ link.far.translation + 0.0).tolist()),
            whole=_whole(outward, link.joint.axis, link.near.rotation.T) if link.joint.kind.turns else None,
        )

    @property
    def coordinates(self) -> int:
        """Number of coordinates that place the link: cosine and sine of an angle, or a length."""
        return 2 if self.turns else 1

    def at(self, q: Scalar) -> Placement:
        """The link's placement in its parent when its joint stands at q."""
        return self.placed((cos(q), sin(q)) if self.turns else (q,))

    def placed(self, coordinates: Sequence[Scalar]) -> Placement:
        """The placement from the cosine and sine of q, or from q itself where the joint does not turn."""
        if self.whole is not None:
            return Placement(self, coordinates, (_sum(self.whole, *coordinates),), self.far)
        turn = about(self.joint_axis, *coordinates) if self.turns else None
        turns = tuple(step for step in (self.inward, turn, self.outward) if step is not None)
        return Placement(self, coordinates, turns, self.far if self.turns else self.far + coordinates[0] * self.axis)


class Placement:
    """A link in its parent at one configuration: `down` and `up` turn vectors, by `turns` one after the other, `shift`
    is the link's origin from the joint, in the link's frame; `coordinates` are what it is placed by."""

    __slots__ = ("coordinates", "segment", "shift", "turns")

    def __init__(self, segment: Segment, coordinates: Sequence[Scalar], turns: Sequence[Mat], shift: Vec) -> None:
        self.segment, self.coordinates, self.turns, self.shift = segment, coordinates, turns, shift

    def down(self, u: Vec) -> Vec:
        """The parent's coordinates of a vector, turned into the link's."""
        for turn in self.turns:
            u = turn @ u
        return u

    def up(self, u: Vec) -> Vec:
        """The link's coordinates of a vector, turned into the parent's."""
        for turn in reversed(self.turns):
            u = turn.T @ u
        return u


def segments(description: Description) -> tuple[Segment, ...]:
    """The geometry of every link."""
    return tuple(Segment.of(link) for link in description.links)


def placements(links: tuple[Segment, ...], q: Column) -> list[Placement]:
    """Pose of every link in its parent at tree configuration q (n,)."""
    return [link.at(q[i]) for i, link in enumerate(links)]


def about(a: Vec, c: Scalar, s: Scalar) -> Mat:
    """The rotation matrix (3, 3) to coordinates after a turn of cosine c and sine s about a unit axis: Rodrigues'
    formula, transposed."""

    def entry(u: Scalar, v: Scalar, on_diagonal: float, k: Scalar) -> Scalar:
        return u * v + (on_diagonal - u * v) * c + k * s

    return Mat(
        Vec(entry(a.x, a.x, 1.0, 0.0), entry(a.x, a.y, 0.0, a.z), entry(a.x, a.z, 0.0, -a.y)),
        Vec(entry(a.y, a.x, 0.0, -a.z), entry(a.y, a.y, 1.0, 0.0), entry(a.y, a.z, 0.0, a.x)),
        Vec(entry(a.z, a.x, 0.0, a.y), entry(a.z, a.y, 0.0, -a.x), entry(a.z, a.z, 1.0, 0.0)),
    )


TURNED = 8
"""Vectors that a placement turns, at least."""


def _whole(outward: Array, axis: Array, inward: Array) -> tuple[Mat, Mat, Mat] | None:
    """The three turns of a link as one, by Rodrigues' formula; None where they cost less one by one, as they do at
    right angles."""
    along, cross = np.outer(axis, axis), np.cross(axis, np.eye(3))
    parts = [outward @ part @ inward for part in (along, np.eye(3) - along, cross)]
    turn = (along != 0.0) | np.eye(3, dtype=np.bool_) | (cross != 0.0)
    entries = (np.abs(outward) @ turn @ np.abs(inward)) != 0.0
    one_by_one = _cost(turn) + sum(_cost(fixed != 0.0) for fixed in (outward, inward) if np.count_nonzero(fixed) > 3)
    made = 4 * int(np.count_nonzero(entries))
    if TURNED * (one_by_one - _cost(entries)) <= made:
        return None
    return tuple(map(_mat, parts))  # type: ignore[return-value]  # as many as there are parts


def _cost(entries: NDArray[np.bool_]) -> int:
    """Multiplications and additions of a matrix with such entries times a vector."""
    return 2 * int(np.count_nonzero(entries)) - 3


def _mat(entries: Array) -> Mat:
    return Mat.of(entries.tolist())


def _sum(parts: tuple[Mat, Mat, Mat], c: Scalar, s: Scalar) -> Mat:
    """K_0 + K_c c + K_s s."""
    rows = zip(*parts, strict=True)
    return Mat(*(Vec(*(k + kc * c + ks * s for k, kc, ks in zip(*row, strict=True))) for row in rows))


def _matrix(rotation: Array) -> Mat | None:
    return None if np.array_equal(rotation, np.eye(3)) else Mat.of(rotation.tolist())
