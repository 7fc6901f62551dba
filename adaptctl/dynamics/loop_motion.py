"""A mechanism with loops at one instant, as far as torques go."""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.dynamics.loops.posture import Following
from adaptctl.dynamics.tree_motion import TreeMotion
from adaptctl.scalars import Column


class LoopMotion:
    """How a mechanism with loops moves at one instant: its tree, and how its dependent joints follow."""

    __slots__ = ("following", "tree")

    def __init__(self, following: Following, tree: TreeMotion) -> None:
        self.following, self.tree = following, tree

    def torque(self, parameters: Column) -> Column:
        """M a_r + C(p, v) v_r + g (r,)."""
        return self.following.primary(self.tree.torque(parameters))

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """Rows of Y = J' Y_tree, the asked columns only."""
        rows = self.tree.regressor(columns)
        by_column = [self.following.primary([row[k] for row in rows]) for k in range(len(columns))]
        return [Column(column[i] for column in by_column) for i in range(len(self.following.slopes))]

    def powers(self, s: Column, columns: Sequence[int]) -> Column:
        """Y' s on the asked columns, without forming Y."""
        return self.tree.powers(self.following.tree(s), columns)

    @property
    def numbers(self) -> Column:
        """All that the motion is, to remember it by."""
        return Column((*(x for slope in self.following.slopes for x in slope), *self.tree.numbers))
