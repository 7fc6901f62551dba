"""The rule of default gains: for one arm, one period and one bandwidth there is one answer, whoever asks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, per_joint, positive_number, whole_count
from adaptctl.caching import cached_property
from adaptctl.control import PriorRanges, typical_inertia
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.control.gains.workspace import Workspace, reachable
from adaptctl.description import GROUND
from adaptctl.description.reach import reach_behind
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, validate_kind
from adaptctl.tuning.feasible_gains import WIDTH, FeasibleGains, common_error, feasible_gains, recoverable_error
from adaptctl.tuning.feasible_reference import FeasibleReference, feasible_reference, judged_reference, motion_ranges

BANDWIDTH, HOLD = 4.0, 0.5
"""1/s, and T lambda_max((M + T B)^-1 K), a third of what a hold of a period may carry"""
POSTURES, POSTURES_OF_MANY, MANY = 120, 40, 10
"""along the reference, and where there are more than MANY joints"""
HORIZON = 20.0
"""s of the reference along which gains are to hold"""
SMALLEST_ERROR = 1e-2
"""rad or m: smaller initial errors than this are taken as this when gains are chosen"""
SHORTEST_LEVER = 0.05
"""m, behind a last joint"""
HEAVIEST = 5.0
"""kg, the greatest prior range of a link's mass unless given"""
LEAST_SHARE = 1e-3
"""of the largest share of a link's parameter in the torques, in proportion to the ranges: less is learned no faster"""

Shares: TypeAlias = Literal["ranges", "links", "parameters", "mixed"]
"""Parts with an equal share in the adaptation number: each link, each parameter, or none (in proportion to the prior
ranges); mixed is half of the latter and half of each link."""


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

    feasible: FeasibleGains
    gain: Array
    sampling_ratio: float
    adaptation_ratio: float


@dataclass(frozen=True, eq=False)
class DefaultGains:
    """Rule of default gains for a `mechanism` of r joints whose torques are held over a `period` (s), near a reference;
    the class method `on` makes one. Nothing is checked.

    `limits` (r,) are the torque limits, N m (N if prismatic); `found` has the reference and what it asks of them;
    `initial_error` (r,), rad (m), is the position less the reference's at time 0. Of S samples of the reference's first
    20 s, `points` has its points, (S, r) each; `postures` (S, r), rad (m), are random positions near it at which
    kinematic loops can be closed; `errors` (S, r), rad (m), are tracking errors of random sign, at least as large as
    the initial one, 0 where loops could not be closed.
    """

    mechanism: Mechanism
    control_period: float
    limits: Array
    found: FeasibleReference
    initial_error: Array
    points: ReferencePoint
    postures: Array
    errors: Array

    @classmethod
    def on(
        cls,
        mechanism: Mechanism,
        *,
        control_period: float = 1e-3,
        reference: Reference | None = None,
        initial_error: ArrayLike | None = None,
        seed: int = 0,
    ) -> DefaultGains:
        """Rule of default gains, a `DefaultGains`, for a `mechanism` of r joints and a control `period` (s), 1 ms by
        default, on a `reference`. Unless given, the reference is drawn by `seed`, 0 by default, within 60 % of the
        torque limits, and the `initial_error` (rad, m if prismatic; one number or (r,)) is 0.1 rad (m), and less where
        a range or a torque limit is small.

        Positions are drawn by `seed` within 0.2 rad (m), or half the joint's range if that is less, of 120 samples of
        the reference (of 40 with more than 10 joints), and errors of the initial one's size or, if greater, a tenth of
        the joint's range, at most 0.1 rad (m). Raises `InputError` for settings that are out of range (`period` above 0
        and at most 0.1; `seed` a whole number of at least 0; `initial_error` finite and of r joints); for a given
        `reference`, `NonFiniteError` where its points are not finite and `SingularityError` where kinematic loops
        cannot be closed at its first one.
        """
        validate_kind(mechanism, Mechanism, "tune", "as load(...) gives one")
        control_period, seed = at_most("control_period", control_period, 0.1), whole_count(seed, "seed")
        given = None if initial_error is None else _given_error(mechanism, initial_error)
        limits = finite_torque_limits(mechanism)
        if reference is None:
            found = feasible_reference(mechanism, limits, seed)
        else:
            found = judged_reference(mechanism, limits, reference)
        error = given if given is not None else recoverable_error(mechanism, limits, found.reference)
        rng, points = np.random.default_rng(seed), found.reference(np.linspace(0.0, HORIZON, _samples(mechanism)))
        return cls(mechanism, control_period, limits, found, error, points, *_around(mechanism, points.p, error, rng))

    @property
    def reference(self) -> Reference:
        """The reference near which gains are to hold."""
        return self.found.reference

    @cached_property
    def ranges(self) -> Array:
        """Prior ranges (P,) of all P inertial and friction parameters of the mechanism, their greatest plausible
        errors, in SI units. Raises `InputError` where a joint's typical inertia, the median of its mass matrix entry
        over 200 random positions, is not positive."""
        return prior_ranges(self.mechanism)

    def carried(self, bandwidth: float = BANDWIDTH, hold: float = HOLD) -> FeasibleGains:
        """The largest tracking gains, a `FeasibleGains`, with a bandwidth of at most `bandwidth` (1/s), 4 by default,
        and a damping number of at most `hold`, no unit, 0.5 by default, at the positions near the reference and within
        the torque limits. The damping number is T lambda_max((M + T B)^-1 K), stable below 2: T is the control period,
        M the mass matrix, B viscous friction, K the damping and lambda_max the largest eigenvalue. The last 8 results
        are kept. Raises `InputError` for a bandwidth above 1000 1/s or a hold above 1.5, joints that move nothing that
        has inertia, and where M is not positive definite."""
        return self._carried(at_most("bandwidth", bandwidth, 1e3), at_most("sampling_ratio", hold, 1.5))

    @lru_cache(maxsize=8)  # noqa: B019  # a search asks for the same few again and again, and they take longest
    def _carried(self, bandwidth: float, hold: float) -> FeasibleGains:
        off = np.maximum(np.abs(self.initial_error), SMALLEST_ERROR)
        return feasible_gains(self.mechanism, self.limits, self.postures, off, self.control_period, bandwidth, hold)

    def proposed(self, bandwidth: float, hold: float, adaptation: float, shares: Shares) -> Proposal:
        """Proposal of gains, a `Proposal`, with the tracking gains `carried(bandwidth, hold)` and an adaptation number
        T lambda_max(K^-1 Y Gamma Y') of `adaptation`, no unit and stable below 2: T is the control period, K the
        damping, Y the torque regressor and Y' its transpose, lambda_max the largest eigenvalue. `shares` says what the
        adaptation gain Gamma is in proportion to, as in `feasible_gain`. Raises `InputError` as `carried` does, and for
        an `adaptation` above 1."""
        adaptation = at_most("adaptation_ratio", adaptation, 1.0)
        mechanism, points, carried = self.mechanism, self.points, self.carried(bandwidth, hold)
        rates, damping = carried.gains.bandwidth, carried.gains.damping
        v_r, a_r = points.v - rates * self.errors, points.a + rates**2 * self.errors
        regressor = mechanism.slotine_li_regressor(points.p + self.errors, points.v, v_r, a_r)
        gain = feasible_gain(mechanism, regressor, damping, self.ranges, self.control_period, adaptation, shares)
        return Proposal(carried, gain, hold, adaptation)


def near_reference(mechanism: Mechanism, reference: Reference, initial_error: Array) -> Workspace:
    """Set of joint positions for which gains are checked, a `Workspace`: 60 positions of the `reference`, evenly spaced
    in its first 20 s, with a margin about each of them, the size of the largest of the joints' `initial_error` (r,),
    rad (m if prismatic). Raises `InputError` where kinematic loops of the `mechanism` can be closed at none of them."""
    margin = float(np.max(np.abs(initial_error)))
    return Workspace.along(mechanism, reference(np.linspace(0.0, HORIZON, 60)).p, margin)


def at_most(name: str, value: float, most: float) -> float:
    """The number `value`. Raises `InputError`, which calls it `name`, unless it is above 0 and at most `most`."""
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
    return POSTURES if mechanism.dof <= MANY else POSTURES_OF_MANY


def _around(mechanism: Mechanism, p: Array, off: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Positions near others, and tracking errors at these, (S, r) each."""
    lower, upper = motion_ranges(mechanism)
    width = np.minimum(WIDTH, 0.5 * (upper - lower))
    postures = p + width * rng.uniform(-1.0, 1.0, p.shape)
    postures = np.where(reachable(mechanism, postures)[:, None], postures, p)
    errors = np.maximum(np.abs(off), common_error(mechanism)) * rng.choice([-1.0, 1.0], p.shape)
    return postures, np.where(reachable(mechanism, p + errors)[:, None], errors, 0.0)


def prior_ranges(mechanism: Mechanism, heaviest: float = HEAVIEST) -> Array:
    """Prior ranges (P,), SI units, of all P inertial and friction parameters of a `mechanism`: their greatest plausible
    errors, in the order of its `parameter_names`.

    Those of a link come from the typical inertia I of the joint that moves it, the median of its mass matrix entry over
    200 random positions. A point mass m = I/lever^2, at most `heaviest` (kg; 5 by default), would have that inertia at
    a lever of a third of the arm's length beyond the joint, which is taken as at least 0.05 m. m is then the range of
    the link's mass, sqrt(m I) that of its first moments and I that of its inertias. Friction has the ranges of
    `PriorRanges`, 5 N m s/rad (N s/m if prismatic) for viscous and 10 N m (N) for Coulomb friction. Raises `InputError`
    where a typical inertia is not positive.
    """
    inertia = _behind(mechanism)
    levers = np.maximum(reach_behind(mechanism.links), SHORTEST_LEVER) / 3.0
    masses = np.minimum(inertia / levers**2, heaviest)
    by_owner: dict[str, PriorRanges] = {}
    for link, mass, moment in zip(mechanism.links, masses.tolist(), inertia.tolist(), strict=True):
        # A link owns its ten, its joint the drive's.
        by_owner[link.name] = by_owner[link.joint.name] = PriorRanges(mass, float(np.sqrt(mass * moment)), moment)
    names = mechanism.parameter_names
    return np.concatenate([by_owner[name.rpartition(".")[0]].of((name,)) for name in names])


def achieved_adaptation_ratio(regressor: Array, damping: Array, gain: Array, control_period: float) -> float:
    """The adaptation number T lambda_max(K^-1 Y Gamma Y'), without a unit, the greatest over S samples: sampled
    adaptation is stable below 2.

    Y is the torque `regressor` (S, r, P) of r joints and P parameters and Y' its transpose, K the `damping` (r,), N m
    s/rad (N s/m if prismatic), Gamma the adaptation gain, whose diagonal (P,) is `gain`, in the parameters' units
    squared per J, T the control `period`, s, and lambda_max the largest eigenvalue. Nothing is checked.
    """
    scaled = regressor * np.sqrt(gain) / np.sqrt(damping)[:, None]
    return control_period * float(np.linalg.eigvalsh(scaled @ np.swapaxes(scaled, -1, -2))[:, -1].max())


def feasible_gain(
    mechanism: Mechanism,
    regressor: Array,
    damping: Array,
    ranges: Array,
    control_period: float,
    number: float,
    shares: Shares,
) -> Array:
    """The diagonal (P,) of an adaptation gain Gamma on all P parameters of a `mechanism`, scaled so that the adaptation
    number is `number`. It is in the order of the mechanism's `parameter_names` and in their units squared per J.

    The adaptation number is the greatest T lambda_max(K^-1 Y Gamma Y'), no unit, over S samples: Y is the torque
    `regressor` (S, r, P) of r joints and Y' its transpose, K the `damping` (r,), N m s/rad (N s/m if prismatic), T the
    control `period`, s, and lambda_max the largest eigenvalue. `shares` says what the gain is in proportion to:
    "ranges", the squares of the parameters' prior `ranges` (P,), SI units; "links", these, but scaled so that each link
    with its drive's rotor, and each drive's friction, has the same adaptation number by itself; "parameters", the
    inverse of the greatest, over the samples, of the parameter's entry of the diagonal of Y'K^-1 Y; "mixed", half
    "ranges" and half "links". Nothing is checked.
    """
    gain = ranges**2
    if shares == "links":
        gain = _each_link(mechanism, regressor, damping, gain, control_period)
    elif shares == "parameters":
        gain = _each_parameter(mechanism, regressor, damping, gain)
    elif shares == "mixed":
        parts = gain, _each_link(mechanism, regressor, damping, gain, control_period)
        gain = np.sum(
            [part / achieved_adaptation_ratio(regressor, damping, part, control_period) for part in parts], axis=0
        )
    return gain * number / achieved_adaptation_ratio(regressor, damping, gain, control_period)


def _each_link(mechanism: Mechanism, regressor: Array, damping: Array, gain: Array, control_period: float) -> Array:
    """Gamma whose part for each link, and for each drive, has the same number."""
    found = gain.copy()
    for group in _groups(mechanism):
        number = achieved_adaptation_ratio(regressor[..., group], damping, gain[group], control_period)
        found[group] = gain[group] / number if number > 0.0 else 0.0
    return _positive(found)


def _each_parameter(mechanism: Mechanism, regressor: Array, damping: Array, gain: Array) -> Array:
    """Diagonal Gamma (k,): the inverse of each parameter's largest share Y'K^-1 Y of the torques."""
    share = (regressor**2 / damping[:, None]).sum(axis=1).max(axis=0)
    found = gain.copy()
    for group in _groups(mechanism):
        least = LEAST_SHARE * float((share[group] * gain[group]).max()) / gain[group]
        found[group] = 1.0 / np.maximum(share[group], least) if np.all(least > 0.0) else 0.0
    return _positive(found)


def _positive(gain: Array) -> Array:
    """Gains, those of parameters that nothing tells of made small instead of zero."""
    return np.maximum(gain, 1e-12 * gain[gain > 0.0].min())


def _groups(mechanism: Mechanism) -> list[list[int]]:
    """Indices of the parameters of each link with its drive's rotor, and of each drive's friction.

    A rotor alone moves little, and an equal share of it would be a gain that makes its estimate ring.
    """
    links = {link.joint.name: link.name for link in mechanism.links}
    groups: dict[tuple[str, bool], list[int]] = {}
    for k, name in enumerate(mechanism.parameter_names):
        owner = name.rpartition(".")[0]
        groups.setdefault((links.get(owner, owner), k >= mechanism.num_energy_parameters), []).append(k)
    return list(groups.values())


def _behind(mechanism: Mechanism) -> Array:
    """Typical inertia (N,) that the nearest driven joint at or before each link moves."""
    of_joints = dict(zip(mechanism.description.primary, typical_inertia(mechanism).tolist(), strict=True))
    found: list[float] = []
    for i, link in enumerate(mechanism.links):
        before = found[link.parent] if link.parent != GROUND else max(of_joints.values())
        found.append(of_joints.get(i, before))
    return np.array(found)
