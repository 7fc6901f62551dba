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
    """Proposal of gains for Slotine and Li's law, with the two numbers, without units, that it was made for. Nothing is
    checked.

    `carried` has the tracking gains, bandwidth and damping, and what limits them; `gain` (P,) is the diagonal of the
    adaptation gain on all P parameters, in their units squared per J. `hold` is the upper bound of the damping
    number T lambda_max((M + T B)^-1 K), which the gains are below where torques limit them, and `adaptation` the
    adaptation number T lambda_max(K^-1 Y Gamma Y'); both are stable below 2. T is the control period, M the mass
    matrix, B viscous friction, K the damping, Y the torque regressor and Y' its transpose, Gamma the adaptation gain,
    lambda_max the largest eigenvalue.
    """

    carried: CarriedGains
    gain: Array
    """(P,) diagonal of Gamma"""
    hold: float
    adaptation: float


@dataclass(frozen=True, eq=False)
class Proposals:
    """Maker of proposals of gains for a `mechanism` of r joints, from S samples of a reference; the class method
    `along` makes one. Nothing is checked.

    `limits` (r,) are the torque limits, N m (N if prismatic), `off` (r,) the sizes of the initial tracking error, rad
    (m), above 0, and `period` the control period, s. `points` is the reference at S times, (S, r) each. `postures` (S,
    r), rad (m), are random positions near it at which kinematic loops can be closed. `errors` (S, r), rad (m), are
    tracking errors of random sign at the same times, at least as large as the initial one, 0 where loops could not be
    closed.
    """

    mechanism: Mechanism
    limits: Array
    """(r,) of torques"""
    off: Array
    """(r,) sizes of the initial error"""
    period: float
    points: ReferencePoint
    """of the reference, (S, r) each"""
    postures: Array
    """(S, r) near them, where loops can be closed"""
    errors: Array
    """(S, r) of the size of the initial error and at least of the common one, of either sign; zero where loops could
    not be closed with it"""

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
        """Maker of proposals of gains, a `Proposals`, for a `mechanism` of r joints on a `reference`: from S =
        `samples` samples of its first 20 s, at evenly spaced times, both ends included.

        `limits` (r,) are the torque limits, N m (N if prismatic), `off` (r,) the initial tracking errors, rad (m),
        whose sizes below 0.01 count as 0.01, and `period` the control period, s. For each sample two things are drawn
        by `seed`, a whole number of at least 0, the same for equal seeds: a position, uniform within 0.2 rad (m), or
        half the joint's range if that is less, of the reference's; and a tracking error of each joint, of either sign
        with equal probability and of the size of its initial error, or, if greater, a tenth of its range, at most 0.1
        rad (m). Where kinematic loops could not be closed, the position is the reference's and the error 0. Nothing is
        checked.
        """
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
        """Prior ranges (P,) of all P inertial and friction parameters of the mechanism, their greatest plausible
        errors, in SI units. Raises `InputError` where a joint's typical inertia, the median of its mass matrix entry
        over 200 random positions, is not positive."""
        return prior_ranges(self.mechanism)

    @lru_cache(maxsize=8)  # noqa: B019  # a search asks for the same few again and again, and they take longest
    def carried(self, bandwidth: float, hold: float) -> CarriedGains:
        """The largest tracking gains, a `CarriedGains`, with a bandwidth of at most `bandwidth` (1/s) and a damping
        number of at most `hold`, no unit, at random positions near the reference and within the torque limits. The
        damping number is T lambda_max((M + T B)^-1 K), stable below 2: T is the control period, M the mass matrix, B
        viscous friction, K the damping and lambda_max the largest eigenvalue. The last 8 results are kept. Raises
        `InputError` for joints that move nothing that has inertia, and where M is not positive definite."""
        return carried_gains(self.mechanism, self.limits, self.postures, self.off, self.period, bandwidth, hold)

    def proposed(self, bandwidth: float, hold: float, adaptation: float, shares: Shares) -> Proposal:
        """Proposal of gains, a `Proposal`, with a bandwidth of at most `bandwidth` (1/s), a damping number of at most
        `hold` and an adaptation number of `adaptation`, both without a unit and stable below 2.

        The former is T lambda_max((M + T B)^-1 K), the adaptation number T lambda_max(K^-1 Y Gamma Y'): T is the
        control period, M the mass matrix, B viscous friction, K the damping, Y the torque regressor and Y' its
        transpose, lambda_max the largest eigenvalue. `shares` says what the adaptation gain Gamma is in proportion to:
        "ranges", the squares of the parameters' prior ranges (greatest plausible errors), "links", these but scaled so
        that each link by itself has the same adaptation number, "parameters", the inverse of each parameter's effect on
        torques, or "mixed", half of each of the first two. Raises `InputError` for joints that move nothing that has
        inertia, and where M is not positive definite.
        """
        mechanism, points = self.mechanism, self.points
        carried = self.carried(bandwidth, hold)
        rates = carried.gains.bandwidth
        v_r, a_r = points.v - rates * self.errors, points.a + rates**2 * self.errors
        regressor = mechanism.slotine_li_regressor(points.p + self.errors, points.v, v_r, a_r)
        damping = carried.gains.damping
        gain = carried_gain(mechanism, regressor, damping, self.ranges, self.period, adaptation, shares)
        return Proposal(carried, gain, hold, adaptation)
