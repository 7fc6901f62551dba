"""Gains and first estimates of experiments that start from a rough model of the arm."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Gains
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.rough_model import deviations
from adaptctl.identifiability import ReducedModel
from adaptctl.tuning.verification import scaled_links


class RoughStart:
    """Base class of experiments that start from a rough model of the arm, every link's parameters off by the fraction
    `parameter_error`. The adaptation gain Gamma is `rate` (1/J) times the square of each parameter's deviation from the
    rough model; the tracking loop has the `bandwidth`, 1/s, and a damping of `ratio` (no unit) times the bandwidth
    times each joint's typical inertia, the median of its entry of the mass matrix's diagonal over 200 random
    configurations; `seed` draws which links' parameters are too large and which too small. A subclass has these five as
    settings. Nothing is checked at construction."""

    seed: int
    bandwidth: float
    ratio: float
    rate: float
    parameter_error: float

    def gains(self, mechanism: Mechanism) -> Gains:
        """Gains of the tracking loop, a `Gains`, for the r primary (independently moving) joints of a `mechanism`:
        Lambda (r,), 1/s, this object's `bandwidth`, and K (r,), N m s/rad (N s/m if prismatic), `ratio` times Lambda
        times the joint's typical inertia, the median of its entry of the mass matrix's diagonal over 200 random
        configurations. Raises `InputError` where a joint's typical inertia is not positive."""
        return Gains.from_bandwidth(mechanism, self.bandwidth, self.ratio)

    def rough(self, mechanism: Mechanism) -> Array:
        """The P parameters (P,) of the rough model of a `mechanism` in SI units, in the order of its `parameter_names`:
        the ten of every link, scaled by 1 + `parameter_error` or 1 - `parameter_error`, drawn by `seed` and the same
        for the same seed, then those of drives (rotor inertias, friction), unchanged. Nothing is checked."""
        return scaled_links(mechanism, self.parameter_error, self.seed)

    def first(self, model: ReducedModel) -> Array:
        """Initial estimate (k,) of the k parameters of a reduced `model`, fundamental (base) and friction ones, in SI
        units: the P parameters of the rough model, with every link's off by the fraction `parameter_error`, regrouped
        into k. Nothing is checked."""
        return np.asarray(model.regrouping @ self.rough(model.mechanism))

    def deviations(self, model: ReducedModel) -> Array:
        """Standard deviations (k,) of the k true parameters of a reduced `model` from their initial estimates, in SI
        units, where each link's and drive's parameters are off by the fraction `parameter_error` of their size. Sizes
        are, for a link of mass m and trace I of second moments about its frame's origin, m for the mass, sqrt(m I) for
        first moments and I for inertias; for drives the parameter's magnitude. Nothing is checked."""
        return deviations(model, self.rough(model.mechanism), self.parameter_error)

    def adaptation(self, model: ReducedModel) -> Array:
        """Diagonal (k,) of the adaptation gain Gamma for the k parameters of a reduced `model`, in their SI units
        squared per J: this object's `rate` (1/J) times the square of each one's standard deviation, where each link's
        and drive's parameters are off by the fraction `parameter_error` of their size. The size of a link's first
        moments and inertias is the most that its mass and second moments allow, of other parameters their magnitude.
        Nothing is checked."""
        return self.rate * self.deviations(model) ** 2

    def adaptation_setting(self, mechanism: Mechanism) -> str:
        """Text for the report that says how the adaptation gain Gamma is chosen: `rate` (1/J) times the squared
        standard deviation of each parameter, where links and drives are off by the fraction `parameter_error` of their
        size; `mechanism` is not used. Nothing is checked."""
        return f"{self.rate:g} × (deviation)², {100 * self.parameter_error:.0f} % of each link's and drive's size"
