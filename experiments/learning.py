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
from adaptctl.tuning.rough_links import scaled_links

if TYPE_CHECKING:
    import gymnasium

    from adaptctl.recording.drawing import Drawing

ADAPTIVE = "adaptive"
MAPPED, FULL = "adaptive-mapped", "adaptive-full"
OFFLINE = "Independent parameters from energies"


@dataclass(frozen=True)
class Learning(ClosedLoopExperiment):
    """Base class of experiments in which Slotine-Li learns from zero on the independent parameters, against other
    controllers of the same arm.

    The same with adaptation off; computed torque with true, wrong and no parameters; and Slotine-Li on the
    independent and on all parameters with the gain mapped from these to those (Gamma_beta = K Gamma_D K'),
    which is one controller to round-off, so that what differs is cost alone.
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
        """Question that the experiment answers, in a paragraph."""

    def mechanism(self) -> Mechanism:
        """Mechanism that is driven: the robot, unless a subclass makes more of it."""
        return load(self.robot)

    @abstractmethod
    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """The environment that all contenders drive."""

    @property
    def options(self) -> dict[str, Any]:
        """Options of the environment's reset."""
        return {}

    @abstractmethod
    def gains(self, mechanism: Mechanism) -> Gains:
        """Gains of the tracking loop."""

    @abstractmethod
    def adaptation(self, model: ReducedModel) -> Array:
        """Diagonal (k,) of Gamma for the parameters of a model."""

    @abstractmethod
    def adaptation_setting(self, mechanism: Mechanism) -> str:
        """Text of the adaptation gain Gamma, for the record."""

    @abstractmethod
    def reference_settings(self, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Settings that state the reference where the experiment's own do not."""

    def run(self, progress: Progress) -> Result:
        """Result of the comparison."""
        return shown(self.compare(progress))

    def compare(self, progress: Progress) -> Comparison:
        """The comparison of all contenders' runs, after the offline stage, with findings on them."""
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
        """Runs of all contenders."""
        return contest(env, mechanism, contenders, self.seed, progress, self.options)

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Findings besides the runs."""
        return one_controller(outcome)

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Text of the outcome in a sentence or two; None where it is how much adaptation is worth."""
        return None

    def leading(self, outcome: Outcome) -> Leading | None:
        """The errors that a recording shows first; None where the joints' are."""
        return None

    def drawings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Drawing]:
        """Figures besides those of every comparison."""
        return iter(())

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Contenders in the order in which they drive; the first is the subject. None is made before it is asked
        for."""
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
        """Slotine and Li's law with this experiment's gains, on a model; by default from zero, and not adapting."""
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
    """The model on the parameters that a basis keeps, and the one on all: one each for all who ask."""
    return ReducedModel(mechanism, basis), ReducedModel.full(mechanism)


class Found:
    """Values of findings by name, and their texts for a person."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        self.of = {finding.name: finding.value for finding in findings}

    def text(self, name: str, scale: float = 1.0) -> str:
        """Text of a finding's value, scaled, with three digits; a dash where it was not measured."""
        return wording.number(scale * self.of[name] if name in self.of else None)

    def each(self, what: str, runs: Sequence[ControllerRun], unit: str = "", *, rising: bool = False) -> list[str]:
        """Texts of the findings `what.run` of the runs that have one, such as "0.12 s (Gradient)"."""
        owners = [run for run in runs if f"{what}.{run.name}" in self.of]
        if rising:
            owners.sort(key=lambda run: self.of[f"{what}.{run.name}"])
        return [" ".join(filter(None, (self.text(f"{what}.{run.name}"), unit, f"({run.label})"))) for run in owners]

    def span(self, what: str, runs: Sequence[ControllerRun], unit: str = "") -> str:
        """Text of the least and the greatest finding `what.run` of the runs; empty where none has one."""
        texts = self.each(what, runs, unit, rising=True)
        return " to ".join(dict.fromkeys((texts[0], texts[-1]))) if texts else ""


def numbers(values: Array) -> str:
    """Text of numbers (n,), four digits each, apart by commas."""
    return ", ".join(f"{value:.4g}" for value in values)


def one_controller(outcome: Outcome, mapped: str = MAPPED) -> Iterator[Finding]:
    """Finding on whether reduced and full adaptation are one controller: the largest difference of torques.

    `mapped` is the name of the reduced run whose gain is mapped.
    """
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
