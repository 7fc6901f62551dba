"""Default gains."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, per_joint, positive_number, positive_period, whole_count
from adaptctl.caching import cached_property
from adaptctl.control import PriorRanges, typical_inertia
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.control.gains.adaptation_ratio import adaptation_ratio
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.control.gains.workspace import Workspace, reachable
from adaptctl.description import GROUND
from adaptctl.description.reach import reach_behind
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, validate_kind
from adaptctl.tuning.feasible_gains import (
    REFERENCE_MARGIN,
    FeasibleGains,
    achieved_sampling_ratio,
    common_error,
    feasible_gains,
    recoverable_error,
)
from adaptctl.tuning.feasible_reference import FeasibleReference, feasible_reference, judged_reference, motion_ranges

DEFAULT_BANDWIDTH = 4.0  # 1/s
DEFAULT_SAMPLING_RATIO = 0.5  # a third of what is allowed
REFERENCE_SAMPLES, SAMPLES_OF_MANY_JOINTS, FEW_JOINTS = 120, 40, 10
FRESH_SAMPLES = 10  # times as many, where gains were not fitted
HORIZON = 20.0  # s of the reference
MIN_INITIAL_ERROR = 1e-2  # rad (m), for the choice of gains
MIN_LEVER = 0.05  # m, behind a last joint
MAX_MASS_RANGE = 5.0  # kg
MIN_EFFECT_RATIO = 1e-3  # of a link's largest: parameters of less effect are learned no faster

Shares: TypeAlias = Literal["ranges", "links", "parameters", "mixed"]


@dataclass(frozen=True, eq=False)
class Proposal:
    """Tracking gains and adaptation gain (P,)."""

    feasible: FeasibleGains
    gain: Array


@dataclass(frozen=True, eq=False)
class DefaultGains:
    """Rule of default gains near a reference."""

    mechanism: Mechanism
    control_period: float
    limits: Array
    found: FeasibleReference
    initial_error: Array
    reference_points: ReferencePoint
    postures: Array
    errors: Array
    seed: int = 0

    @classmethod
    def for_mechanism(
        cls,
        mechanism: Mechanism,
        *,
        control_period: float = 1e-3,
        reference: Reference | None = None,
        initial_error: ArrayLike | None = None,
        seed: int = 0,
    ) -> DefaultGains:
        """Rule for a mechanism. Raises `InputError` for wrong settings."""
        validate_kind(mechanism, Mechanism, "tune", "as load(...) gives one")
        control_period, seed = positive_period(control_period, "control_period"), whole_count(seed, "seed")
        given = None if initial_error is None else _given_error(mechanism, initial_error)
        limits = finite_torque_limits(mechanism)
        if reference is None:
            found = feasible_reference(mechanism, limits, seed)
        else:
            found = judged_reference(mechanism, limits, reference)
        error = given if given is not None else recoverable_error(mechanism, limits, found.reference)
        rng, points = np.random.default_rng(seed), found.reference(np.linspace(0.0, HORIZON, _samples(mechanism)))
        near = _samples_near(mechanism, points.p, error, rng)
        return cls(mechanism, control_period, limits, found, error, points, *near, seed)

    @property
    def reference(self) -> Reference:
        """Reference of the rule."""
        return self.found.reference

    @cached_property
    def ranges(self) -> Array:
        """Prior ranges (P,) of all parameters, SI units."""
        return prior_ranges(self.mechanism)

    def carried(self, bandwidth: float = DEFAULT_BANDWIDTH, hold: float = DEFAULT_SAMPLING_RATIO) -> FeasibleGains:
        """Largest tracking gains within all limits."""
        return self._carried(at_most("bandwidth", bandwidth, 1e3), at_most("sampling_ratio", hold, 1.5))

    @lru_cache(maxsize=8)  # noqa: B019  # a search asks for the same few again and again, and they take longest
    def _carried(self, bandwidth: float, hold: float) -> FeasibleGains:
        off = np.maximum(np.abs(self.initial_error), MIN_INITIAL_ERROR)
        return feasible_gains(self.mechanism, self.limits, self.postures, off, self.control_period, bandwidth, hold)

    def proposed(self, bandwidth: float, hold: float, adaptation: float, shares: Shares) -> Proposal:
        """Proposal with this adaptation ratio."""
        adaptation = at_most("adaptation_ratio", adaptation, 1.0)
        mechanism, carried = self.mechanism, self.carried(bandwidth, hold)
        regressor = _regressor(mechanism, self.reference_points, self.errors, carried.gains.bandwidth)
        damping = carried.gains.damping
        gain = feasible_gain(mechanism, regressor, damping, self.ranges, self.control_period, adaptation, shares)
        return Proposal(carried, gain)

    def achieved(self, proposal: Proposal) -> tuple[float, float]:
        """Greatest sampling and adaptation ratios near the reference, where the gains were not fitted."""
        mechanism, rates = self.mechanism, proposal.feasible.gains.bandwidth
        damping, rng = proposal.feasible.gains.damping, np.random.default_rng([self.seed, 1])
        points = self.reference(rng.uniform(0.0, HORIZON, FRESH_SAMPLES * _samples(mechanism)))
        postures, errors = _samples_near(mechanism, points.p, self.initial_error, rng)
        regressor = _regressor(mechanism, points, errors, rates)
        return (
            achieved_sampling_ratio(mechanism, postures, damping, self.control_period),
            adaptation_ratio(regressor, damping, proposal.gain, self.control_period),
        )


def _regressor(mechanism: Mechanism, points: ReferencePoint, errors: Array, rates: Array) -> Array:
    """Slotine and Li's regressor (S, r, P) on a reference, with tracking errors."""
    v_r, a_r = points.v - rates * errors, points.a + rates**2 * errors
    return mechanism.slotine_li_regressor(points.p + errors, points.v, v_r, a_r)


def near_reference(mechanism: Mechanism, reference: Reference, initial_error: Array) -> Workspace:
    """Workspace of 60 positions of the reference."""
    margin = float(np.max(np.abs(initial_error)))
    return Workspace.along(mechanism, reference(np.linspace(0.0, HORIZON, 60)).p, margin)


def at_most(name: str, value: float, most: float) -> float:
    """Number. Raises `InputError` unless positive and at most this."""
    what = f"{name}: expected a number above 0 and at most {most:g}"
    if (number := positive_number(value, what)) > most:
        raise InputError(f"{what}, got {value!r}")
    return number


def _given_error(mechanism: Mechanism, given: ArrayLike) -> Array:
    error = per_joint(given, mechanism.dof, "initial_error")
    if not np.all(np.isfinite(error)):
        raise InputError(f"initial_error: expected finite numbers, got {error.tolist()}")
    return error


def _samples(mechanism: Mechanism) -> int:
    return REFERENCE_SAMPLES if mechanism.dof <= FEW_JOINTS else SAMPLES_OF_MANY_JOINTS


def _samples_near(mechanism: Mechanism, p: Array, off: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Positions and tracking errors near others (S, r)."""
    lower, upper = motion_ranges(mechanism)
    width = np.minimum(REFERENCE_MARGIN, 0.5 * (upper - lower))
    postures = p + width * rng.uniform(-1.0, 1.0, p.shape)
    postures = np.where(reachable(mechanism, postures)[:, None], postures, p)
    errors = np.maximum(np.abs(off), common_error(mechanism)) * rng.choice([-1.0, 1.0], p.shape)
    return postures, np.where(reachable(mechanism, p + errors)[:, None], errors, 0.0)


def prior_ranges(mechanism: Mechanism, heaviest: float = MAX_MASS_RANGE) -> Array:
    """Prior ranges (P,), of links from the inertias of their joints."""
    inertia = _driving_inertia(mechanism)
    levers = np.maximum(reach_behind(mechanism.links), MIN_LEVER) / 3.0
    masses = np.minimum(inertia / levers**2, heaviest)
    by_owner: dict[str, PriorRanges] = {}
    for link, mass, moment in zip(mechanism.links, masses.tolist(), inertia.tolist(), strict=True):
        # A link owns its ten, its joint the drive's.
        by_owner[link.name] = by_owner[link.joint.name] = PriorRanges(mass, float(np.sqrt(mass * moment)), moment)
    names = mechanism.parameter_names
    return np.concatenate([by_owner[name.rpartition(".")[0]].for_parameters((name,)) for name in names])


def feasible_gain(
    mechanism: Mechanism,
    regressor: Array,
    damping: Array,
    ranges: Array,
    control_period: float,
    number: float,
    shares: Shares,
) -> Array:
    """Diagonal gain (P,) with this adaptation ratio."""
    gain = ranges**2
    if shares == "links":
        gain = _each_link(mechanism, regressor, damping, gain, control_period)
    elif shares == "parameters":
        gain = _each_parameter(mechanism, regressor, damping, gain)
    elif shares == "mixed":
        parts = gain, _each_link(mechanism, regressor, damping, gain, control_period)
        gain = np.sum([part / adaptation_ratio(regressor, damping, part, control_period) for part in parts], axis=0)
    return gain * number / adaptation_ratio(regressor, damping, gain, control_period)


def _each_link(mechanism: Mechanism, regressor: Array, damping: Array, gain: Array, control_period: float) -> Array:
    """Gain with the same ratio of each link and drive."""
    found = gain.copy()
    for group in _groups(mechanism):
        number = adaptation_ratio(regressor[..., group], damping, gain[group], control_period)
        found[group] = gain[group] / number if number > 0.0 else 0.0
    return _positive(found)


def _each_parameter(mechanism: Mechanism, regressor: Array, damping: Array, gain: Array) -> Array:
    """Gain inverse to each parameter's effect."""
    share = (regressor**2 / damping[:, None]).sum(axis=1).max(axis=0)
    found = gain.copy()
    for group in _groups(mechanism):
        least = MIN_EFFECT_RATIO * float((share[group] * gain[group]).max()) / gain[group]
        found[group] = 1.0 / np.maximum(share[group], least) if np.all(least > 0.0) else 0.0
    return _positive(found)


def _positive(gain: Array) -> Array:
    """Gains, small where there is no effect."""
    return np.maximum(gain, 1e-12 * gain[gain > 0.0].min())


def _groups(mechanism: Mechanism) -> list[list[int]]:
    """Parameters of each link with its rotor, whose gain alone would ring, and of each friction."""
    links = {link.joint.name: link.name for link in mechanism.links}
    groups: dict[tuple[str, bool], list[int]] = {}
    for k, name in enumerate(mechanism.parameter_names):
        owner = name.rpartition(".")[0]
        groups.setdefault((links.get(owner, owner), k >= mechanism.num_energy_parameters), []).append(k)
    return list(groups.values())


def _driving_inertia(mechanism: Mechanism) -> Array:
    """Typical inertia (N,) that each link's driven joint moves."""
    of_joints = dict(zip(mechanism.description.primary, typical_inertia(mechanism).tolist(), strict=True))
    found: list[float] = []
    for i, link in enumerate(mechanism.links):
        before = found[link.parent] if link.parent != GROUND else max(of_joints.values())
        found.append(of_joints.get(i, before))
    return np.array(found)
