"""Adaptation gain from prior ranges of masses, first moments and inertias that are settings."""

from __future__ import annotations

from adaptctl.arrays import Array
from adaptctl.control import PriorRanges, adaptation_gain
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel


class RangedGain:
    """Base class of experiments whose adaptation gain Gamma is `rate` (1/J) times the square of each parameter's prior
    range (its greatest plausible error): `mass_range` (kg) for masses, `first_moment_range` (kg m) for first moments,
    `inertia_range` (kg m^2) for inertias. A subclass has these four as settings. Nothing is checked at construction."""

    mass_range: float
    first_moment_range: float
    inertia_range: float
    rate: float

    @property
    def ranges(self) -> PriorRanges:
        """Prior ranges (greatest plausible errors) of inertial parameters by kind, a `PriorRanges`: those of masses
        (kg), first moments (kg m) and inertias (kg m^2), from this experiment's settings `mass_range`,
        `first_moment_range` and `inertia_range`. Raises `InputError` for ranges that are not positive and finite."""
        return PriorRanges(self.mass_range, self.first_moment_range, self.inertia_range)

    def adaptation(self, model: ReducedModel) -> Array:
        """Diagonal (k,) of the adaptation gain Gamma for the k parameters of a reduced `model`, in their SI units
        squared per J: this object's `rate` (1/J) times the square of each parameter's prior range (its greatest
        plausible error). Raises `InputError` for ranges or a rate that are not positive and finite."""
        return adaptation_gain(model, self.ranges, self.rate)

    def adaptation_setting(self, mechanism: Mechanism) -> str:
        """Text for the report that says how the adaptation gain Gamma is chosen: `rate` (1/J) times the squared prior
        range (greatest plausible error) of masses, kg, first moments, kg m, and inertias, kg m^2; `mechanism` is not
        used. Nothing is checked."""
        of = ((self.mass_range, "kg"), (self.first_moment_range, "kg·m"), (self.inertia_range, "kg·m²"))
        return "; ".join(f"{self.rate:g}·({value:g} {unit})²" for value, unit in of)
