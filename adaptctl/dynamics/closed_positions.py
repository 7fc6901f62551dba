"""Positions of primary joints with the configuration that they belong to."""

from __future__ import annotations

from adaptctl.dynamics.equations import Equations
from adaptctl.scalars import Column


class ClosedPositions(Column):
    """Positions of a mechanism's r primary (independent) joints, stored with the closed configuration that they
    determine. The object is a `Column` (r,), a vector of scalars of any kind, in rad (m if prismatic).

    Made of `positions` (r,); `configuration` (n,), the positions of all n joints of the mechanism's tree, rad (m), with
    the loops closed; and `equations`, the `Equations` of the mechanism. Where `Equations` have closed forms for the
    loops, their method `closed`, given these positions, returns that configuration and does not compute it again,
    provided that their geometry equals that of `equations` in value, as where a mechanism is loaded twice. Others, such
    as those of a model with other lengths, close their own loops. Sums and products of the positions are plain `Column`
    objects. Nothing is checked.
    """

    __slots__ = ("configuration", "equations")

    def __init__(self, positions: Column, configuration: Column, equations: Equations) -> None:
        super().__init__(positions)
        self.configuration, self.equations = configuration, equations
