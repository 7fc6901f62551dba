"""Adaptation gain from prior ranges of masses, first moments and inertias that are settings."""

from __future__ import annotations

from adaptctl.arrays import Array
from adaptctl.control import PriorRanges, adaptation_gain
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel


class RangedGain:
    """Base class of experiments whose Gamma is the rate times the square of prior ranges, which it names in SI
    units."""

    mass_range: float
    first_moment_range: float
    inertia_range: float
    rate: float

    @property
    def ranges(self) -> PriorRanges:
        """The prior ranges that the settings give."""
        return PriorRanges(self.mass_range, self.first_moment_range, self.inertia_range)

    def adaptation(self, model: ReducedModel) -> Array:
        """Diagonal (k,) of Gamma for a model's parameters."""
        return adaptation_gain(model, self.ranges, self.rate)

    def adaptation_setting(self, mechanism: Mechanism) -> str:
        """Text of the adaptation gain Gamma, by kinds of parameters."""
        of = ((self.mass_range, "kg"), (self.first_moment_range, "kg·m"), (self.inertia_range, "kg·m²"))
        return "; ".join(f"{self.rate:g}·({value:g} {unit})²" for value, unit in of)
