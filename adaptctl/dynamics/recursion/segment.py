"""The geometry of a link, as the equations see it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import Description, Link
from adaptctl.description.pose import exact_right_angles
from adaptctl.scalars import Column, Mat, Scalar, Vec, cos, sin


@dataclass(frozen=True)
class Segment:
    """One link and its joint, all lengths in m.

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

    @classmethod
    def of(cls, link: Link) -> Segment:
        """The segment of a link."""
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
        if self.turns:
            return Placement(self, coordinates, about(self.joint_axis, *coordinates), self.far)
        return Placement(self, coordinates, None, self.far + coordinates[0] * self.axis)


class Placement:
    """A link in its parent at one configuration: `down` and `up` turn vectors, `shift` is the link's origin
    from the joint, in the link's frame; `coordinates` are what it is placed by."""

    __slots__ = ("coordinates", "segment", "shift", "turn")

    def __init__(self, segment: Segment, coordinates: Sequence[Scalar], turn: Mat | None, shift: Vec) -> None:
        self.segment, self.coordinates, self.turn, self.shift = segment, coordinates, turn, shift

    def down(self, u: Vec) -> Vec:
        """The parent's coordinates of a vector, turned into the link's."""
        for step in (self.segment.inward, self.turn, self.segment.outward):
            u = step @ u if step is not None else u
        return u

    def up(self, u: Vec) -> Vec:
        """The link's coordinates of a vector, turned into the parent's."""
        for step in (self.segment.outward, self.turn, self.segment.inward):
            u = step.T @ u if step is not None else u
        return u


def segments(description: Description) -> tuple[Segment, ...]:
    """The geometry of every link."""
    return tuple(Segment.of(link) for link in description.links)


def placements(links: tuple[Segment, ...], q: Column) -> list[Placement]:
    """Every link in its parent at tree configuration q."""
    return [link.at(q[i]) for i, link in enumerate(links)]


def about(a: Vec, c: Scalar, s: Scalar) -> Mat:
    """Coordinates after a turn of cosine c and sine s about a unit axis: Rodrigues' formula, transposed."""

    def entry(u: Scalar, v: Scalar, on_diagonal: float, k: Scalar) -> Scalar:
        return u * v + (on_diagonal - u * v) * c + k * s

    return Mat(
        Vec(entry(a.x, a.x, 1.0, 0.0), entry(a.x, a.y, 0.0, a.z), entry(a.x, a.z, 0.0, -a.y)),
        Vec(entry(a.y, a.x, 0.0, -a.z), entry(a.y, a.y, 1.0, 0.0), entry(a.y, a.z, 0.0, a.x)),
        Vec(entry(a.z, a.x, 0.0, a.y), entry(a.z, a.y, 0.0, -a.x), entry(a.z, a.z, 1.0, 0.0)),
    )


def _matrix(rotation: Array) -> Mat | None:
    return None if np.array_equal(rotation, np.eye(3)) else Mat.of(rotation.tolist())
