"""Verification of gains: what runs show of an arm as described, of another, and of a late torque."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation.kernel import LARGEST_COMPILED
from adaptctl.control import Gains, SlotineLi
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import Controller, Reference, ReferencePoint
from adaptctl.control.gains.workspace import Workspace
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, where
from adaptctl.simulation import Plant, Rollouts, simulate_many

EVERY = 50
"""control periods from one sample to the next"""


@dataclass(frozen=True, eq=False)
class Delayed(Controller[AdaptiveState]):
    """Slotine and Li's law, `inner`, whose torques come one control period late where `delayed` is 1, and in time where
    it is 0, the default. `delayed` is a tunable number, an argument of the native code, so that arms with and without
    the delay share one code. Nothing is checked here."""

    tunable = ("delayed",)

    inner: SlotineLi
    delayed: float = 0.0

    @property
    def dof(self) -> int:
        """Number r of the joints that the wrapped control law moves."""
        return self.inner.dof

    @property
    def neutral_configuration(self) -> Array:
        """Positions (r,) of the r joints, rad (m if prismatic), at the mechanism's home configuration, where its
        kinematic loops are known to close; zeros without loops."""
        return self.inner.neutral_configuration

    def initial_state(self, p: Array, v: Array) -> AdaptiveState:
        """The internal state before the first control period, the wrapped law's own, of arms at positions p in rad (m
        if prismatic) and velocities v in rad/s (m/s), (..., r) for r joints; its torque is zero. Raises `InputError` on
        a wrong shape of p, `NonFiniteError` on NaN or infinity in it, `SingularityError` near a singularity of the
        kinematic loops."""
        return self.inner.initial_state(p, v)

    def law(
        self, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> tuple[Column, AdaptiveState]:
        """The torque (r,) of r joints, N m (N if prismatic), for one control period, and the wrapped law's internal
        state after it. The torque is the wrapped law's for the last period where torques come late, else its new one.
        Measured positions p are in rad (m) and velocities v in rad/s (m/s), (r,); `reference` has the desired
        positions, velocities and accelerations (r,), in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic);
        `memory` is the internal state of the last control period. Nothing is checked here: the method `step` checks
        shapes."""
        _, after = self.inner.law(p, v, reference, memory)
        late = self.delayed > 0.5
        return Column(where(late, old, new) for old, new in zip(memory.torque, after.torque, strict=True)), after


class TrialSetting(NamedTuple):
    """Setting of one trial run of Slotine and Li's law on r joints: its gains, and the true parameters of the simulated
    arm. Nothing is checked.

    `bandwidth` (r,) is in 1/s and `damping` (r,) in N m s/rad (N s/m if prismatic); `gain` (P,) is the diagonal of the
    adaptation gain on all P inertial and friction parameters, in their units squared per J, zero for adaptation off.
    `parameters` (P,) are the arm's true inertial and friction ones, SI units, in the order of
    `Mechanism.parameter_names`. With `delayed` True, False by default, torques come a control period late.
    """

    bandwidth: Array
    damping: Array
    gain: Array
    parameters: Array
    delayed: bool = False


@dataclass(frozen=True, eq=False)
class Trials:
    """Trial runs on one `plant` and `reference`: simulated closed loops of Slotine and Li's law, which adapts all P
    inertial and friction parameters from an initial estimate of zero. Arms of r joints start at rest; `off` (r,), rad
    (m if prismatic), are their initial positions less the reference's.

    Nothing is learned from a period whose torque was limited. To round-off the law is the same as on a reduced model
    with the adaptation gain mapped to that model's parameters. Nothing is checked.
    """

    plant: Plant
    reference: Reference
    off: Array

    @property
    def possible(self) -> bool:
        """True if the mechanism has at most 100 links, so that native code is made for it: only then can the trials be
        run."""
        return len(self.plant.mechanism.links) <= LARGEST_COMPILED

    def run(self, settings: list[TrialSetting], duration: float) -> Rollouts:
        """Simulated runs, a `Rollouts`, of `duration` seconds, one for each of the M `settings`, computed together in
        native code. Every 50th control period, the first included, is a sample of positions, velocities, torques and
        estimates. Raises `InputError` for a mechanism of more than 100 links and a duration below a control period,
        `SingularityError` where kinematic loops cannot be followed to the start."""
        p = self.reference(np.zeros(1)).p[0]
        law, parameters = _law(self.plant, tuple(p.tolist())), np.array([one.parameters for one in settings])
        laws = [law.having(_numbers(law, one)) for one in settings]
        start = {"parameters": parameters, "p": p + self.off, "v": np.zeros(law.dof)}
        return simulate_many(self.plant, laws, self.reference, duration=duration, record_every=EVERY, **start)


def _numbers(law: Delayed, one: TrialSetting) -> dict[str, object]:
    """All of a law's numbers by name, those of a setting among them: as they are, for tuning has judged them."""
    of = {"bandwidth": one.bandwidth, "damping": one.damping, "adaptation.gain": one.gain}
    return {**law.numbers, "delayed": float(one.delayed), **{f"inner.{name}": value for name, value in of.items()}}


@lru_cache(maxsize=8)
def _law(plant: Plant, p: tuple[float, ...]) -> Delayed:
    """The law of a plant's trials near p, kept, and its code with it; its gains are nobody's."""
    model, few = ReducedModel.full(plant.mechanism), np.full(plant.dof, 1e-9)
    gain, at = np.ones(len(model.columns)), Workspace.along(plant.mechanism, np.array(p), 0.0)
    return Delayed(SlotineLi(model, few, few, gain, None, plant.control_period, at, plant.torque_limits))


DURATION = 20.0
"""s of a verification run"""
BEGINNING, SETTLED = 1.0, 2.0
"""s over which the first and the last error are taken"""
ASTRAY = 1.0
"""rad or m"""
LEARNED, CLIPPED = 1.0 / 3.0, 0.05
"""of the first error and of the error with adaptation off; share of the second half's samples at a torque limit"""
LINKS_OFF = 0.3


@dataclass(frozen=True)
class Verification:
    """Tracking errors of a simulated run of 20 s with a tuning's gains, and of the same run with adaptation off, in rad
    (m if prismatic), RMS over all joints and an interval of time. Nothing is checked.

    `name` is the run: "as described", "torque late" (by a control period), "links off" (each link's ten inertial
    parameters 30 % up or down) or "both". `first` is the error over the first second, `last` that over the last two,
    and `off` that over the last two with adaptation off, infinite where an error then reached 1 rad (m). `largest` is
    the largest magnitude of any joint's error at any time, not RMS. `limited` is the fraction, 0 to 1, of the samples
    in the second half of the run in which a torque was at its limit. `unit` is the unit, as text, of a thousandth of
    the errors: "mrad" by default, "mm" or "mrad or mm" with prismatic joints. Errors are infinite in a run that was not
    finite.
    """

    name: str
    first: float
    last: float
    parameter_error: float
    largest: float
    limited: float
    unit: str = "mrad"

    @property
    def is_bounded(self) -> bool:
        """True if no joint's tracking error reached 1 rad (m if prismatic) in the run, and a torque was at its limit in
        at most 5 % of its second half."""
        return self.largest < ASTRAY and self.limited <= CLIPPED

    @property
    def is_learning(self) -> bool:
        """True if the run stayed near the reference and its error became small. It stayed near if no joint's tracking
        error reached 1 rad (m if prismatic) and a torque was at its limit in at most 5 % of the second half. The RMS
        tracking error over all joints and the last 2 s must be at most a third of that of the first second and of that
        of the last 2 s with adaptation off."""
        return self.is_bounded and self.last <= LEARNED * min(self.first, self.parameter_error)

    def __str__(self) -> str:
        if not self.is_bounded:
            astray = self.largest >= ASTRAY
            why = f"an error of {self.largest:.2g}" if astray else f"{self.limited:.0%} at a torque limit"
            return f"{self.name}: fails, {why}"
        without = f"{1e3 * self.parameter_error:.3g} {self.unit}" if np.isfinite(self.parameter_error) else "falls"
        return f"{self.name}: {1e3 * self.first:.3g} to {1e3 * self.last:.3g} {self.unit}; adaptation off {without}"


def verifications(trials: Trials, gains: Gains, gain: Array, seed: int) -> tuple[Verification, ...]:
    """Verifications, a tuple of four `Verification`, of tracking `gains` and of an adaptation gain with the diagonal
    `gain` (P,) on all P inertial and friction parameters, in their units squared per J.

    They are runs of 20 s, in this order: of the arm as described; with torques a control period late; with the ten
    inertial parameters of each link 30 % up or down, drawn by `seed`, a whole number of at least 0; and with both. Each
    is run with adaptation and without, by `trials`. Raises `InputError` for a mechanism of more than 100 links.
    """
    mechanism = trials.plant.mechanism
    own, other = mechanism.inertial_parameters, scaled_links(mechanism, LINKS_OFF, seed)
    cases = [("as described", own, False), ("torque late", own, True), ("links off", other, False)]
    cases.append(("both", other, True))
    settings = [
        TrialSetting(gains.bandwidth, gains.damping, share * gain, true, late)
        for _, true, late in cases
        for share in (1.0, 0.0)
    ]
    return tuple(_verified(trials.run(settings, DURATION), [case[0] for case in cases], trials))


def _verified(runs: Rollouts, names: list[str], trials: Trials) -> Iterator[Verification]:
    first, last, largest, limited = measures(runs, np.asarray(trials.plant.torque_limits))
    for k, name in enumerate(names):
        on, off = 2 * k, 2 * k + 1
        without = float(last[off]) if largest[off] < ASTRAY else np.inf
        share, unit = float(limited[on]), error_unit(trials.plant.mechanism)
        yield Verification(name, float(first[on]), float(last[on]), without, float(largest[on]), share, unit)


def measures(runs: Rollouts, limits: Array) -> tuple[Array, Array, Array, Array]:
    """Four arrays (M,) that judge M simulated `runs`. They are the tracking error (RMS over all joints) of the first
    second, that of the last 2 s, and the largest error of any joint at any time, all in rad (m if prismatic) and
    infinite where a run was not finite; and the fraction, 0 to 1, of samples in the second half in which a torque was
    at its limit. `limits` (r,) are the torque limits of the r joints, N m (N). Nothing is checked."""
    finite = runs.finite
    squares = np.where(finite, np.mean(np.where(finite[:, None], runs.error, 0.0) ** 2, axis=-1), np.inf)
    time = runs.time
    first = np.sqrt(squares[time < BEGINNING].mean(axis=0))
    last = np.sqrt(squares[time >= time[-1] - SETTLED].mean(axis=0))
    largest = np.where(finite, runs.largest_error.max(axis=-1), np.inf)
    at_limit = (np.abs(runs.applied[len(time) // 2 :]) >= (1.0 - 1e-9) * limits).any(axis=-1)
    return first, last, largest, np.asarray(at_limit.mean(axis=0))


def scaled_links(mechanism: Mechanism, share: float, seed: int) -> Array:
    """All P inertial and friction parameters (P,) of a `mechanism` with rescaled links, SI units, in the order of its
    `parameter_names`. The ten inertial ones of each body (link) are multiplied by 1 + `share` or 1 - `share`, no unit,
    with equal probability, drawn by `seed`, a whole number of at least 0, the same for equal seeds. With a share below
    1 a rigid body stays one; drives keep their parameters. Under linear constraints on the parameters only those that
    are free, which `parameter_names` then has, are multiplied and returned; the others follow from them, so that a body
    need not stay one. Nothing is checked."""
    names, bodies = mechanism.description.parameter_names, len(mechanism.description.bodies)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], bodies)
    scales = dict(zip(names, np.repeat(1.0 + share * signs, 10).tolist(), strict=False))
    return np.array([scales.get(name, 1.0) for name in mechanism.parameter_names]) * mechanism.inertial_parameters
