"""Posture: rates of a mechanism's dependent joints by its primary ones at a closed configuration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from adaptctl.dynamics.loops.constraint import Closing
from adaptctl.dynamics.loops.least_squares import factored
from adaptctl.dynamics.recursion.segment import Placement
from adaptctl.scalars import Column


class Following:
    """The Jacobian J = dU/dp of the tree's joints by the primary ones; `slopes` has the rows of the dependent
    joints."""

    def __init__(self, closing: Closing, slopes: Sequence[Column]) -> None:
        self.closing, self.slopes = closing, slopes

    def tree(self, v: Column) -> Column:
        """Velocities (n,) of the tree from the primary ones (r,): J v."""
        follow = v[0] * self.slopes[0]
        for rate, slope in zip(v.of[1:], self.slopes[1:], strict=True):
            follow = follow + rate * slope
        return self.joined(v, follow)

    def primary(self, torque: Sequence[Any] | Column) -> Column:
        """Torques (r,) of the primary joints from the tree's (n,): J' tau."""
        follow = Column(torque[d] for d in self.closing.dependent)
        pairs = zip(self.closing.primary, self.slopes, strict=True)
        return Column(torque[i] + slope @ follow for i, slope in pairs)

    def joined(self, first: Column, follow: Column) -> Column:
        """A tree column (n,) from its primary entries (r,) and dependent ones."""
        entries = dict(zip(self.closing.primary, first, strict=True))
        entries |= dict(zip(self.closing.dependent, follow, strict=True))
        return Column(entries[i] for i in range(len(entries)))


class Posture(Following):
    """A closed configuration of the tree, with J factored once."""

    def __init__(self, closing: Closing, places: Sequence[Placement]) -> None:
        columns = closing.jacobian(places)
        self.places, self.factor = places, factored([columns[d] for d in closing.dependent])
        super().__init__(closing, [self.factor.solve(-columns[i]) for i in closing.primary])

    def bias(self, u: Column, w: Column) -> Column:
        """The velocity terms J_dot(u) w (n,) of the tree's accelerations, from two tree velocities J v and J v_r;
        symmetric in them."""
        follow = -self.factor.solve(self.closing.bias(self.places, u, w))
        return self.joined(Column.zeros(len(self.closing.primary)), follow)
