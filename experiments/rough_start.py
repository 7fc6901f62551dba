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
    """Base class of experiments that start from a rough model of the arm, every link's parameters off by
    `parameter_error`, a share. The adaptation gain Gamma is `rate` (1/J) times the square of each parameter's deviation
    from the rough model; the tracking loop has the `bandwidth`, 1/s, and a damping of `ratio` (no unit) times the
    bandwidth times each joint's typical inertia (the median of its entry of the mass matrix's diagonal over random
    configurations); `seed` draws which links are up and which down. A subclass has these five as settings. Nothing is
    checked at construction."""

    seed: int
    bandwidth: float
    ratio: float
    rate: float
    parameter_error: float

    def gains(self, mechanism: Mechanism) -> Gains:
        """Gains of the tracking loop for the mechanism's r primary (independently moving) joints: Lambda (r,), 1/s, the
        bandwidth as set, and K (r,), N m s/rad (N s/m if prismatic), `ratio` times Lambda times the joint's typical
        inertia (the median of its entry of the mass matrix's diagonal over random configurations). Raises `InputError`
        where a joint's typical inertia is not positive."""
        return Gains.from_bandwidth(mechanism, self.bandwidth, self.ratio)

    def rough(self, mechanism: Mechanism) -> Array:
        """Parameters (P,) of the rough model in SI units, in the mechanism's own order: the ten of every link, scaled
        by 1 + `parameter_error` or 1 - `parameter_error`, drawn by seed, then those of drives (rotor inertias,
        friction), as they are."""
        return scaled_links(mechanism, self.parameter_error, self.seed)

    def first(self, model: ReducedModel) -> Array:
        """First estimate (k,) of a model's k parameters, fundamental (base) and friction ones, in SI units: the P
        parameters of the rough model, with every link's off by `parameter_error` (a share), regrouped into k."""
        return np.asarray(model.regrouping @ self.rough(model.mechanism))

    def deviations(self, model: ReducedModel) -> Array:
        """Standard deviations (k,) of a model's k true parameters from their first estimates, in SI units, where each
        link's and drive's parameters are off by `parameter_error`, a share, of their size: for a link of mass m and
        second moments I about its frame's origin, m for the mass, sqrt(m I) for first moments and I for inertias; for
        drives the magnitude."""
        return deviations(model, self.rough(model.mechanism), self.parameter_error)

    def adaptation(self, model: ReducedModel) -> Array:
        """Diagonal (k,) of the adaptation gain Gamma for a model's k parameters, in their SI units squared per J:
        `rate` (1/J) times the square of each one's standard deviation, where each link's and drive's parameters are off
        by `parameter_error`, a share, of their size; the size of a link's first moments and inertias is the most that
        its mass and second moments allow, of other parameters their magnitude."""
        return self.rate * self.deviations(model) ** 2

    def adaptation_setting(self, mechanism: Mechanism) -> str:
        """Text for the report on the adaptation gain Gamma: `rate` (1/J) times the squared standard deviation of each
        parameter, where links and drives are off by `parameter_error`, a share, of their size; `mechanism` is not
        used."""
        return f"{self.rate:g} × (deviation)², {100 * self.parameter_error:.0f} % of each link's and drive's size"
