"""Common part of experiments in adaptive tracking: the contenders, and the comparison of their runs."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import AdaptationLaw, ComputedTorque, Gains, SlotineLi, mapped_gain
from adaptctl.dynamics import Mechanism, load
from adaptctl.experiments.contest import Contender, Outcome, contest, live_subject
from adaptctl.experiments.experiment import ClosedLoopExperiment, setting, stated
from adaptctl.identifiability import FundamentalBasis, ReducedModel, essential_space, fundamental_basis
from adaptctl.recording import (
    Comparison,
    ControllerRun,
    Failure,
    Finding,
    Leading,
    Progress,
    Result,
    Setting,
    shown,
    wording,
)
from adaptctl.recording.comparison import ADAPTATION_OFF as ADAPTATION_OFF
from adaptctl.tuning.verification import scaled_links

if TYPE_CHECKING:
    import gymnasium

    from adaptctl.recording.drawing import Drawing

ADAPTIVE = "adaptive"
MAPPED, FULL = "adaptive-mapped", "adaptive-full"
OFFLINE = "Independent parameters from energies"


@dataclass(frozen=True)
class Learning(ClosedLoopExperiment):
    """Abstract base class of experiments in which Slotine and Li's adaptive law learns from initial estimates of zero
    on the k fundamental (base) parameters of an arm, against other controllers of the same arm.

    The others are the same law with adaptation off; computed torque with true, wrong and zero parameters; the law on
    all P parameters, whose adaptation gain is Gamma_D (P, P); and the law on the k with the gain mapped from that,
    Gamma_beta = R Gamma_D R', R (k, P) being the regrouping matrix from all parameters to the k and R' its transpose.
    The last two are one controller to round-off, so that only their cost differs.

    A subclass gives `name`, `title`, the property `purpose` and the methods `environment`, `gains`, `adaptation`,
    `adaptation_setting` and `reference_settings`. `first_estimate` describes the initial estimate, for the report;
    `expected` maps failures of the first controller that the experiment is meant to show to the reasons why. Raises
    `InputError` at construction for settings of the wrong type or out of their bounds, `NonFiniteError` for NaN or
    infinity.
    """

    robot: str = setting("puma560", "a built-in robot or a file (.urdf, .xml, .toml)")
    bandwidth: float = setting(8.0, "how fast errors decay, 1/s", symbol="Λ", low=0.1, high=100.0)
    rate: float = setting(
        0.6,
        "adaptation rate: the gain is it times the square of each parameter's prior range",
        symbol="Γ",
        low=1e-6,
        high=1e3,
    )
    initial_error: float = setting(0.1, "initial error of every joint, rad or m", low=-1.0, high=1.0)
    parameter_error: float = setting(
        0.3, "the wrong model has each link's parameters off by this share, up or down by seed", low=0.0, high=1.0
    )

    first_estimate: ClassVar[str] = "0"
    expected: ClassVar[Mapping[Failure, str]] = {}
    """Failures of the subject that are the experiment's question, and why."""

    @property
    @abstractmethod
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states the question it answers, which an implementation
        must return."""

    def mechanism(self) -> Mechanism:
        """The `Mechanism` that the experiment drives, loaded from `robot` unless a subclass makes another. Raises
        `NotFoundError` for an unknown name, `FileError` for a file that cannot be used, `LoopError` where its kinematic
        loops cannot be closed."""
        return load(self.robot)

    @abstractmethod
    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Gymnasium tracking environment with the `mechanism` as its arm, in which all controllers run: an
        implementation must make it of the experiment's settings, with finite torque limits, N m (N if prismatic), as
        the bounds of its actions. Implementations raise `InputError` for a mechanism that the experiment is not for."""

    @property
    def options(self) -> dict[str, Any]:
        """Options of the reset of the experiment's environment, by name, such as a payload: empty, as here, unless a
        subclass gives some."""
        return {}

    @abstractmethod
    def gains(self, mechanism: Mechanism) -> Gains:
        """Gains of the tracking loop, a `Gains`, which an implementation must return for the r primary (independently
        moving) joints of a `mechanism`: the bandwidth Lambda (r,), 1/s, and the damping K (r,), N m s/rad (N s/m if
        prismatic). Implementations raise `InputError` where no such gains can be found."""

    @abstractmethod
    def adaptation(self, model: ReducedModel) -> Array:
        """Adaptation gain Gamma for the k parameters of a reduced `model`, in their SI units squared per J, which an
        implementation must return: its diagonal (k,) or the whole matrix (k, k)."""

    @abstractmethod
    def adaptation_setting(self, mechanism: Mechanism) -> str:
        """Text for the report that says how the adaptation gain Gamma of a `mechanism` is chosen, which an
        implementation must return. Nothing is checked."""

    @abstractmethod
    def reference_settings(self, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Iterator over settings for the report, a `Setting` (name, value and meaning) each, that state the reference
        where the experiment's own settings do not; an implementation must return it. `env` is the tracking
        environment. Nothing is checked."""

    def run(self, progress: Progress) -> Result:
        """Result of comparing all controllers of the experiment, a `Result`: outcome in words, facts (questions with
        answers), verdict, and a function that writes summary, figures, recording and report into a folder that it is
        given. `progress(what, share)` is called with the step's name and the fraction done, 0 to 1. Ctrl-C keeps the
        runs begun; where there are none, `KeyboardInterrupt` is raised.

        Raises `InputError` for a robot or reference that does not fit the experiment, among them `NotFoundError` for an
        unknown robot, `FileError` for a file that cannot be used and `GainError` for gains too large for the control
        period; `RankError` where the number of fundamental (base) parameters cannot be certified.
        """
        return shown(self.compare(progress))

    def compare(self, progress: Progress) -> Comparison:
        """Comparison, a `Comparison`, of the runs of all controllers with findings on them, for which the fundamental
        (base) parameters are first found from energies. `progress(what, share)` is called with the step's name and the
        fraction done, 0 to 1. Ctrl-C keeps the runs begun, as a comparison that is not complete; where there are none,
        `KeyboardInterrupt` is raised.

        Raises `InputError` for a robot or reference that does not fit the experiment, among them `NotFoundError` for an
        unknown robot, `FileError` for a file that cannot be used and `GainError` for gains too large for the control
        period; `RankError` where the number of fundamental (base) parameters cannot be certified.
        """
        progress(OFFLINE, 0.0)
        mechanism = self.mechanism()
        env = self.environment(mechanism)
        space = essential_space(mechanism, seed=self.seed)
        basis = fundamental_basis(space)
        progress(OFFLINE, 1.0)
        contenders = self.contenders(mechanism, basis)
        outcome = self.outcome(env, mechanism, contenders, progress)
        findings = tuple(self.findings(outcome, basis))
        return Comparison(
            experiment=self.name,
            title=self.title.format(robot=mechanism.name),
            purpose=self.purpose,
            mechanism=mechanism,
            space=space,
            basis=basis,
            runs=outcome.runs,
            torque_limits=env.action_space.high,  # type: ignore[attr-defined]  # a Box, as every torque's space
            settings=tuple(self._settings(mechanism, env)),
            seed=self.seed,
            duration=self.duration,
            findings=findings,
            complete=outcome.complete,
            without_adaptation=ADAPTATION_OFF,
            more_drawings=tuple(self.drawings(outcome, basis)),
            answer=self.answer(outcome, Found(findings)) if outcome.complete else None,
            leading=self.leading(outcome),
            expected=self.expected,
            live=live_subject(env, contenders[0].controller, self.seed, self.options) if outcome.complete else "",
        )

    def outcome(
        self, env: gymnasium.Env[Any, Any], mechanism: Mechanism, contenders: Sequence[Contender], progress: Progress
    ) -> Outcome:
        """Outcome of the contest, an `Outcome`: the runs of all `contenders` (controllers with names) on the
        environment `env` with the arm `mechanism`, in turn, from one seed. `progress(label, share)` is called with a
        contender's label and the fraction of its run done, 0 to 1. Ctrl-C keeps the runs begun; where there are none,
        `KeyboardInterrupt` is raised. Raises `GainError` for gains too large for the control period, `NonFiniteError`
        where a motion diverges to non-finite values."""
        return contest(env, mechanism, contenders, self.seed, progress, self.options)

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over the findings, a `Finding` (named number with unit) each: here one, the largest difference of
        commanded torques, N m (N if prismatic), between adapting the fundamental (base) parameters and adapting all,
        where both were run; a subclass may give others. `outcome`, an `Outcome`, has the runs, `basis` the mechanism's
        fundamental parameters. Nothing is checked."""
        return one_controller(outcome)

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Text for the report that states the outcome in a sentence or two. None, as here, leaves it to the report,
        which then says how much smaller errors are with adaptation than without. `outcome`, an `Outcome`, has the runs,
        `found` the findings by name. Nothing is checked."""
        return None

    def leading(self, outcome: Outcome) -> Leading | None:
        """Errors that recording and report show before the joints' errors, a `Leading`, such as a tool's distance from
        its path: their meaning, the unit in which they are shown, and an array (T,) for each run in `outcome`, T its
        samples; None, as here, where there are no others. Nothing is checked."""
        return None

    def drawings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Drawing]:
        """Iterator over figures for the report besides those of every comparison, a `Drawing` (name, caption and
        function that draws it) each; none unless a subclass gives some. `outcome`, an `Outcome`, has the runs, `basis`
        the mechanism's fundamental (base) parameters. Nothing is checked."""
        return iter(())

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """List of the controllers to compare, a `Contender` (name, label and controller) each, in the order in which
        they run: Slotine and Li's law on the k fundamental (base) parameters in `basis`, the experiment's subject; the
        same with adaptation off; computed torque with true parameters, with wrong ones (every link's off by the
        fraction `parameter_error`) and with zeros; Slotine and Li's law on all parameters; and on the k with the
        adaptation gain mapped from that on all. Each controller is made when first asked for, which raises `GainError`
        for gains too large for the control period. Raises `InputError` for a basis of another geometry than the
        mechanism's."""
        model, full = models(mechanism, basis)
        k, everything = len(basis.columns), len(mechanism.parameter_names)
        true, wrong = mechanism.inertial_parameters, f"{100 * self.parameter_error:.0f} % off"

        def computed_torque(parameters: Array) -> ComputedTorque:
            return ComputedTorque(mechanism, self.gains(mechanism).bandwidth, parameters=parameters)

        def mapped() -> SlotineLi:
            return self.slotine_li(model, mapped_gain(model, self.adaptation(full)))

        return [
            Contender(
                ADAPTIVE,
                f"Slotine-Li, {k} parameters",
                "nothing",
                lambda: self.slotine_li(model, self.adaptation(model)),
            ),
            Contender(ADAPTATION_OFF, "Slotine-Li, adaptation off", "nothing", lambda: self.slotine_li(model)),
            Contender("computed-torque", "Computed torque, true model", "everything", lambda: computed_torque(true)),
            Contender(
                "computed-torque-wrong",
                f"Computed torque, model {wrong}",
                f"links {wrong}",
                lambda: computed_torque(scaled_links(mechanism, self.parameter_error, self.seed)),
            ),
            Contender(
                "computed-torque-none", "Computed torque, no model", "nothing", lambda: computed_torque(0.0 * true)
            ),
            Contender(
                FULL,
                f"Slotine-Li, all {everything} parameters",
                "nothing",
                lambda: self.slotine_li(full, self.adaptation(full)),
            ),
            Contender(MAPPED, f"Slotine-Li, {k} parameters, Γ mapped", "nothing", mapped),
        ]

    def slotine_li(
        self, model: ReducedModel, adaptation: AdaptationLaw[Any] | Array | None = None, first: Array | None = None
    ) -> SlotineLi:
        """Slotine and Li's control law, a `SlotineLi`, on a reduced `model` of k parameters, with this experiment's
        gains and control period. `adaptation` is an adaptation law, or the gain Gamma, its diagonal (k,) or the matrix
        (k, k), in the parameters' SI units squared per J, or None to switch adaptation off; `first` (k,) is the initial
        estimate in SI units, zeros where None. Raises `GainError` for gains too large for the control period,
        `InputError` for arrays of other shapes."""
        gains = self.gains(model.mechanism)
        return SlotineLi(model, gains.bandwidth, gains.damping, adaptation, first, self.control_period)

    def _settings(self, mechanism: Mechanism, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        gains = self.gains(mechanism)
        yield Setting("Λ", numbers(gains.bandwidth), "bandwidth of the tracking loop, 1/s, a joint each")
        yield Setting("K", numbers(gains.damping), "damping, N·m·s (N·s/m), a joint each")
        yield Setting("Γ", self.adaptation_setting(mechanism), "adaptation gain: rate × (prior range)²")
        yield Setting("first estimate", self.first_estimate, "of every parameter")
        yield from self.reference_settings(env)
        yield from stated(self)


@lru_cache(maxsize=8)
def models(mechanism: Mechanism, basis: FundamentalBasis) -> tuple[ReducedModel, ReducedModel]:
    """Pair of reduced models (equations of motion on some of the parameters), a `ReducedModel` each, of a `mechanism`:
    that on the k parameters of a fundamental (base) `basis` and all friction parameters, then that on all P inertial
    and friction parameters. The last eight pairs are cached, so that their compiled code is shared. Raises `InputError`
    for a basis of another geometry than the mechanism's."""
    return ReducedModel(mechanism, basis), ReducedModel.full(mechanism)


class Found:
    """Findings of an experiment, named numbers, by name, with texts made of them. `findings`, the constructor's
    argument, is a sequence of `Finding`; the attribute `of` maps the name of each to its value, in the finding's own
    unit; of two with one name the last counts. Nothing is checked."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        self.of = {finding.name: finding.value for finding in findings}

    def text(self, name: str, scale: float = 1.0) -> str:
        """Value of the finding called `name`, times `scale` (no unit, 1 by default), formatted as text with three
        significant digits; a dash where there is no such finding. Nothing is checked."""
        return wording.number(scale * self.of[name] if name in self.of else None)

    def each(self, what: str, runs: Sequence[ControllerRun], unit: str = "", *, rising: bool = False) -> list[str]:
        """Texts of findings of one kind, one for each of the `runs` that has one, such as "0.12 s (Gradient)": value,
        `unit` and the run's label, in the order of the runs or, if `rising`, in ascending order of value. The finding
        of a run is named `what`, a dot and the run's name. Nothing is checked."""
        owners = [run for run in runs if f"{what}.{run.name}" in self.of]
        if rising:
            owners.sort(key=lambda run: self.of[f"{what}.{run.name}"])
        return [" ".join(filter(None, (self.text(f"{what}.{run.name}"), unit, f"({run.label})"))) for run in owners]

    def span(self, what: str, runs: Sequence[ControllerRun], unit: str = "") -> str:
        """Range of the findings of one kind among the `runs`, formatted as text: the least and the greatest, with
        `unit` and the runs' labels, such as "0.1 s (Natural) to 2 s (Gradient)"; empty where no run has one. The
        finding of a run is named `what`, a dot and the run's name. Nothing is checked."""
        texts = self.each(what, runs, unit, rising=True)
        return " to ".join(dict.fromkeys((texts[0], texts[-1]))) if texts else ""


def numbers(values: Array) -> str:
    """Numbers `values` (n,), n of them, formatted as text with four significant digits each, separated by commas.
    Nothing is checked."""
    return ", ".join(f"{value:.4g}" for value in values)


def one_controller(outcome: Outcome, mapped: str = MAPPED) -> Iterator[Finding]:
    """Iterator over one `Finding` (named number with unit): the largest difference between the commanded torques, N m
    (N if prismatic), of two runs in `outcome`, an `Outcome`. They are "adaptive-full", which adapts all parameters, and
    `mapped`, by default "adaptive-mapped", which adapts the fundamental (base) ones with the adaptation gain mapped
    from that on all; the two are one controller if the difference is round-off. None where either run is missing.
    Nothing is checked."""
    runs = {run.name: run for run in outcome.runs}
    if mapped not in runs or FULL not in runs:
        return
    reduced, full = runs[mapped], runs[FULL]
    k, everything = reduced.rollout.estimate.shape[1], full.rollout.estimate.shape[1]
    common = min(len(reduced.rollout.time), len(full.rollout.time))
    difference = np.abs(reduced.rollout.torque[:common] - full.rollout.torque[:common]).max(initial=0.0)
    yield Finding(
        "torque_difference_reduced_full",
        float(difference),
        "N m",
        f"largest difference between the torques of {k} and of {everything} adapted parameters, Γ mapped",
    )
