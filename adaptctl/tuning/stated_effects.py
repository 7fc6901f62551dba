"""Gains that hold in simulation, with the effects that a robot is known to have."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Gains
from adaptctl.control.gains.gain_design import largest_with_delay
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Plant
from adaptctl.simulation.effects.effect import Effect
from adaptctl.simulation.effects.joints import MOTOR
from adaptctl.simulation.effects.plant_effects import PlantEffects
from adaptctl.simulation.integrator import integration
from adaptctl.simulation.transmission import Transmission
from adaptctl.tuning.default_gains import DefaultGains, Proposal
from adaptctl.tuning.learning_rule import MAX_LEARNED
from adaptctl.tuning.verification import (
    DURATION,
    FIRST_LOOK,
    LINK_ERROR,
    MAX_ERROR,
    Trials,
    TrialSetting,
    Verification,
    base_model,
    holds,
    scaled,
    verifications,
    verified,
)

HALVINGS = 7
"""times that gains are halved before none hold"""
SLOWER = 2
"""times that the bandwidth is halved then, from the highest gains on"""
SPRING_DAMPING = 0.3
"""damping of springs over the gain on velocities: one joint behind a spring needs a quarter if motor and link weigh
alike, and less otherwise"""
LEAST_DAMPED = 4.0
"""least decay rate of velocities over the bandwidth: critical damping"""


class Rates(NamedTuple):
    """Bandwidth in 1/s, sampling ratio and adaptation ratio that are asked for."""

    bandwidth: float
    sampling_ratio: float
    adaptation_ratio: float

    def lowered(self, share: float, control_period: float) -> Rates:
        """Share of both ratios, and no more bandwidth than they damp."""
        hold = share * self.sampling_ratio
        most = hold / (LEAST_DAMPED * control_period)
        return Rates(min(self.bandwidth, most) if share < 1.0 else self.bandwidth, hold, share * self.adaptation_ratio)


class Held(NamedTuple):
    """Proposal and its runs, with sentences on lower gains."""

    proposal: Proposal
    verified: tuple[Verification, ...]
    notes: tuple[str, ...] = ()


def plant_with(mechanism: Mechanism, control_period: float, limits: Array, effects: tuple[Effect, ...]) -> Plant:
    """Plant of an arm with stated effects. Raises `InputError` for wrong effects."""
    if not effects:
        return _plant(mechanism, control_period, tuple(limits.tolist()))
    found = PlantEffects.of(effects)
    springs = None if found.elastic is None else Transmission.of(mechanism, found.elastic)
    lightest = mechanism if springs is None else _lightest(mechanism)
    steps = integration(lightest, found.joints, control_period, None, springs)
    return Plant(mechanism, control_period, *steps, torque_limits=limits, effects=effects)


def _lightest(mechanism: Mechanism) -> Mechanism:
    """Arm with the lightest links of any trial, behind whose springs dampers are fastest."""
    return mechanism.with_parameters(scaled(mechanism, np.full(len(mechanism.description.bodies), 1.0 - LINK_ERROR)))


@lru_cache(maxsize=8)
def _plant(mechanism: Mechanism, control_period: float, limits: tuple[float, ...]) -> Plant:
    return Plant(mechanism, control_period, *integration(mechanism, (), control_period), np.array(limits))


def late_share(delay: int) -> float:
    """Share of the ratios at a delay in periods: from two on, with the margin that they have at one."""
    return min(1.0, largest_with_delay(delay) / largest_with_delay(1))


def held(trials: Trials, model: ReducedModel, rule: DefaultGains, asked: Rates, first: Proposal, seed: int) -> Held:
    """Highest gains that hold in all runs with the plant's effects, or else in the nominal run, or else the first."""
    begun = Held(first, verifications(trials, model, first.feasible.gains, first.gain, seed))
    if _hold(begun.verified, trials) or not (trials.plant.effects or len(model.columns) <= MAX_LEARNED):
        return begun
    for k in range(SLOWER + 1):
        slower = asked._replace(bandwidth=0.5**k * asked.bandwidth)
        lower = list(_lower(trials, model, rule, slower, seed, first=0 if k else 1))
        if lower and _hold(lower[-1].verified, trials):
            return lower[-1]
        if narrow := next((one for one in (begun, *lower) if holds(one.verified[0])), None):
            return narrow._replace(notes=(*narrow.notes, "these do not hold in all four runs"))
    return begun._replace(notes=("no lower gains hold either",))


def _lower(
    trials: Trials, model: ReducedModel, rule: DefaultGains, asked: Rates, seed: int, *, first: int
) -> Iterator[Held]:
    """Lower and lower gains with their runs, from the first halving up to those that hold in all."""
    for k in range(first, HALVINGS + 1):
        rates = asked.lowered(0.5**k, rule.control_period)
        try:
            proposal = rule.proposed(*rates, "mixed")
        except InputError:  # no gains hold the arm
            return
        given = trials, model, proposal.feasible.gains, proposal.gain, seed
        if verifications(*given, duration=FIRST_LOOK)[0].max_error >= MAX_ERROR:
            continue
        runs = verifications(*given)
        yield Held(proposal, runs, (_lowered(rates),))
        if _hold(runs, trials):
            return


def _hold(runs: tuple[Verification, ...], trials: Trials) -> bool:
    """True if all runs hold, of which a stated delay excuses those with a further one, or if the nominal run of an arm
    without stated effects is not lost."""
    if not trials.plant.effects:
        return runs[0].max_error < MAX_ERROR
    return all(holds(run) for run in runs if not (trials.delay and run.is_later))


def _lowered(rates: Rates) -> str:
    return (
        f"gains hold in simulation up to a bandwidth of {rates.bandwidth:.2g} 1/s, a sampling ratio of "
        f"{rates.sampling_ratio:.2g} and an adaptation ratio of {rates.adaptation_ratio:.2g}: lowered to these"
    )


def remedy(trials: Trials, gains: Gains) -> str:
    """Advice where no gains hold, these among them."""
    mechanism = trials.plant.mechanism
    if not trials.behind_springs:
        return "choose another bandwidth, period or reference"
    inertia = np.diagonal(mechanism.mass_matrix(trials.start))
    least = SPRING_DAMPING * (gains.damping + inertia * gains.bandwidth)
    where = mechanism.primary_joints[int(least.argmax())].name
    return (
        f"bandwidths down to {gains.bandwidth.max() / 2**SLOWER:.2g} 1/s fail too, as springs that hardly damp swing "
        "with encoders behind them: state their damping, as ElasticJoints(damping=...), of which these gains need "
        f"{least.max():.2g} at {where}, by linear equations, or encoders={MOTOR!r}, if motors are measured"
    )


def gradient_run(trials: Trials, gains: Gains, gain: Array) -> Verification:
    """Run of the gradient, from zero, with the plant's effects."""
    true = trials.plant.mechanism.inertial_parameters
    settings = [TrialSetting(gains.bandwidth, gains.damping, gain, true)]
    off = trials.without(base_model(trials.plant.mechanism), settings, DURATION)
    return next(verified(trials.run(settings, DURATION), off, ["gradient"], trials))
