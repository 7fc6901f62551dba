"""Jacobians of points of links."""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.dynamics.recursion.kinematics import frames
from adaptctl.dynamics.recursion.motion import GROUND
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.scalars import ZERO, Column, Vec, cross


class MovingPoint:
    """A point of a link in the world, m, and its Jacobian: a column (3,) a tree joint."""

    __slots__ = ("columns", "position")

    def __init__(self, position: Vec, columns: Sequence[Vec]) -> None:
        self.position, self.columns = position, tuple(columns)

    def velocity(self, rates: Column) -> Vec:
        """The point's velocity under tree joint rates (n,)."""
        total = ZERO
        for rate, column in zip(rates, self.columns, strict=True):
            total = total + rate * column
        return total


def moving_point(links: Sequence[Segment], q: Column, link: int, offset: Vec) -> MovingPoint:
    """The point at `offset` (m) in a link's frame, at tree configuration q (n,)."""
    placed = frames(links, q)
    position = placed[link].origin + placed[link].rotation @ offset
    columns, i = [ZERO] * len(links), link
    while i != GROUND:
        axis = placed[i].rotation @ links[i].axis
        joint = placed[i].origin - placed[i].rotation @ links[i].far
        columns[i] = cross(axis, position - joint) if links[i].turns else axis
        i = links[i].parent
    return MovingPoint(position, columns)
