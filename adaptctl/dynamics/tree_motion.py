"""A tree at one instant, as far as torques go: what they, their regressor and its powers are made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from adaptctl.dynamics.recursion.motion import Motion
from adaptctl.dynamics.recursion.newton_euler import joint_torques, powers, torque_regressor
from adaptctl.dynamics.recursion.segment import Placement
from adaptctl.scalars import Column, Scalar

if TYPE_CHECKING:
    from adaptctl.dynamics.tree_equations import TreeEquations


class TreeMotion:
    """How every link of a tree is placed and moves under joint velocities v, v_r and accelerations a_r, and the
    torque that every parameter of a drive takes per unit (`drives`)."""

    __slots__ = ("drives", "links", "places", "tree")

    def __init__(
        self, tree: TreeEquations, places: Sequence[Placement], links: Sequence[Motion], drives: Sequence[Scalar]
    ) -> None:
        self.tree, self.places, self.links, self.drives = tree, places, links, drives

    def torque(self, parameters: Column) -> Column:
        """M a_r + C(p, v) v_r + g + friction at v, in N m (N for a prismatic joint)."""
        total = list(joint_torques(self.places, self.links, self.tree.tens(parameters)))
        shares = zip(self.tree.drives, self.drives, parameters.of[self.tree.driven :], strict=True)
        for term, share, value in shares:
            for joint, part in term.on_joints(value * share):
                total[joint] = total[joint] + part
        return Column(total)

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """Rows of Y, the asked columns only: Y D is the torque."""
        of_bodies, of_drives = self.tree.sorted_out(columns)
        rows = torque_regressor(self.places, self.links, list(of_bodies.values()))
        by_column = [dict(zip(of_bodies, row, strict=True)) for row in rows]
        for column, k in of_drives.items():
            for joint, share in self.tree.drives[k].on_joints(self.drives[k]):
                by_column[joint][column] = share
        return [Column(row.get(column, 0.0) for column in columns) for row in by_column]

    def powers(self, s: Column, columns: Sequence[int]) -> Column:
        """Y' s on the asked columns, without forming Y: what a unit of each parameter takes under joint rates s."""
        of_bodies, of_drives = self.tree.sorted_out(columns)
        found = dict(zip(of_bodies, powers(self.places, self.links, s, list(of_bodies.values())), strict=True))
        found |= {column: self.tree.drives[k].speed(s) * self.drives[k] for column, k in of_drives.items()}
        return Column(found[column] for column in columns)

    @property
    def numbers(self) -> Column:
        """All that the motion is, to remember it by."""
        placed = (x for place in self.places for x in place.coordinates)
        return Column((*placed, *(x for link in self.links for x in link.numbers), *self.drives))
