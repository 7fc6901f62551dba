"""Jacobians of points of links."""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.dynamics.recursion.kinematics import frames
from adaptctl.dynamics.recursion.motion import GROUND
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.scalars import ZERO, Column, Vec, cross


class MovingPoint:
    """A point of a link of a tree of n joints at one configuration, with its Jacobian. `position` (3,) is in the world
    frame, m; `columns` are n vectors (3,), each the point's velocity in the world frame under unit velocity of one
    joint, m/rad (no unit for a prismatic joint). Nothing is checked."""

    __slots__ = ("columns", "position")

    def __init__(self, position: Vec, columns: Sequence[Vec]) -> None:
        self.position, self.columns = position, tuple(columns)

    def velocity(self, rates: Column) -> Vec:
        """The point's velocity (3,) in the world frame, m/s, under velocities `rates` (n,) of the spanning tree's n
        joints, rad/s (m/s if prismatic). Raises `ValueError` for another number of them."""
        total = ZERO
        for rate, column in zip(rates, self.columns, strict=True):
            total = total + rate * column
        return total


def moving_point(links: Sequence[Segment], q: Column, link: int, offset: Vec) -> MovingPoint:
    """The position in the world frame, m, and the Jacobian of a point fixed to a link, as a `MovingPoint`, at a
    configuration `q` (n,) of the spanning tree's n joints, rad (m if prismatic). `links` has the geometry of the tree's
    n links, `link` is the zero-based index of the point's link, and `offset` (3,) the point's coordinates in that
    link's frame, m. Arguments are not checked: too short a q, or a `link` of n or more, raises `IndexError`."""
    placed = frames(links, q)
    position = placed[link].origin + placed[link].rotation @ offset
    columns, i = [ZERO] * len(links), link
    while i != GROUND:
        axis = placed[i].rotation @ links[i].axis
        joint = placed[i].origin - placed[i].rotation @ links[i].far
        columns[i] = cross(axis, position - joint) if links[i].turns else axis
        i = links[i].parent
    return MovingPoint(position, columns)
