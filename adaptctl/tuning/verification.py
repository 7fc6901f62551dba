"""Verification of gains in simulated runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.control import Gains, Gradient, GuardedLearning, SlotineLi, mapped_gain
from adaptctl.control.controller import Reference
from adaptctl.control.gains.workspace import Workspace
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.errors import RankError
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Plant
from adaptctl.simulation.effects.actuators import ControlDelay
from adaptctl.simulation.effects.effect import Effect
from adaptctl.simulation.effects.joints import LINK
from adaptctl.simulation.effects.plant_effects import PlantEffects
from adaptctl.tuning.learning_rule import MAX_LEARNED, learning_by_rule, slotine_li
from adaptctl.tuning.trial_runs import TrialRuns, run_trials


class TrialSetting(NamedTuple):
    """Gains of a trial, true parameters (P,), and delay."""

    bandwidth: Array
    damping: Array
    gain: Array
    parameters: Array
    delayed: bool = False


@dataclass(frozen=True, eq=False)
class Trials:
    """Trial runs on a plant and reference, from zero parameters; with `nominal_only` verified by the first alone."""

    plant: Plant
    reference: Reference
    off: Array
    nominal_only: bool = False

    @property
    def possible(self) -> bool:
        """True up to 100 links."""
        return len(self.plant.mechanism.links) <= MAX_COMPILED_LINKS

    def run(self, settings: Sequence[TrialSetting], duration: float) -> TrialRuns:
        """Runs of settings, with the gradient on all parameters."""
        law = _law(self.plant, tuple(self.start.tolist()))
        laws = [law.having(_feedback(one) | {"adaptation.gain": one.gain}) for one in settings]
        return self._simulated(laws, settings, duration)

    def learn(
        self, model: ReducedModel, settings: Sequence[TrialSetting], duration: float, off: Array | None = None
    ) -> TrialRuns:
        """Runs of settings with the same gains, by the default law on a model; errors `off` (M, r) at first."""
        one = settings[0]
        given = np.asarray(self.plant.torque_limits), one.damping, self.plant.control_period, self.reference
        rule = learning_by_rule(model, mapped_gain(model, one.gain), *given, self.delay)
        law = _slotine_li(self.plant, self.start, model, rule).having(_feedback(one))
        laws = [law] * len(settings)
        return self._simulated(laws, settings, duration, off, once=False)  # a user's runs have its code

    def without(self, model: ReducedModel, settings: Sequence[TrialSetting], duration: float) -> TrialRuns:
        """Runs of settings with the same gains, without adaptation."""
        law = _slotine_li(self.plant, self.start, model, None).having(_feedback(settings[0]))
        return self._simulated([law] * len(settings), settings, duration)

    @property
    def delay(self) -> int:
        """Control periods by which the plant's torques arrive late."""
        return delay_of(self.plant.effects)

    @property
    def behind_springs(self) -> bool:
        """True if encoders are behind springs."""
        springs = PlantEffects.of(self.plant.effects).elastic
        return springs is not None and springs.encoders == LINK

    @property
    def start(self) -> Array:
        """Reference's first position (r,) in rad (m)."""
        first: Array = self.reference(np.zeros(1)).p[0]
        return first

    def _simulated(
        self,
        laws: list[SlotineLi],
        settings: Sequence[TrialSetting],
        duration: float,
        off: Array | None = None,
        *,
        once: bool = True,
    ) -> TrialRuns:
        parameters, late = np.array([one.parameters for one in settings]), np.array([one.delayed for one in settings])
        first = self.start + (self.off if off is None else off)
        return run_trials(self.plant, laws, self.reference, first, duration, parameters, late, once=once)


def delay_of(effects: Iterable[Effect]) -> int:
    """Control periods by which effects delay torques."""
    return sum(effect.periods for effect in effects if isinstance(effect, ControlDelay))


def base_model(mechanism: Mechanism) -> ReducedModel:
    """Model of the base parameters, or of all where their number cannot be certified."""
    try:
        return ReducedModel(mechanism)
    except RankError:
        return ReducedModel.full(mechanism)


def _feedback(one: TrialSetting) -> dict[str, Array]:
    """Gains of the feedback, which tuning has judged, by name."""
    return {"bandwidth": one.bandwidth, "damping": one.damping}


@lru_cache(maxsize=8)
def _law(plant: Plant, p: tuple[float, ...]) -> SlotineLi:
    """Law of a plant's trials near p, kept with its code."""
    model = ReducedModel.full(plant.mechanism)
    law = Gradient(np.ones(len(model.columns)), delay=delay_of(plant.effects))
    return _slotine_li(plant, np.array(p), model, law)


def _slotine_li(plant: Plant, p: Array, model: ReducedModel, law: Gradient | GuardedLearning | None) -> SlotineLi:
    few, at = np.full(plant.dof, 1e-9), _near(plant.mechanism, tuple(p.tolist()))
    return slotine_li(model, few, few, law, None, plant.control_period, at, plant.torque_limits)


@lru_cache(maxsize=8)
def _near(mechanism: Mechanism, p: tuple[float, ...]) -> Workspace:
    """Workspace of p alone, kept with what was found in it."""
    return Workspace.along(mechanism, p, 0.0)


DURATION = 20.0  # s
FIRST_INTERVAL, LAST_INTERVAL = 1.0, 2.0  # s of the first and last error
MAX_ERROR = 1.0  # rad (m)
MAX_ERROR_RATIO = 1.0 / 3.0  # of the last error over the first, and over that with adaptation off
MAX_LIMITED_SHARE = 0.05  # of the second half's samples with a torque at its limit
LINK_ERROR = 0.3
LATER = ("one-period delay", "both")  # cases whose torques come a period later
FIRST_LOOK = 2.0  # s in which gains that are too high mostly lose the arm
OTHER_STARTS, OTHER_DURATION = 32, 0.5
"""Other arms and first errors from which a learning law is tried, and s in which most that are lost are."""
SPRING_STARTS, MAX_SPREAD = 8, 0.01
"""First errors from which springs are tried, and how far apart these runs may end, over the first error."""


@dataclass(frozen=True)
class Verification:
    """
    Tracking errors of a simulated run with a tuning's gains.

    Parameters
    ----------
    name : str
        Case: "nominal", "one-period delay", "link errors ±30%" (inertial parameters 30 % up or down) or "both".
    initial_rms_error : float
        RMS error over the first second in rad (m).
    final_rms_error : float
        RMS error over the last 2 s in rad (m).
    final_rms_error_adaptation_off : float
        RMS error over the last 2 s with adaptation off in rad (m); infinite if an error reached 1 rad (m).
    max_error : float
        Largest position error of any joint during the run in rad (m if prismatic); of the nominal one of a learning
        law also within 0.5 s from first errors of other signs, with links 30 % off or a load, if an arm is lost there.
    limited_share : float
        Fraction (0 to 1) of the second half with a torque at its limit.
    unit : str, default "mrad"
        Unit of a thousandth of the errors, in messages: mrad, "mm" if prismatic, both for mixed joints.
    spread : float, default 0.0
        Largest RMS distance in rad (m), over the last 2 s, of eight nominal runs from their mean, whose first errors
        have other signs, with encoders behind springs: what swings forgets no start.

    Examples
    --------
    >>> from adaptctl.tuning import Verification
    >>> Verification("nominal", 0.04, 0.0006, 0.055, 0.1, 0.0).is_learning
    True
    """

    name: str
    initial_rms_error: float
    final_rms_error: float
    final_rms_error_adaptation_off: float
    max_error: float
    limited_share: float
    unit: str = "mrad"
    spread: float = 0.0

    @property
    def is_later(self) -> bool:
        """True if torques came a period later than is stated."""
        return self.name in LATER

    @property
    def is_bounded(self) -> bool:
        """True if errors stayed below 1 rad (m), torques were limited in at most 5 % of the second half, and runs with
        encoders behind springs end at most 1 % of the first error apart."""
        return self.max_error < MAX_ERROR and self.limited_share <= MAX_LIMITED_SHARE and not self.is_swinging

    @property
    def is_swinging(self) -> bool:
        """True if runs with encoders behind springs do not forget their starts."""
        return self.spread > MAX_SPREAD * self.initial_rms_error

    @property
    def is_learning(self) -> bool:
        """True if bounded, and the final error is at most a third of the initial one and of that without adaptation."""
        return self.is_bounded and self.final_rms_error <= MAX_ERROR_RATIO * min(
            self.initial_rms_error, self.final_rms_error_adaptation_off
        )

    def __str__(self) -> str:
        if not self.is_bounded:
            return f"{self.name}: failed, {self._fault}"
        without = (
            f"{1e3 * self.final_rms_error_adaptation_off:.3g} {self.unit}"
            if np.isfinite(self.final_rms_error_adaptation_off)
            else "unstable"
        )
        first, last = 1e3 * self.initial_rms_error, 1e3 * self.final_rms_error
        return f"{self.name}: {first:.3g} to {last:.3g} {self.unit}; without adaptation {without}"

    @property
    def _fault(self) -> str:
        if self.max_error >= MAX_ERROR:
            return f"tracking error {self.max_error:.2g}"
        if self.limited_share > MAX_LIMITED_SHARE:
            return f"{self.limited_share:.0%} at a torque limit"
        return f"springs swing by {1e3 * self.spread:.2g} {self.unit} in the end"


def verifications(
    trials: Trials, model: ReducedModel, gains: Gains, gain: Array, seed: int, duration: float = DURATION
) -> tuple[Verification, ...]:
    """Verifications, four or the nominal one, with the law that is the default for the model."""
    mechanism = trials.plant.mechanism
    own, other = mechanism.inertial_parameters, scaled_links(mechanism, LINK_ERROR, seed)
    cases = [("nominal", own, False), (LATER[0], own, True)]
    cases += [(f"link errors ±{LINK_ERROR:.0%}", other, False), (LATER[1], other, True)]
    cases = cases[:1] if trials.nominal_only else cases
    settings = [TrialSetting(gains.bandwidth, gains.damping, gain, true, late) for _, true, late in cases]
    learns = len(model.columns) <= MAX_LEARNED
    on = trials.learn(model, settings, duration) if learns else trials.run(settings, duration)
    off = trials.without(model, settings, duration)
    nominal, *rest = verified(on, off, [case[0] for case in cases], trials)
    if learns and nominal.max_error < MAX_ERROR:
        farthest = _from_other_starts(trials, model, settings[0], seed)
        nominal = replace(nominal, max_error=farthest) if farthest >= MAX_ERROR else nominal
        if trials.behind_springs and duration > FIRST_LOOK and holds(nominal):
            nominal = replace(nominal, spread=_spread(trials, model, settings[0], seed, duration))
    return nominal, *rest


def _from_other_starts(trials: Trials, model: ReducedModel, setting: TrialSetting, seed: int) -> float:
    """Largest error in rad (m) of other arms soon after starts whose errors have signs that are drawn."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (OTHER_STARTS, trials.plant.dof))
    settings = [setting._replace(parameters=arm) for arm in other_arms(trials.plant.mechanism, seed)]
    runs = trials.learn(model, settings, OTHER_DURATION, signs * trials.off)
    return float(measures(runs, np.asarray(trials.plant.torque_limits))[2].max())


def _spread(trials: Trials, model: ReducedModel, setting: TrialSetting, seed: int, duration: float) -> float:
    """Largest RMS distance in rad (m) of runs of the arm from drawn starts from their mean, in the end."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (SPRING_STARTS, trials.plant.dof))
    runs = trials.learn(model, [setting] * SPRING_STARTS, duration, signs * trials.off)
    late = runs.error[runs.time >= runs.time[-1] - LAST_INTERVAL]
    apart = np.sqrt(np.mean((late - late.mean(axis=1, keepdims=True)) ** 2, axis=(0, 2)))
    return float(apart.max()) if np.all(np.isfinite(apart)) else np.inf


def other_arms(mechanism: Mechanism, seed: int) -> Iterator[Array]:
    """Parameters (P,) of the arm, of one with a last link twice as heavy, and of one with links 30 % off, in turn."""
    own, end = mechanism.inertial_parameters, 10 * len(mechanism.description.bodies)
    loaded = own.copy()
    loaded[end - 10 : end] *= 2.0
    for k in range(OTHER_STARTS):
        yield (own, loaded, scaled_links(mechanism, LINK_ERROR, seed + k))[k % 3]


def holds(run: Verification) -> bool:
    """True if a run ends well below its first error, so that nothing swings."""
    return run.is_bounded and run.final_rms_error <= MAX_ERROR_RATIO * run.initial_rms_error


def verified(on: TrialRuns, off: TrialRuns, names: list[str], trials: Trials) -> Iterator[Verification]:
    """Verifications of runs with adaptation and without."""
    limits, unit = np.asarray(trials.plant.torque_limits), error_unit(trials.plant.mechanism)
    first, last, largest, limited = measures(on, limits)
    _, other, farthest, _ = measures(off, limits)
    for k, name in enumerate(names):
        without = float(other[k]) if farthest[k] < MAX_ERROR else np.inf
        yield Verification(name, float(first[k]), float(last[k]), without, float(largest[k]), float(limited[k]), unit)


def measures(runs: TrialRuns, limits: Array) -> tuple[Array, Array, Array, Array]:
    """First, last and largest error, and limited torques, (M,) each."""
    finite = np.isfinite(runs.largest_error.sum(axis=-1))
    squares = np.where(finite, np.mean(np.where(finite[:, None], runs.error, 0.0) ** 2, axis=-1), np.inf)
    time = runs.time
    first = np.sqrt(squares[time < FIRST_INTERVAL].mean(axis=0))
    last = np.sqrt(squares[time >= time[-1] - LAST_INTERVAL].mean(axis=0))
    largest = np.where(finite, runs.largest_error.max(axis=-1), np.inf)
    at_limit = (np.abs(runs.applied[len(time) // 2 :]) >= (1.0 - 1e-9) * limits).any(axis=-1)
    return first, last, largest, np.asarray(at_limit.mean(axis=0))


def scaled_links(mechanism: Mechanism, share: float, seed: int) -> Array:
    """Parameters (P,) with each body's scaled at random."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(mechanism.description.bodies))
    return scaled(mechanism, 1.0 + share * signs)


def scaled(mechanism: Mechanism, bodies: Array) -> Array:
    """Parameters (P,) with each body's scaled by a factor (bodies,)."""
    scales = dict(zip(mechanism.description.parameter_names, np.repeat(bodies, 10).tolist(), strict=False))
    return np.array([scales.get(name, 1.0) for name in mechanism.parameter_names]) * mechanism.inertial_parameters
