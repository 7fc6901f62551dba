"""Comparison of laws at rest with encoders, delay, lag and weak motors: which estimates drift."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import position_unit
from adaptctl.experiments.adaptation_laws import AdaptationLaws
from adaptctl.experiments.contest import Contender, Outcome
from adaptctl.experiments.experiment import FAR, setting
from adaptctl.experiments.learning import ADAPTATION_OFF, Found
from adaptctl.experiments.memories import memory_findings
from adaptctl.experiments.parameter_errors import SAMPLES, ParameterErrors
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import ControllerRun, Failure, Finding

if TYPE_CHECKING:
    from adaptctl.simulation.effects import Effect

LAWS = (
    "sigma-modification",
    "e-modification",
    "dead-zone",
    "projection",
    "composite",
    "bounded-gain-forgetting",
    "cushioned-floor",
    "composite-learning",
    "concurrent-learning",
    "natural",
    "consistent-lift",
    "gradient",
)
TELLING, TELLING_LOOPS = 0.25, 0.1
"""rad at 0.2 Hz: of the motion along which parameters are weighed; loops leave less room"""


@dataclass(frozen=True)
class NoiseAndDelay(AdaptationLaws):
    """Experiment without excitation: adaptation laws stabilise an arm at rest on a plant with encoders, delay, lag and
    weak motors, so that only noise can be learned.

    Velocities are filtered differences of encoder counts; torques are delayed, filtered by a lag and limited. The same
    noise enters the regressor and the sliding variable s (velocity error plus bandwidth times position error): the mean
    of their product is not zero, and estimates that nothing bounds drift (Ioannou and Kokotovic 1984). `error_bound`
    (100 rad or m) is the joint error that ends a run; `expected` maps failures of the first controller that the
    experiment is meant to show to the reasons why. Raises at construction `NotFoundError` for unknown laws,
    `InputError` for a law given twice and settings of the wrong type or out of their bounds, `NonFiniteError` for NaN
    or infinity.
    """

    name: ClassVar[str] = "noise-and-delay"
    title: ClassVar[str] = "{robot}: noise, delay and lag, without excitation"

    laws: tuple[str, ...] = setting(LAWS, "which laws run, the subject first")
    duration: float = setting(60.0, "length of every run, s", low=0.01, high=600.0)
    control_period: float = setting(2e-3, "time a torque is held, s", low=1e-4, high=0.02)
    amplitude: float = setting(0.0, "of each joint's term at 0.2 Hz, rad; 0 holds still", low=0.0, high=2.0)
    dead_zone: float = setting(0.1, "width of the dead zone of s, rad/s", low=1e-6, high=10.0)
    resolution: float = setting(1e-4, "of the encoders at the joints, rad", low=0.0, high=0.1)
    noise: float = setting(1e-4, "deviation of positions before they are counted, rad", low=0.0, high=0.1)
    filter: float = setting(50.0, "cutoff of the differences that velocities are, Hz", low=0.1, high=1e4)
    delay: int = setting(1, "control periods from measurement to torque", low=0, high=64)
    lag: float = setting(3e-3, "time constant of the drives, s; 0 for none", low=0.0, high=1.0)
    strength: float = setting(0.22, "the motors have this share of their torque limits", low=0.01, high=1.0)

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: which estimates drift where nothing
        but noise excites the arm."""
        return (
            f"For {self.duration:g} s an arm, its links known within {100 * self.parameter_error:.0f} %, is to hold "
            f"still, seen through encoders of {self.resolution:g} rad with {self.noise:g} rad of noise. Its torques "
            f"lag and are late by {1e3 * self.delay * self.control_period:g} ms, its motors have "
            f"{100 * self.strength:.0f} % of their strength, and saturate. Nothing excites it, so errors say nothing "
            "of most parameters; but noise in the regressor times noise in the error has a mean, and the gradient "
            f"follows it. {self.comparing}"
        )

    error_bound: ClassVar[float] = FAR
    expected: ClassVar[Mapping[Failure, str]] = {
        Failure.SATURATED: "its motors are weak",
        Failure.NO_BETTER: "nothing excites the arm",
    }

    def motors(self, mechanism: Mechanism) -> Array:
        """Torque limits (r,) of the weak motors at the r primary (independently moving) joints of a `mechanism`, N m (N
        if prismatic): the fraction `strength` of the arm's own limits, or, where a joint has none, of four times the
        most that it needs in 200 random states of up to 2 rad/s and 10 rad/s^2 (m/s, m/s^2), 1 N m (N) at least."""
        return self.strength * super().motors(mechanism)

    def effects(self) -> Iterator[Effect]:
        """Iterator over the plant's effects besides rigid links: encoders of a `resolution` with `noise` (rad),
        velocities that are differences of their positions filtered at `filter` (Hz), a `delay` in control periods, and
        a `lag` of the drives (s) unless it is 0."""
        from adaptctl.simulation.effects import ActuatorLag, ControlDelay, Encoder, FilteredDifferences

        yield Encoder(self.resolution, self.noise, self.velocity_noise)
        yield FilteredDifferences(self.filter)
        yield ControlDelay(self.delay)
        if self.lag:
            yield ActuatorLag(self.lag)

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """List of the controllers to compare, a `Contender` (name, label and controller) each, in the order in which
        they run, one for each of `laws`, the first the experiment's subject, then one with adaptation off: each within
        a `Guarded`, which limits its torque to the motors' limits and stops adaptation while a torque is limited.
        `basis`, a `FundamentalBasis`, has the k fundamental (base) parameters that they adapt. Raises `GainError` for
        gains too large for the control period, `InputError` for a basis of another geometry than the mechanism's."""
        from adaptctl.control import Guarded

        limits = self.motors(mechanism)
        brake = self.gains(mechanism).damping

        def guarded(one: Contender) -> Contender:
            return Contender.of(one.name, one.label, one.knows, Guarded(one.controller, limits, stop_damping=brake))

        return list(map(guarded, super().contenders(mechanism, basis)))

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over the findings, a `Finding` (named number with unit) each. Of each run whose controller has an
        estimate: its parameter error at the end, |w (estimate - true)| / |w true| (no unit), w being the RMS torque
        that each parameter makes along a motion that excites; its drift, |w change| / |w true| a minute (1/min),
        between the estimate's means over the third and the fourth quarter of the run; its RMS tracking error over all
        joints and the run, rad (m); the fraction of control periods with a limited torque (no unit); and the fraction
        of samples (no unit) whose excitation passed the law's threshold, if it has one, or, of laws on pseudo-inertias,
        the least eigenvalue of these, SI units. Then, in s, the delay margin of the tracking loop and its actual delay,
        of control periods, drives and velocity filter. `outcome`, an `Outcome`, has the runs, `basis` the fundamental
        (base) parameters of which the errors are. Nothing is checked."""
        errors = self._errors(outcome, basis)
        contenders = {one.name: one for one in self.contenders(outcome.mechanism, basis)}
        for run in outcome.runs:
            if (over_time := errors.of(run)) is None:
                continue
            yield Finding(f"parameter_error.{run.name}", float(over_time[-1]), "1", f"{run.label}: at the end")
            meaning = f"{run.label}: how far the estimate moves in a minute of the second half"
            yield Finding(f"drift.{run.name}", _drift(errors, run), "1/min", meaning)
            if (error := run.rms_error()) is not None:
                unit = position_unit(outcome.mechanism)
                yield Finding(f"true_rms_error.{run.name}", error, unit, f"{run.label}: of all joints")
            share = float(run.rollout.marks["torque_limited"].mean())
            yield Finding(f"saturated.{run.name}", share, "1", f"{run.label}: share of periods with a torque held back")
            yield from memory_findings(contenders[run.name].controller, run, outcome.mechanism)
        yield from self._loop(outcome.mechanism)

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Sentences for the report with the least and the greatest parameter error at the end and drift in the second
        half of the run (1/min) of the laws that adapt, both fractions (no unit) of the torque of all parameters; None
        where no law does. `outcome`, an `Outcome`, has the runs, `found` the findings by name. Nothing is checked."""
        adapting = [run for run in outcome.runs if run.name != ADAPTATION_OFF]
        drifts = found.span("drift", adapting)
        ended = super().answer(outcome, found)
        return ended and f"{ended} In the second half, estimates move by {drifts} of the parameters a minute."

    def _loop(self, mechanism: Mechanism) -> Iterator[Finding]:
        """Findings: the delay that the tracking loop tolerates, and the delay that there is."""
        from adaptctl.control import ErrorFeedback, margins, typical_inertia

        gains, inertia = self.gains(mechanism), typical_inertia(mechanism)
        inner = gains.damping / inertia
        loops = {ErrorFeedback(a * b, a + b, self.control_period) for a, b in zip(gains.bandwidth, inner, strict=True)}
        least = min(margins(loop.loop()).delay for loop in loops)
        late = (self.delay + 0.5) * self.control_period + self.lag + 1.0 / (2.0 * np.pi * self.filter)
        yield Finding("delay_margin", least, "s", "what the tracking loop tolerates of delay, at typical inertia")
        yield Finding("delay", float(late), "s", "of computing, drives and velocity filter together, to first order")

    def _errors(self, outcome: Outcome, basis: FundamentalBasis) -> ParameterErrors:
        """Parameter errors weighed along a motion that excites: at rest most parameters make no torque."""
        mechanism = outcome.mechanism
        amplitude = TELLING if mechanism.description.loops is None else TELLING_LOOPS
        points = replace(self, amplitude=amplitude).reference(mechanism)(np.linspace(0.0, 20.0, SAMPLES))
        return ParameterErrors.along(ReducedModel(mechanism, basis), points.p, points.v, points.a)


def _drift(errors: ParameterErrors, run: ControllerRun) -> float:
    """Speed (1/min) of an estimate between the means of the third and of the fourth quarter of a run."""
    third, fourth = (part.mean(axis=0) for part in np.array_split(run.rollout.estimate, 4)[2:])
    return errors.apart(third, fourth) / (0.25 * run.duration / 60.0)
