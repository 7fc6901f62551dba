"""Positions of primary joints with the configuration that they belong to."""

from __future__ import annotations

from adaptctl.scalars import Column


class ClosedPositions(Column):
    """Positions (r,) of a mechanism's r primary (independent) joints, rad (m if prismatic), a `Column`, of which the
    closed `configuration` (n,) of the tree's n joints, rad (m), is known: `Equations.closed` returns that at once where
    it would find it in closed form; Newton's steps are made anew. Sums and other results of arithmetic with them are
    plain `Column`s. Nothing is checked."""

    __slots__ = ("configuration",)

    def __init__(self, positions: Column, configuration: Column) -> None:
        super().__init__(positions)
        self.configuration = configuration
