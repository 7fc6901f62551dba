"""Posture: rates of a mechanism's dependent joints by its primary ones at a closed configuration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from adaptctl.dynamics.loops.constraint import Closing
from adaptctl.dynamics.loops.least_squares import factored
from adaptctl.dynamics.recursion.segment import Placement
from adaptctl.scalars import Column


class Following:
    """The Jacobian J (n, r) of a tree's n joint positions with respect to the r primary ones at a closed configuration
    of its loops, with methods that map velocities and torques by it.

    Made of `closing`, which has the indices of primary and dependent joints, and `slopes`, for each primary joint a
    `Column` (n - r,) of the derivatives of the dependent joints by it, rad or m per rad or m. Nothing is checked.
    """

    def __init__(self, closing: Closing, slopes: Sequence[Column]) -> None:
        self.closing, self.slopes = closing, slopes

    def tree(self, v: Column) -> Column:
        """Velocities J v (n,) of the spanning tree's n joints, rad/s (m/s if prismatic), from those of the r primary
        (independent) ones, v (r,); J (n, r) is the Jacobian of the joints' positions with respect to the primary ones.
        Raises `ValueError` for v of a wrong length."""
        follow = v[0] * self.slopes[0]
        for rate, slope in zip(v.of[1:], self.slopes[1:], strict=True):
            follow = follow + rate * slope
        return self.joined(v, follow)

    def primary(self, torque: Sequence[Any] | Column) -> Column:
        """Torques J' tau (r,) of the r primary (independent) joints, N m (N if prismatic), that do the same work as
        torques tau (n,), `torque`, of all n joints of the spanning tree. J' is the transpose of the Jacobian J (n, r)
        of the joints' positions with respect to the primary ones. Arguments are not checked: too short a tau raises
        `IndexError`."""
        follow = Column(torque[d] for d in self.closing.dependent)
        pairs = zip(self.closing.primary, self.slopes, strict=True)
        return Column(torque[i] + slope @ follow for i, slope in pairs)

    def joined(self, first: Column, follow: Column) -> Column:
        """A `Column` (n,) of one entry for each of the n joints of the spanning tree, in the tree's order, merged from
        those of the r primary joints, `first` (r,), and of the dependent ones, `follow` (n - r,). Each is in the order
        of the joints' indices in this object's `closing`. Raises `ValueError` for another number of either."""
        entries = dict(zip(self.closing.primary, first, strict=True))
        entries |= dict(zip(self.closing.dependent, follow, strict=True))
        return Column(entries[i] for i in range(len(entries)))


class Posture(Following):
    """A closed configuration of a tree with loops, with the closure Jacobian with respect to the dependent joints
    factored once, and the Jacobian J (n, r) of all n joints with respect to the r primary ones.

    Made of `closing`, the closure conditions, and `places`, the n links' placements at that configuration. At an exact
    singularity of the loops, where the primary joints do not determine the others, it raises `ZeroDivisionError` in
    floats and has infinity or NaN in arrays.
    """

    def __init__(self, closing: Closing, places: Sequence[Placement]) -> None:
        columns = closing.jacobian(places)
        self.places, self.factor = places, factored([columns[d] for d in closing.dependent])
        super().__init__(closing, [self.factor.solve(-columns[i]) for i in closing.primary])

    def bias(self, u: Column, w: Column) -> Column:
        """The velocity terms J_dot v_r (n,) of the accelerations of the spanning tree's n joints, rad/s^2 (m/s^2 if
        prismatic), zero for the r primary (independent) ones.

        Let these have velocities v and, in a reference motion, velocities v_r and accelerations a_r; then all n have
        velocities `u` = J v, `w` = J v_r (n,), rad/s (m/s), and accelerations J a_r + J_dot v_r, J (n, r) being their
        Jacobian with respect to the primary ones and J_dot its rate under u. The result is symmetric in u and w, which
        keep the loops closed. Arguments are not checked: too short a u or w raises `IndexError`.
        """
        follow = -self.factor.solve(self.closing.bias(self.places, u, w))
        return self.joined(Column.zeros(len(self.closing.primary)), follow)
