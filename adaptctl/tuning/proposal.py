"""Proposed gains, from four numbers that say how far to go."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.control.gains.workspace import reachable
from adaptctl.dynamics import Mechanism
from adaptctl.tuning.carried_gains import WIDTH, CarriedGains, carried_gains
from adaptctl.tuning.initial_error import common_error
from adaptctl.tuning.motion_range import motion_ranges
from adaptctl.tuning.prior_gain import Shares, carried_gain, prior_ranges

HORIZON = 20.0
"""s of the reference along which gains are to hold"""
SMALLEST_ERROR = 1e-2
"""rad or m: smaller initial errors than this are taken as this when gains are chosen"""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A proposal of gains, with the numbers that they were asked for."""

    carried: CarriedGains
    gain: Array
    """(P,) diagonal of Gamma"""
    hold: float
    adaptation: float


@dataclass(frozen=True, eq=False)
class Proposals:
    """Proposals for a mechanism on a reference, from postures and motions along it."""

    mechanism: Mechanism
    limits: Array
    """(r,) of torques"""
    off: Array
    """(r,) the initial error"""
    period: float
    points: ReferencePoint
    """of the reference, (S, r) each"""
    postures: Array
    """(S, r) near them, where loops can be there"""
    errors: Array
    """(S, r) of the size of the initial error and at least of the common one, of either sign; zero where loops cannot
    be off by it"""

    @classmethod
    def along(
        cls,
        mechanism: Mechanism,
        limits: Array,
        reference: Reference,
        off: Array,
        period: float,
        samples: int,
        seed: int,
    ) -> Proposals:
        """Proposals from so many samples of a reference."""
        rng, points = np.random.default_rng(seed), reference(np.linspace(0.0, HORIZON, samples))
        lower, upper = motion_ranges(mechanism)
        width = np.minimum(WIDTH, 0.5 * (upper - lower))
        postures = points.p + width * rng.uniform(-1.0, 1.0, points.p.shape)
        postures = np.where(reachable(mechanism, postures)[:, None], postures, points.p)
        errors = np.maximum(np.abs(off), common_error(mechanism)) * rng.choice([-1.0, 1.0], points.p.shape)
        errors = np.where(reachable(mechanism, points.p + errors)[:, None], errors, 0.0)
        sizes = np.maximum(np.abs(off), SMALLEST_ERROR)
        return cls(mechanism, limits, sizes, period, points, postures, errors)

    @cached_property
    def ranges(self) -> Array:
        """Prior ranges (P,) of the parameters, SI units."""
        return prior_ranges(self.mechanism)

    @lru_cache(maxsize=8)  # noqa: B019  # a search asks for the same few again and again, and they take longest
    def carried(self, bandwidth: float, hold: float) -> CarriedGains:
        """The largest gains of at most this bandwidth (1/s) and hold number."""
        return carried_gains(self.mechanism, self.limits, self.postures, self.off, self.period, bandwidth, hold)

    def proposed(self, bandwidth: float, hold: float, adaptation: float, shares: Shares) -> Proposal:
        """Gains of at most this bandwidth (1/s), hold number and adaptation number."""
        mechanism, points = self.mechanism, self.points
        carried = self.carried(bandwidth, hold)
        rates = carried.gains.bandwidth
        v_r, a_r = points.v - rates * self.errors, points.a + rates**2 * self.errors
        regressor = mechanism.slotine_li_regressor(points.p + self.errors, points.v, v_r, a_r)
        damping = carried.gains.damping
        gain = carried_gain(mechanism, regressor, damping, self.ranges, self.period, adaptation, shares)
        return Proposal(carried, gain, hold, adaptation)
