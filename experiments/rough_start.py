"""Gains and first estimates of experiments that start from a rough model of the arm."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Gains
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.rough_model import deviations
from adaptctl.identifiability import ReducedModel
from adaptctl.tuning.rough_links import scaled_links


class RoughStart:
    """Base class of experiments whose links are known within `parameter_error`; it names the settings below.

    Gamma is the rate times the square of each parameter's deviation from the rough model.
    """

    seed: int
    bandwidth: float
    ratio: float
    rate: float
    parameter_error: float

    def gains(self, mechanism: Mechanism) -> Gains:
        """Gains of the tracking loop: Lambda as set, K from typical inertia."""
        return Gains.from_bandwidth(mechanism, self.bandwidth, self.ratio)

    def rough(self, mechanism: Mechanism) -> Array:
        """Parameters (P,) of the rough model: every link's up or down by seed."""
        return scaled_links(mechanism, self.parameter_error, self.seed)

    def first(self, model: ReducedModel) -> Array:
        """First estimate (k,) of a model's parameters: the rough model's."""
        return np.asarray(model.regrouping @ self.rough(model.mechanism))

    def deviations(self, model: ReducedModel) -> Array:
        """Deviations (k,) that the truth may have from a model's first estimate."""
        return deviations(model, self.rough(model.mechanism), self.parameter_error)

    def adaptation(self, model: ReducedModel) -> Array:
        """Diagonal (k,) of Gamma for a model's parameters."""
        return self.rate * self.deviations(model) ** 2

    def adaptation_setting(self, mechanism: Mechanism) -> str:
        """Text of the adaptation gain Gamma, for the record."""
        return f"{self.rate:g} × (deviation)², {100 * self.parameter_error:.0f} % of each link's and drive's size"
