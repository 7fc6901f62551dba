"""Comparison of all adaptation laws and control laws on an arm known roughly and a motion that excites it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import (
    AdaptationLaw,
    AdaptiveComputedTorque,
    BoundedGainForgetting,
    Composite,
    CompositeLearning,
    ComputedTorque,
    ConcurrentLearning,
    ConsistentLift,
    Controller,
    CushionedFloor,
    DeadZone,
    EModification,
    Gains,
    Gradient,
    Halted,
    Natural,
    PassivityIntegral,
    PDGravity,
    Projection,
    Reference,
    SigmaModification,
    Sinusoids,
    SlotineLi,
)
from adaptctl.control.gains.torque_limits import finite_torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NotFoundError
from adaptctl.experiments.contest import Contender, Outcome
from adaptctl.experiments.experiment import setting
from adaptctl.experiments.float_tick import float_tick
from adaptctl.experiments.learning import ADAPTATION_OFF, Found, Learning, numbers
from adaptctl.experiments.memories import forgotten_notes, memory_findings
from adaptctl.experiments.most_exciting import EXCITING, most_exciting
from adaptctl.experiments.parameter_errors import SAMPLES, ParameterErrors, parameter_errors
from adaptctl.experiments.rough_start import RoughStart
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import Comparison, Finding, Progress, Setting, wording
from adaptctl.recording.comparison import color_places

if TYPE_CHECKING:
    import gymnasium

    from adaptctl.recording.drawing import Drawing
    from adaptctl.simulation.effects import Effect

CENTER = (0.0, -0.6, 0.8, 0.0, 0.5, 0.0)
"""rad: a posture of a PUMA with its elbow bent"""
FREQUENCIES = (0.15, 0.3, 0.55, 0.85, 1.2)
"""Hz, each drawn 20 % up or down for every joint, its amplitude as 1/sqrt(frequency)"""
BOUNDS = 4.0
"""deviations of the rough model to which `Projection` keeps"""
REACHES = 400
"""moments of a reference at which loops are asked whether they allow it"""
LAWS = (
    "composite",
    "gradient",
    "sigma-modification",
    "e-modification",
    "dead-zone",
    "projection",
    "bounded-gain-forgetting",
    "cushioned-floor",
    "composite-learning",
    "concurrent-learning",
    "natural",
    "consistent-lift",
    "adaptive-computed-torque",
    "passivity-integral",
    "computed-torque",
    "pd-gravity",
)
RANDOM = "random"
"""Another motion than `EXCITING`."""
EULER = "gradient-euler"
"""Not among the default laws: it is what the trapezium is better than."""


@dataclass(frozen=True)
class AdaptationLaws(RoughStart, Learning):
    """Experiment that compares adaptation laws and control laws, `laws`, on one arm, reference and seed. All start from
    one rough model, which has every link's parameters off by the fraction `parameter_error`: each adaptation law within
    Slotine and Li's control law, each other control law by itself.

    In the settings, s is the sliding variable, the velocity error plus the bandwidth times the position error.
    `leakage` and `sliding_leakage` are the leaks of sigma- and e-modification towards the rough model; `prediction`,
    `cutoff` and `forgetting` belong to laws that learn from errors of predicted, filtered torques. Composite learning
    returns to its stored excitation at the rate `recall`, does not learn from joints excited by less than `excitation`,
    and clears its store where the power of the prediction error passes `alarm`. Concurrent learning keeps a stack of
    `samples`, each new by more than `novelty`. `first_estimate` describes the initial estimate, `comparing` how laws
    are compared, both for the report; `error_bound` (rad or m) is the joint error that ends a run. Raises at
    construction `NotFoundError` for an unknown law or motion, `InputError` for a law given twice or a setting of the
    wrong type or out of its bounds, `NonFiniteError` for NaN or infinity.
    """

    name: ClassVar[str] = "adaptation-laws"
    title: ClassVar[str] = "{robot}: adaptation laws and control laws side by side"
    first_estimate: ClassVar[str] = "a rough model: every link off by --parameter-error, up or down by seed"

    laws: tuple[str, ...] = setting(LAWS, f"which laws run, the subject first; {EULER} is another")
    robot: str = setting("puma560_geared", "a built-in robot or a file whose links rigid bodies are")
    rate: float = setting(
        5.0, "adaptation rate: the gain is it times the square of each parameter's deviation", low=1e-6, high=1e6
    )
    initial_error: float = setting(0.0, "initial error of every joint, rad or m", low=-1.0, high=1.0)
    parameter_error: float = setting(
        0.5, "the rough model has each link's parameters off by this share, up or down by seed", low=0.01, high=0.9
    )
    ratio: float = setting(
        2.0, "damping over bandwidth times each joint's typical inertia", symbol="K", low=0.1, high=100.0
    )
    motion: str = setting(
        RANDOM, f"{RANDOM}: sinusoids by seed; {EXCITING}: Fourier series made to tell most, within the joints' limits"
    )
    amplitude: float = setting(0.25, f"of each joint's {RANDOM} term at 0.2 Hz, rad", low=0.0, high=2.0)
    leakage: float = setting(0.05, "sigma-modification's leak to the rough model, 1/s", symbol="σ", low=1e-6, high=10.0)
    sliding_leakage: float = setting(0.5, "e-modification's, 1/rad", symbol="ν", low=1e-6, high=100.0)
    dead_zone: float = setting(0.02, "width of the dead zone of s, rad/s", low=1e-6, high=10.0)
    prediction: float = setting(
        1000.0,
        "weight of torque prediction errors in parts of the torque limits, N m/s",
        symbol="R",
        low=1e-6,
        high=1e9,
    )
    cutoff: float = setting(5.0, "of the torque filter, rad/s", low=0.1, high=1000.0)
    forgetting: float = setting(2.0, "of least squares, 1/s", low=0.0, high=100.0)
    recall: float = setting(2.0, "how fast composite learning returns to its memory, 1/s", low=0.0, high=100.0)
    excitation: float = setting(
        5.0, "least of a joint's equation that composite learning remembers, 1/s", low=0.0, high=1e9
    )
    alarm: float = setting(0.2, "power missed above which its memory is wrong, and forgotten, W", low=1e-9, high=1e9)
    samples: int = setting(24, "of concurrent learning's stack", low=1, high=64)
    novelty: float = setting(100.0, "of a sample that concurrent learning keeps, 1/s", low=1e-9, high=1e9)
    halt: float = setting(0.0, "when the motion comes to rest, s; 0 for never", low=0.0, high=300.0)
    acceleration_gain: float = setting(
        1.0, "adaptive computed torque, which learns from accelerations, has this share of the gain", low=1e-6, high=1.0
    )
    velocity_noise: float = setting(0.0, "deviation of what is measured of velocities, rad/s", low=0.0, high=1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.motion not in (RANDOM, EXCITING):
            raise NotFoundError(f"motion: expected {RANDOM} or {EXCITING}, got {self.motion!r}")
        for name in self.laws:
            if name not in (*LAWS, EULER):
                raise NotFoundError(f"laws: unknown law {name!r}; laws: {', '.join((*LAWS, EULER))}")
        if len(set(self.laws)) < len(self.laws):
            raise InputError(f"laws: expected each at most once, got {', '.join(self.laws)}")

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: which adaptation and control laws
        track and learn best from a rough model of an arm."""
        return (
            "An arm whose links are known within "
            f"{100 * self.parameter_error:.0f} % follows sums of sinusoids that excite it. {self.comparing}"
        )

    comparing: ClassVar[str] = (
        "Slotine and Li's control law is run with each adaptation law, from the same rough model and with the same "
        "gain, and each other control law with gradient adaptation where it adapts. The parameter error is weighed by "
        "the torque that each parameter makes along a motion that excites, in shares of the torque of all."
    )
    """Sentences on how laws are compared, and by which measure."""

    def compare(self, progress: Progress) -> Comparison:
        """Comparison of the runs of all controllers, a `Comparison`, its answer with a note on each law that found no
        excitation above its threshold and so stored nothing to learn from. `progress(what, share)` is called with the
        step's name and the fraction done, 0 to 1. Ctrl-C keeps the runs begun: the comparison is then not complete.
        Raises `InputError` for a robot or reference that does not fit the experiment, among them `NotFoundError` for an
        unknown robot, `FileError` for a file that cannot be used and `GainError` for gains too large for the control
        period; `RankError` where the number of fundamental (base) parameters cannot be certified."""
        done = super().compare(progress)
        notes = [*([done.answer] if done.answer else []), *forgotten_notes(done.findings)]
        return replace(done, answer=" ".join(notes) or None)

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Gymnasium tracking environment of a `mechanism` on the experiment's reference, with its torque limits and the
        plant's effects besides rigid links, such as noise; a joint error above `error_bound` (rad or m) ends a run.
        Raises `InputError` for a reference that the arm cannot follow."""
        import gymnasium

        return gymnasium.make(
            "adaptctl.envs:adaptctl/Tracking-v0",
            robot=mechanism,
            reference=self.followed(mechanism),
            duration=self.duration,
            control_period=self.control_period,
            initial_error=self.initial_error,
            error_bound=self.error_bound,
            torque_limits=self.motors(mechanism),
            effects=tuple(self.effects()),
        )

    error_bound: ClassVar[float] = 1.0
    """rad or m: the error of a joint that ends a run"""

    def motors(self, mechanism: Mechanism) -> Array:
        """Torque limits (r,) of the motors at the r primary (independently moving) joints of a mechanism, N m (N if
        prismatic): the mechanism's own, or, where a joint has none, four times the most that it needs in 200 random
        states of up to 2 rad/s and 10 rad/s^2 (m/s, m/s^2), 1 N m (N) at least."""
        return finite_torque_limits(mechanism)

    def effects(self) -> Iterator[Effect]:
        """Iterator over the plant's effects besides rigid links: an encoder with velocity noise of standard deviation
        `velocity_noise` (rad/s), none if that is 0."""
        from adaptctl.simulation.effects import Encoder

        if self.velocity_noise:
            yield Encoder(velocity_noise=self.velocity_noise)

    def reference(self, mechanism: Mechanism) -> Sinusoids:
        """Reference of the r primary (independently moving) joints of a `mechanism`, `Sinusoids` in rad (m if
        prismatic): a sum of five sinusoids for each joint, frequencies and phases uniform by `seed`, about a posture
        with a bent elbow (with closed loops, about the home configuration); or, where `motion` is "exciting", the most
        exciting Fourier series. Raises `InputError` for more than six joints and, if "exciting", for loops."""
        if self.motion == EXCITING:
            return most_exciting(mechanism, self.seed)
        if mechanism.dof > len(CENTER):
            raise InputError(f"robot: {mechanism.name} has {mechanism.dof} joints: this experiment is for up to 6")
        center = np.array(CENTER[: mechanism.dof]) if mechanism.description.loops is None else mechanism.home
        rng, shape = np.random.default_rng(self.seed), (len(FREQUENCIES), mechanism.dof)
        frequency = np.array(FREQUENCIES)[:, None] * rng.uniform(0.8, 1.25, shape)
        phase = rng.uniform(-np.pi, np.pi, shape)
        return Sinusoids(center, self.amplitude / np.sqrt(frequency / 0.2), frequency, phase)

    def followed(self, mechanism: Mechanism) -> Reference:
        """Reference of the r primary (independently moving) joints that the runs follow, rad (m if prismatic): the one
        that the method `reference` returns, brought to rest at `halt` (s) unless that is 0. Raises `InputError` where
        kinematic loops cannot be closed along it, and as `reference` does."""
        moving = self.reference(mechanism)
        reference = Halted(moving, self.halt) if self.halt else moving
        p = reference(np.linspace(0.0, self.duration, REACHES)).p
        apart = mechanism.continuation is not None and not mechanism.continuation.reachable(p).all()
        if apart or not mechanism.description.within_conditions(p).all():
            raise InputError(
                f"amplitude: {mechanism.name} is to move farther than its loops allow; make it smaller than "
                f"{self.amplitude:g} rad"
            )
        return reference

    def reference_settings(self, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Iterator over settings for the report, a `Setting` (name, value and meaning) each: the reference's form and
        its frequencies, Hz. `env`, the tracking environment, is not used."""
        if self.motion == EXCITING:
            yield Setting("reference", "Fourier series of five harmonics of 0.1 Hz a joint", "optimised for condition")
            return
        yield Setting("reference", "five sinusoids a joint, phases by seed", "faded in from rest over 2 s")
        yield Setting("reference frequencies", numbers(np.array(FREQUENCIES)), "Hz, ±20 % by joint and seed")

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """List of the controllers to compare, a `Contender` (name, label and controller) each, in the order in which
        they run: one for each of `laws`, the first the experiment's subject, then one with adaptation off. `basis`, a
        `FundamentalBasis`, has the k fundamental (base) parameters that they adapt. Raises `GainError` for gains too
        large for the control period, `InputError` for a basis of another geometry than the mechanism's."""
        model, full = ReducedModel(mechanism, basis), ReducedModel.full(mechanism)
        gains, first = self.gains(mechanism), self.first(model)
        knows = f"links within {100 * self.parameter_error:.0f} %"
        adaptation, control = self._laws(model, first), self._control_laws(model, gains, first)

        def contender(name: str) -> Contender:
            if name == "natural":
                natural = self.slotine_li(full, *self._natural(mechanism))
                return Contender.of(name, "Natural, full parameters", knows, natural)
            if name == "consistent-lift":
                return Contender.of(name, "Consistent lift", knows, self._lifted(model))
            if name in adaptation:
                return Contender.of(
                    name, adaptation[name][0], knows, self.slotine_li(model, adaptation[name][1], first)
                )
            return Contender.of(name, control[name][0], knows, control[name][1])

        off = Contender.of(ADAPTATION_OFF, "Adaptation off", knows, self.slotine_li(model, None, first))
        return [*map(contender, self.laws), off]

    def _natural(self, mechanism: Mechanism) -> tuple[Natural, Array]:
        """Natural adaptation with the others' gain at the rough model, and its first estimate (P,)."""
        return Natural(self.rate * self.parameter_error**2), self.rough(mechanism)

    def _lifted(self, model: ReducedModel) -> SlotineLi:
        """Natural adaptation with prediction of torques, of a lift of the reduced model's parameters."""
        natural, first = self._natural(model.mechanism)
        law = ConsistentLift(natural.rate, first, self._prediction(model), self.cutoff)
        return self.slotine_li(model, law, model.regrouping @ first)

    def _prediction(self, model: ReducedModel) -> Array:
        """Weights (r,) of torque prediction errors."""
        return np.asarray(self.prediction / finite_torque_limits(model.mechanism) ** 2)

    def _laws(self, model: ReducedModel, first: Array) -> dict[str, tuple[str, AdaptationLaw[Any]]]:
        """Adaptation laws on the reduced model, by name, with what to call them."""
        gain, weight = self.adaptation(model), self._prediction(model)
        learning = self.forgetting, self.recall, self.excitation, self.alarm
        return {
            "composite": ("Composite", Composite(gain, weight, self.cutoff)),
            "gradient": ("Gradient", Gradient(gain)),
            EULER: ("Gradient, Euler", Gradient(gain, theta=0.0, cap=0.0)),
            "sigma-modification": ("σ-modification", SigmaModification(gain, self.leakage, first)),
            "e-modification": ("e-modification", EModification(gain, self.sliding_leakage, first)),
            "dead-zone": ("Dead zone", DeadZone(gain, np.full(model.mechanism.dof, self.dead_zone))),
            "projection": ("Projection", self._projected(model, gain, first)),
            "bounded-gain-forgetting": (
                "Least squares, bounded gain",
                BoundedGainForgetting(gain, weight, self.cutoff, self.forgetting),
            ),
            "cushioned-floor": ("Least squares, floor", CushionedFloor(gain, weight, self.cutoff, self.forgetting)),
            "composite-learning": ("Composite learning", CompositeLearning(gain, weight, self.cutoff, *learning)),
            "concurrent-learning": (
                "Concurrent learning",
                ConcurrentLearning(gain, weight, self.cutoff, self.samples, self.novelty),
            ),
        }

    def _projected(self, model: ReducedModel, gain: Array, first: Array) -> Projection[Any]:
        """Gradient law with estimates kept within some deviations of the rough model."""
        reach = BOUNDS * self.deviations(model)
        return Projection(Gradient(gain), first - reach, first + reach)

    def _control_laws(self, model: ReducedModel, gains: Gains, first: Array) -> dict[str, tuple[str, Controller[Any]]]:
        """Control laws besides Slotine and Li's, by name, with what to call them."""
        gain, period = self.adaptation(model), self.control_period
        stiffness, resetting = (
            gains.bandwidth * gains.damping,
            self._projected(model, self.acceleration_gain * gain, first),
        )
        return {
            "adaptive-computed-torque": (
                "Adaptive computed torque",
                AdaptiveComputedTorque(model, gains.bandwidth, first, resetting, period=period),
            ),
            "passivity-integral": (
                "Integral action, gradient",
                PassivityIntegral(model, gains.bandwidth, gains.damping, gain, first, period),
            ),
            "computed-torque": (
                "Computed torque, rough model",
                ComputedTorque.on(model, gains.bandwidth, parameters=first),
            ),
            "pd-gravity": ("PD with rough gravity", PDGravity.on(model, stiffness, gains.damping, first)),
        }

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over the findings, a `Finding` (named number with unit) each. Each law's parameter error at the end,
        |w (estimate - true)| / |w true| (no unit), w being the RMS torque that each parameter makes along the
        reference. The fraction of samples (no unit) whose excitation passed the law's threshold, if it has one, or, of
        laws on pseudo-inertias, the least eigenvalue of these, SI units. The median time, us, of computing one torque
        on Python's floats. `outcome` has the runs, `basis` the fundamental (base) parameters."""
        errors = self._errors(outcome, basis)
        contenders = {c.name: c for c in self.contenders(errors.model.mechanism, basis)}
        for run in outcome.runs:
            if (over_time := errors.of(run)) is not None:
                meaning = f"{run.label}: parameter error at the end, of {over_time[0]:.3g} at the start"
                yield Finding(f"parameter_error.{run.name}", float(over_time[-1]), "1", meaning)
            yield from memory_findings(contenders[run.name].controller, run, outcome.mechanism)
        for run in outcome.runs:
            cost = float_tick(contenders[run.name].controller, run)
            yield Finding(f"tick_floats.{run.name}", 1e6 * cost, "us", f"{run.label}: a tick on Python floats")

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Sentence for the report with the least and the greatest parameter error (no unit), weighed by torque, of the
        laws that adapt; None where no law does. `outcome` has the runs, `found` the findings by name."""
        off = wording.number(found.of.get(f"parameter_error.{ADAPTATION_OFF}"), 2)
        adapting = [run for run in outcome.runs if run.name != ADAPTATION_OFF]
        errors = found.span("parameter_error", adapting)
        start = f"In {self.duration:g} s the parameter error, at first {off} of the parameters, comes to"
        return f"{start} {errors}." if errors else None

    def drawings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Drawing]:
        """Iterator over one figure for the report, a `Drawing`: parameter errors, fractions of the torque of all
        parameters, over time, s. `outcome` has the runs, `basis` the fundamental (base) parameters."""
        from adaptctl.recording.drawing import Drawing

        errors = self._errors(outcome, basis)
        places = color_places(outcome.runs)
        curves = [(places[run.name], run, errors.of(run)) for run in outcome.runs]
        drawn = [(i, run, values) for i, run, values in curves if values is not None]
        yield Drawing(
            "parameter-error",
            "Parameter errors, weighed by the torque that each parameter makes along the motion, in shares of the "
            "torque of all, one line a law that adapts, with its last value.",
            partial(parameter_errors, drawn),
        )

    def _errors(self, outcome: Outcome, basis: FundamentalBasis) -> ParameterErrors:
        mechanism = outcome.mechanism
        points = self.reference(mechanism)(np.linspace(0.0, self.duration, SAMPLES))
        return ParameterErrors.along(ReducedModel(mechanism, basis), points.p, points.v, points.a)
