"""The choice of reference, gains and integration for a mechanism, from its description alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, whole_count
from adaptctl.caching import cached_property
from adaptctl.control import Gains, SlotineLi, mapped_gain
from adaptctl.control.controller import Reference
from adaptctl.control.gains.workspace import Workspace
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, VerdictError
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Integrator, Plant
from adaptctl.simulation.integrator import MOST, integration
from adaptctl.tuning.default_gains import BANDWIDTH, HOLD, DefaultGains, Proposal, Shares, at_most, near_reference
from adaptctl.tuning.feasible_gains import SLOW, FeasibleGains, limitations
from adaptctl.tuning.feasible_reference import TORQUE_SHARE, FeasibleReference
from adaptctl.tuning.verification import (
    ASTRAY,
    CLIPPED,
    LINKS_OFF,
    Trials,
    TrialSetting,
    Verification,
    measures,
    scaled_links,
    verifications,
)

STATIC, LITTLE = 0.95, 3.0
"""share of a torque limit at rest, and ratio of errors without and with adaptation, that are noted"""
SEARCHED = 8.0
"""s of a run of a search"""
BANDWIDTHS, HOLDS, NUMBERS = (4.0, 8.0), (0.25, 0.5), (0.1, 0.2, 0.4, 0.8)
SHARES: tuple[Shares, ...] = ("mixed", "links", "parameters")


@dataclass(frozen=True, eq=False)
class Tuning:
    """Reference, gains and integration that `tune` chose for a `mechanism` of r joints and P inertial and friction
    parameters. Nothing is checked.

    `period` T (s) is how long a torque is held, `reference` the trajectory, `initial_error` (r,), in rad (m if
    prismatic), the arm's position less the reference's at time 0. `gains` are Slotine and Li's bandwidth Lambda, 1/s,
    and damping K, N m s/rad (N s/m), (r,) each; `adaptation` (P,) is the diagonal of the adaptation gain Gamma on all
    parameters, in their units squared per J. A period is simulated in `substeps` steps of the `integrator`.
    `torque_limits` (r,) are in N m (N); `torque_share` (r,) is the largest fraction of them that the reference asks
    for, no unit.

    `sampling_ratio` is the upper bound that K was made for of the damping number T lambda_max((M + T B)^-1 K) at random
    positions near the reference, with the mass matrix M, the viscous friction B and lambda_max the largest eigenvalue;
    K is below it where torque limits are tighter. The sampling ratio of a `SamplingRatio` is another: it is found, not
    asked for, counts Lambda too, takes friction into account exactly, and comes from a local search over a set of
    positions. `achieved_adaptation_ratio` is T lambda_max(K^-1 Y Gamma Y'), the greatest over samples of the reference,
    with the regressor Y (r, P) and its transpose Y'. Both have no unit and are stable below 2.

    `limited_by` (r,) are sentences on what limits each joint's gains, `verified` the `Verification` runs with these
    gains, none for a mechanism of more than 100 links, for which no native code is made, and `notes` sentences on what
    else matters, none by default.
    """

    mechanism: Mechanism
    control_period: float
    reference: Reference
    initial_error: Array
    gains: Gains
    adaptation: Array
    substeps: int
    integrator: Integrator
    torque_limits: Array
    torque_share: Array
    sampling_ratio: float
    adaptation_ratio: float
    limited_by: tuple[str, ...]
    verified: tuple[Verification, ...]
    notes: tuple[str, ...] = ()

    def gain_on(self, model: ReducedModel) -> Array:
        """The adaptation gain Gamma (k, k) on a reduced `model`'s k fundamental (base) parameters, in their units
        squared per J. Adapting these is then the same as adapting all P inertial and friction parameters of the
        mechanism with the tuning's diagonal Gamma (P,). Raises `InputError` for a model of another number of parameters
        P."""
        return mapped_gain(model, self.adaptation)

    @cached_property
    def workspace(self) -> Workspace:
        """Set of joint positions for which the gains are checked, a `Workspace`: 60 positions of the reference, evenly
        spaced in its first 20 s, with a margin about each of them. The margin is the size of the largest of the joints'
        initial errors (rad, m if prismatic). Raises `InputError` where kinematic loops can be closed at none of the
        positions."""
        return near_reference(self.mechanism, self.reference, self.initial_error)

    def controller(self, model: ReducedModel, adaptation: bool = True, *, anyway: bool = False) -> SlotineLi:
        """Slotine and Li's controller, a `SlotineLi`, with the tuning's gains, control period and torque limits on a
        reduced `model` of the mechanism. Its initial estimate is zero; it does not adapt where `adaptation` is False.
        Raises `VerdictError` where it adapts and the arm as described does not learn with these gains (`learns`),
        unless `anyway`; `GainError` where the gains are too large for the period at a position in the tuning's
        `workspace`, `InputError` for a model of another number of joints or, with adaptation, of parameters."""
        if adaptation and not anyway:
            self.validate_learning("anyway=True")
        gain, gains = self.gain_on(model) if adaptation else None, self.gains
        given = None, self.control_period, self.workspace, self.torque_limits
        return SlotineLi(model, gains.bandwidth, gains.damping, gain, *given)

    @property
    def is_learning(self) -> bool:
        """True if the arm as described learns with these gains, in the first verifying run of 20 s; False where nothing
        was run. The run must stay near the reference: no joint's tracking error reaches 1 rad (m if prismatic), and in
        at most 5 % of the second half a torque is at its limit. Its RMS tracking error over all joints and the last 2 s
        must be at most a third of that of the first second and of that of the last 2 s with adaptation off."""
        return bool(self.verified) and self.verified[0].is_learning

    @property
    def failed(self) -> bool:
        """True if the arm as described was run with these gains and does not learn; False also where nothing was
        run."""
        return bool(self.verified) and not self.verified[0].is_learning

    def validate_learning(self, otherwise: str) -> None:
        """Raise `VerdictError` where the tuning has `failed`; `otherwise` says in the message how to take the gains
        all the same."""
        if self.failed:
            raise VerdictError(
                f"{self.mechanism.name}: these gains fail in simulation ({self.verified[0]}); choose another "
                f"bandwidth, period or reference, or take them all the same with {otherwise}"
            )


def tune(
    mechanism: Mechanism,
    *,
    control_period: float = 1e-3,
    reference: Reference | None = None,
    initial_error: ArrayLike | None = None,
    bandwidth: float = BANDWIDTH,
    sampling_ratio: float = HOLD,
    adaptation_ratio: float = 0.5,
    search: int = 0,
    seed: int = 0,
) -> Tuning:
    """A `Tuning` of a `mechanism` of r joints: a reference trajectory, gains, and the integrator and its number of
    steps a control period, with which Slotine and Li's law learns its parameters from zero.

    The law is torque = Y estimate - K s, s = v - v_d + Lambda (p - p_d), d estimate/dt = -Gamma Y' s. p and v (r,) are
    positions and velocities, p_d and v_d the reference's, in rad and rad/s (m and m/s if prismatic), Y (r, P) is the
    regressor of the P inertial and friction parameters and Y' its transpose; Lambda (1/s) and K (N m s/rad, N s/m if
    prismatic) are gains of each joint, Gamma (P, P) is the adaptation gain in the parameters' units squared per J.

    `period` is the control period T (s), 1 ms by default. The `reference`, unless given, is drawn by `seed` within 60 %
    of the torque limits; the `initial_error` (rad or m, one number or (r,)), position less the reference's at time 0,
    unless given, is 0.1 rad or m, and less where a range or a torque limit is small. Lambda is `bandwidth` (1/s), or
    less for a joint whose initial error 0.3 of its torque limit brings back no faster. K is the largest, joint by
    joint, with T lambda_max((M + T B)^-1 K) of at most `hold` (no unit) at random positions near the reference, within
    torque limits: lambda_max is the largest eigenvalue, M the mass matrix and B the viscous friction. Gamma, a
    diagonal, is half in proportion to the squares of the parameters' prior ranges (greatest plausible errors) and half
    the same, but scaled link by link to an equal effect on torques, with T lambda_max(K^-1 Y Gamma Y') of `adaptation`
    (no unit).

    `search` is the number of other settings of bandwidth, `hold`, `adaptation` and proportions of Gamma that are tried,
    of a grid of 48, zero, the default, for none. Each is run on links whose ten inertial parameters are 30 % up or
    down, with torques in time and a period late; the setting is taken whose tracking error (RMS over all joints and the
    last 2 s, of the worse run) is least. The gains found are verified in closed loop. Mechanisms of more than 100
    links, for which no native code is made, are neither searched nor verified.

    Raises `InputError` for settings that are out of range (above 0 and at most: `period` 0.1, `bandwidth` 1000, `hold`
    1.5, `adaptation` 1; `search` and `seed` whole numbers of at least 0; `initial_error` finite and of r joints), for
    joints that move nothing that has inertia, and where M is not positive definite; for a given `reference`,
    `NonFiniteError` where its points are not finite and `SingularityError` where kinematic loops cannot be closed at
    its first one.
    """
    bandwidth, sampling_ratio = at_most("bandwidth", bandwidth, 1e3), at_most("sampling_ratio", sampling_ratio, 1.5)
    adaptation_ratio, search = at_most("adaptation_ratio", adaptation_ratio, 1.0), whole_count(search, "search")
    rule = DefaultGains.on(
        mechanism, control_period=control_period, reference=reference, initial_error=initial_error, seed=seed
    )
    first, limits = rule.proposed(bandwidth, sampling_ratio, adaptation_ratio, "mixed"), rule.limits
    plant = _plant(mechanism, rule.control_period, tuple(limits.tolist()))
    trials = Trials(plant, rule.reference, rule.initial_error)
    chosen = _searched(trials, rule, first, search, seed) if search and trials.possible else first
    carried, gain = chosen.feasible, chosen.gain
    verified = verifications(trials, carried.gains, gain, seed) if trials.possible else ()
    return Tuning(
        mechanism,
        rule.control_period,
        rule.reference,
        rule.initial_error,
        carried.gains,
        gain,
        plant.substeps,
        plant.integrator,
        limits,
        rule.found.asked,
        chosen.sampling_ratio,
        chosen.adaptation_ratio,
        limitations(mechanism, carried),
        verified,
        (*_notes(mechanism, rule.found, carried, plant), *_run_remarks(verified, trials.possible)),
    )


@lru_cache(maxsize=8)
def _plant(mechanism: Mechanism, control_period: float, limits: tuple[float, ...]) -> Plant:
    """The plant of trials, kept, and the code of its trials with it."""
    return Plant(mechanism, control_period, *integration(mechanism, (), control_period), np.array(limits))


def _searched(trials: Trials, rule: DefaultGains, first: Proposal, count: int, seed: int) -> Proposal:
    """The best of the `first` proposal of gains and `count` others, a `Proposal`: the one whose tracking error (RMS
    over all joints and the last 2 s, of the worse of two simulated runs of 8 s) is least. The others are drawn by
    `seed` from a grid of 48, none twice, less those for which there are no gains.

    In both runs the ten inertial parameters of each link are 30 % up or down, in another way each; in the second run
    torques come a control period late besides, for gains judged without a delay may be unstable with one. Runs in which
    a joint's error reached 1 rad (m if prismatic), or in which a torque was at its limit for over 5 % of the second
    half, count as failed; where all fail, the first proposal is returned. `trials` runs them, `rule` makes the gains.
    Raises `InputError` where the mechanism has more than 100 links, for which no native code is made.
    """
    tried = [first, *_drawn(rule, count, seed)]
    arms = [scaled_links(trials.plant.mechanism, LINKS_OFF, seed + k) for k in (1, 2)]
    settings = [
        TrialSetting(one.feasible.gains.bandwidth, one.feasible.gains.damping, one.gain, true, late)
        for one in tried
        for true, late in zip(arms, (False, True), strict=True)
    ]
    runs = trials.run(settings, SEARCHED)
    _, last, largest, limited = measures(runs, np.asarray(trials.plant.torque_limits))
    failed = (largest >= ASTRAY) | (limited > CLIPPED)
    worse: Array = np.where(failed, np.inf, last).reshape(-1, 2).max(axis=1)
    return tried[int(worse.argmin())]


def _drawn(rule: DefaultGains, count: int, seed: int) -> list[Proposal]:
    """Proposals of different numbers, in an order by seed; as many as there are."""
    grid = [(a, b, c, kind) for a in BANDWIDTHS for b in HOLDS for c in NUMBERS for kind in SHARES]
    order = np.random.default_rng(seed).permutation(len(grid))[:count]
    found = []
    for bandwidth, hold, number, kind in (grid[k] for k in order):
        try:
            found.append(rule.proposed(bandwidth, hold, number, cast(Shares, kind)))
        except InputError:  # no gains hold the arm: the first proposal has said so
            continue
    return found


def _notes(mechanism: Mechanism, found: FeasibleReference, carried: FeasibleGains, plant: Plant) -> Iterator[str]:
    """Sentences on a mechanism that is hard to tune: a joint that can only creep, a slow bandwidth, impossible
    parameters."""
    for j, joint in enumerate(mechanism.primary_joints):
        if found.static[j] > STATIC:
            yield f"{joint.name}: gravity and friction ask {found.static[j]:.0%} of its torque limit: it can only creep"
        elif found.asked[j] > max(TORQUE_SHARE, 0.5 * (1.0 + found.static[j])) + 1e-9:
            yield f"{joint.name}: the reference asks {found.asked[j]:.0%} of its torque limit"
        if found.reduced[j] < 0.5:
            yield f"{joint.name}: moved by {found.reduced[j]:.2g} of what its limits allow, for its torque's sake"
        if (rate := carried.gains.bandwidth[j]) < SLOW:
            yield f"{joint.name}: its torque limit allows a bandwidth of {rate:.2g} 1/s: learning takes minutes"
    if wrong := mechanism.description.inconsistent_links:
        yield f"no rigid body has the inertial parameters of {', '.join(wrong)}"
    if plant.integrator.implicit:
        yield f"friction is too stiff for {MOST} explicit steps a period: {plant.substeps} implicit ones are taken"


def _run_remarks(verified: tuple[Verification, ...], possible: bool) -> Iterator[str]:
    """Sentences on the runs that verify a tuning."""
    if not possible:
        yield "too many links to compile: nothing was searched or verified"
    for run in verified[:1]:
        ratio = run.parameter_error / run.last if run.last > 0.0 else math.inf
        if ratio < LITTLE:
            yield "adaptation off tracks nearly as well: there is little to learn on this reference"
