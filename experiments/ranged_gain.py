"""The adaptation gain from prior ranges of masses, first moments and inertias that are settings."""

from __future__ import annotations

from adaptctl.arrays import Array
from adaptctl.control import PriorRanges, adaptation_gain
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel


class RangedGain:
    """Gamma is the rate times the square of each parameter's prior range; an experiment names the ranges, SI units."""

    mass_range: float
    first_moment_range: float
    inertia_range: float
    rate: float

    @property
    def ranges(self) -> PriorRanges:
        """As set."""
        return PriorRanges(self.mass_range, self.first_moment_range, self.inertia_range)

    def adaptation(self, model: ReducedModel) -> Array:
        """Gamma (k,)."""
        return adaptation_gain(model, self.ranges, self.rate)

    def adaptation_setting(self, mechanism: Mechanism) -> str:
        """Gamma by kinds of parameters."""
        of = ((self.mass_range, "kg"), (self.first_moment_range, "kg·m"), (self.inertia_range, "kg·m²"))
        return "; ".join(f"{self.rate:g}·({value:g} {unit})²" for value, unit in of)
