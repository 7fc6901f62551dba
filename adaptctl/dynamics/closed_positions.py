"""Positions of primary joints with the configuration that they belong to."""

from __future__ import annotations

from adaptctl.dynamics.equations import Equations
from adaptctl.scalars import Column


class ClosedPositions(Column):
    """Positions (r,) of a mechanism's r primary (independent) joints, rad (m if prismatic), a `Column` (vector of
    scalars of any kind), of which the closed `configuration` (n,) of the tree's n joints, rad (m), is known by the
    mechanism's `equations`.

    The method `closed` of equations of the same geometry, by value, returns that configuration where it would close the
    loops anew in closed form; others, such as those of bars of other lengths, close their own loops. What arithmetic
    makes of the positions is a plain `Column`. Nothing is checked.
    """

    __slots__ = ("configuration", "equations")

    def __init__(self, positions: Column, configuration: Column, equations: Equations) -> None:
        super().__init__(positions)
        self.configuration, self.equations = configuration, equations
