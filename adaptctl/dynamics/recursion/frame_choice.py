"""Axes for a link's vectors: its own or unrotated ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from adaptctl.dynamics.recursion.motion import GROUND
from adaptctl.dynamics.recursion.segment import AxisRotation, Placement, Segment, axis_rotation, turned_back
from adaptctl.scalars import Column, Mat, Scalar, Vec, cos, sin


class FrameChoice(NamedTuple):
    """Axes of the vectors of a tree's links."""

    links: tuple[Segment, ...]
    senses: tuple[float, ...]
    unturned: tuple[bool, ...]

    @classmethod
    def of(cls, links: Sequence[Segment]) -> FrameChoice:
        """Choice with fewer operations."""
        senses = tuple(_sense(link, links) for link in links)
        turned, tilted = list[bool](), list[bool]()  # by any joint; by one before the link's that is not parallel to it
        for link, sense in zip(links, senses, strict=True):
            above = link.parent != GROUND
            tilted.append(above and (tilted[link.parent] or (not sense and turned[link.parent])))
            turned.append(link.turns or (above and turned[link.parent]))
        unturned = [
            before and link.turns and link.whole is None and axis_rotation(link.axis, 1.0, 0.0) is not None
            for link, before in zip(links, tilted, strict=True)
        ]
        for link, sense in zip(links, senses, strict=True):
            if link.parent != GROUND and not sense:
                unturned[link.parent] = False
        return cls(tuple(links), senses, tuple(unturned))

    def coordinates(self, q: Column) -> list[tuple[Scalar, ...]]:
        """Link coordinates, for `placements`."""
        found: list[tuple[Scalar, ...]] = []
        for i, (link, sense) in enumerate(zip(self.links, self.senses, strict=True)):
            if not link.turns:
                found.append((q[i],))
                continue
            c, s = cos(q[i]), sin(q[i])  # of the joint's own angle: they are often known, as of loops' joints
            if link.parent != GROUND and self.unturned[link.parent]:
                cosine, sine = found[link.parent][0], sense * found[link.parent][1]
                c, s = c * cosine - s * sine, s * cosine + c * sine
            found.append((c, s))
        return found

    def placements(self, coordinates: Sequence[Sequence[Scalar]]) -> list[Placement]:
        """Poses of the links in their parents, in the chosen axes."""
        found: list[Placement] = []
        for link, own, unturned in zip(self.links, coordinates, self.unturned, strict=True):
            before = found[link.parent].turn if link.parent != GROUND else None
            turn = axis_rotation(link.axis, *own) if unturned else None
            place = (
                link.placed(own)
                if turn is None
                else Placement(link, own, link.fixed, turn.T @ link.joint_to_link, turn)
            )
            if before is not None:
                place.near = before.T @ link.parent_to_joint
            found.append(place)
        return found


def _sense(link: Segment, links: Sequence[Segment]) -> float:
    if link.parent == GROUND or not (link.turns and links[link.parent].turns):
        return 0.0
    axis = link.joint_axis if link.inward is None else link.inward.T @ link.joint_axis
    return next((sign for sign in (1.0, -1.0) if tuple(sign * axis) == tuple(links[link.parent].axis)), 0.0)


def held_parameters(place: Placement, ten: Sequence[Scalar]) -> Sequence[Scalar]:
    """Ten inertial parameters in the chosen axes."""
    if place.turn is None:
        return ten
    m, x, y, z, xx, xy, yy, xz, yz, zz = ten
    a = turned_back(place.turn, Mat(Vec(xx, xy, xz), Vec(xy, yy, yz), Vec(xz, yz, zz)))
    return m, *(place.turn.T @ Vec(x, y, z)), a.x.x, a.x.y, a.y.y, a.x.z, a.y.z, a.z.z


def per_own_parameter(turn: AxisRotation, held: Sequence[Scalar]) -> Sequence[Scalar]:
    """Coefficients (10,) of a link's own parameters."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = held
    # Any tensor will do whose opposite entries add up to the coefficients of products of inertia.
    a = turned_back(turn.T, Mat(Vec(xx, xy, xz), Vec(0.0, yy, yz), Vec(0.0, 0.0, zz)))
    products = a.x.y + a.y.x, a.y.y, a.x.z + a.z.x, a.y.z + a.z.y
    return m, *(turn @ Vec(x, y, z)), a.x.x, *products, a.z.z
