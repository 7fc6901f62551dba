"""Adaptive control of the PUMA 560 from zero estimates."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import (
    AdaptationLaw,
    ComputedTorque,
    Gains,
    GuardedLearning,
    PDGravity,
    Sinusoids,
    SlotineLi,
    Subspace,
    mapped_gain,
)
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.errors import InputError
from adaptctl.experiments.contest import (
    ADAPTATION_OFF,
    ADAPTIVE,
    FULL,
    NO_MODEL,
    Contender,
    FromRanges,
    Outcome,
    Told,
    chosen_gains,
)
from adaptctl.experiments.experiment import setting, validate_count
from adaptctl.identifiability import (
    FundamentalBasis,
    ReducedModel,
    Reduction,
    essential_space,
    reduce,
    states_within_limits,
)
from adaptctl.recording import Finding, Setting, wording
from adaptctl.tuning.feasible_reference import coulomb_friction
from adaptctl.tuning.learning_rule import MAX_LEARNED, learning_by_rule, slotine_li
from adaptctl.tuning.verification import scaled_links

if TYPE_CHECKING:
    import gymnasium

DAMPING = "damping of each joint, N m s"
FROM_NOTHING = (
    "All masses, centres of mass and inertias are unknown to the adaptive law: its estimates start at zero. Gains and "
    "reference come from the inertias of the robot's file. The base parameters are found from energies, and only these "
    "are adapted: by the default learning law, and by the gradient for comparison."
)
SOME = (
    "The controller has only the first s essential components, sorted by energy: it adapts them from zero, or holds "
    "their true values. The order of the components needs the true parameters; the estimates do not."
)
MAPPED, LEARNING = "adaptive-mapped", "learning"
KEPT, FIXED = "adaptive", "fixed"
"""names of runs with some components"""
STATES = 101
"""states for the components' energies"""
REFERENCE = ("center", "amplitude", "frequency", "start_time")
ENVIRONMENT = ("duration", "control_period", "initial_error")
"""Settings of the environment."""


@dataclass(frozen=True)
class Puma560Adaptive(FromRanges):
    """Experiment of learning to track sinusoids."""

    name: ClassVar[str] = "puma560-adaptive"
    title: ClassVar[str] = "PUMA 560: adaptive tracking from zero estimates"
    joints: ClassVar[int] = 6
    environment_id: ClassVar[str] = "Puma560Tracking"
    asks: ClassVar[str] = "The PUMA 560 follows sinusoids in all six joints."

    robot: str = setting("puma560", "puma560 (Sheu and Walker 1991), or another arm with six joints")
    damping: tuple[float, ...] = setting((90.0, 150.0, 70.0, 20.0, 16.0, 18.0), DAMPING, symbol="K", low=1e-3, high=1e4)
    mass_range: float = setting(5.0, "prior range of masses, kg", low=1e-3, high=1e3)
    first_moment_range: float = setting(2.0, "prior range of first moments, kg m", low=1e-3, high=1e3)
    inertia_range: float = setting(0.6, "prior range of inertias, kg m^2", low=1e-3, high=1e3)
    components: tuple[int, ...] = setting(
        (0,),
        "numbers of essential components, one reduced controller for each; 0 for the controllers with all parameters",
        low=0,
    )
    center: tuple[float, ...] = setting(
        (0.0, -0.6, 0.8, 0.0, 0.5, 0.0), "centre of the sinusoids, rad", low=-10.0, high=10.0
    )
    amplitude: tuple[float, ...] = setting(
        (0.5, 0.4, 0.4, 0.4, 0.4, 0.4), "amplitude of the sinusoids, rad", low=0.0, high=3.2
    )
    frequency: tuple[float, ...] = setting(
        (0.1, 0.125, 0.15, 0.175, 0.2, 0.225), "frequency of the sinusoids, Hz", low=0.0, high=5.0
    )
    start_time: float = setting(2.0, "duration of the smooth (quintic) start, s", low=0.0, high=60.0)
    initial_error: float = setting(0.1, "initial error of every joint, rad or m", low=-1.0, high=1.0)
    parameter_error: float = setting(0.3, "relative error of the links' inertias in the wrong model", low=0.0, high=1.0)
    payload: float = setting(0.0, "payload of the last link, unknown to the controllers, kg", low=0.0, high=1e3)

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_count(self, ("damping", "center", "amplitude", "frequency"), self.joints, "one per joint")
        if len(set(self.components)) < len(self.components) or (0 in self.components and len(self.components) > 1):
            raise InputError("components: expected unique numbers, or only 0")

    @property
    def purpose(self) -> str:
        """Question of the experiment."""
        question = FROM_NOTHING if self.components == (0,) else SOME
        return f"{self.asks} {question} Every controller starts {self.initial_error:g} rad off in every joint."

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Tracking environment on sinusoids."""
        if mechanism.dof != self.joints:
            raise InputError(
                f"robot: {mechanism.name} has {mechanism.dof} joints, but this experiment needs {self.joints}; "
                "use the experiment 'adaptive'"
            )
        more = {"torque_limits": self.torque_limits(mechanism), "initial_error": self.initial_error}
        return self.tracking(mechanism, self.reference, self.environment_id, **more)

    def task(self, mechanism: Mechanism) -> tuple[Any, ...]:
        """Settings of the environment, for comparison."""
        return (self.environment_id, *(getattr(self, name) for name in (*REFERENCE, *ENVIRONMENT)))

    def torque_limits(self, mechanism: Mechanism) -> Array | None:
        """Torque limits (r,), N m (N), or None for the environment's."""
        return None

    @property
    def options(self) -> dict[str, Any]:
        """Options of the reset: a payload."""
        return {"payload": self.payload} if self.payload > 0.0 else {}

    def gains(self, mechanism: Mechanism) -> Gains:
        """Bandwidth, 1/s, and damping, N m s/rad, (r,) each."""
        return Gains(np.full(self.joints, self.bandwidth), np.array(self.damping))

    def learning(self, model: ReducedModel) -> GuardedLearning:
        """Default learning law for these gains."""
        mechanism, gain = model.mechanism, mapped_gain(model, self.adaptation(ReducedModel.full(model.mechanism)))
        limits, damping = self.torque_limits(mechanism), self.gains(mechanism).damping
        limits = finite_torque_limits(mechanism) if limits is None else limits
        return learning_by_rule(model, gain, limits, damping, self.control_period, self.reference)

    @property
    def reference(self) -> Sinusoids:
        """Sinusoids to follow."""
        return Sinusoids(**{name: getattr(self, name) for name in REFERENCE})

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Controllers to compare, the subject first."""

        limits = self.torque_limits(mechanism)

        def law(
            model: ReducedModel, adaptation: AdaptationLaw[Any] | Array | None, first: Array | None = None
        ) -> SlotineLi:
            gains = self.gains(mechanism)
            return slotine_li(
                model, gains.bandwidth, gains.damping, adaptation, first, self.control_period, None, limits
            )

        model = ReducedModel(mechanism, basis)
        if self.components == (0,):
            given = (law, self.adaptation, self.learning, self.gains(mechanism), self.parameter_error, self.seed)
            mapped = f"Gradient, {len(basis.columns)} parameters, Γ mapped"
            return [
                *from_nothing(mechanism, basis, *given),
                Contender(
                    MAPPED,
                    mapped,
                    NO_MODEL,
                    lambda: law(model, mapped_gain(model, self.adaptation(ReducedModel.full(mechanism)))),
                ),
            ]
        reduction, essential = self._reduction(mechanism)
        self._validate_components(mechanism, model, len(reduction.weights))
        ordered = essential[:, reduction.order]
        directions = model.regrouping @ ordered
        gains = self.gain_scale * (ordered.T**2 @ self.ranges.for_parameters(mechanism.parameter_names) ** 2)
        found = []
        for s in self.components:
            some = Subspace(gains[:s], directions[:, :s])
            found.append(Contender(f"{KEPT}-{s}", f"Adapting {s}", NO_MODEL, partial(law, model, some)))
        for s in self.components:
            held = model.regrouping @ reduction.parameters(s)
            found.append(Contender(f"{FIXED}-{s}", f"True {s}", f"{s} components", partial(law, model, None, held)))
        return [*found, Contender(ADAPTATION_OFF, "Adaptation off", NO_MODEL, partial(law, model, None))]

    def _reduction(self, mechanism: Mechanism) -> tuple[Reduction, Array]:
        """Model reduction, and V1 (P, k)."""
        states = states_within_limits(mechanism, STATES, self.seed)
        space = essential_space(mechanism, seed=self.seed, states=states)
        return reduce(space, mechanism, components=space.rank), space.basis

    def _validate_components(self, mechanism: Mechanism, model: ReducedModel, rank: int) -> None:
        if model.regrouping.shape[1] != mechanism.num_energy_parameters:
            raise InputError(
                f"robot: {mechanism.name} has friction, which has no energy components; use an arm without friction"
            )
        for s in self.components:
            if s > rank:
                raise InputError(f"components: {mechanism.name} has {rank} essential parameters, got {s}")

    def chosen(self, mechanism: Mechanism, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Chosen settings: gains, first estimate, reference."""
        ranges = ((self.mass_range, "kg"), (self.first_moment_range, "kg·m"), (self.inertia_range, "kg·m²"))
        rule = "; ".join(f"{self.gain_scale:g}·({value:g} {unit})²" for value, unit in ranges)
        yield from chosen_gains(self.gains(mechanism), rule, "adaptation gain: rate × (prior range)²")
        law, fade = "p(t) = centre + fade(t) · amplitude · sin(2π · frequency · t)", f"{self.start_time:g} s"
        yield Setting("reference", law, f"fade is a quintic over {fade}, starting at rest")

    def told(self, outcome: Outcome, basis: FundamentalBasis) -> Told:
        """Findings on equal controllers, or on errors by components."""
        if self.components == (0,):
            return Told(one_controller(outcome, MAPPED))
        energies, unit = self._reduction(outcome.mechanism)[0].percent_errors, error_unit(outcome.mechanism)
        last = {run.name: 1e3 * run.final_rms_error for run in outcome.runs if run.final_rms_error is not None}
        findings = [
            Finding(f"energy_error.{s}", float(energies[s]), "%", f"energy error of {s} components (equation 23)")
            for s in self.components
        ]
        findings += [
            Finding(f"final_rms_error.{name}", error, unit, f"{outcome.run[name].label}: RMS error, last 2 s")
            for name, error in last.items()
        ]
        least, most = min(self.components), max(self.components)
        many, few, held = (
            wording.number(last.get(name)) for name in (f"{KEPT}-{most}", f"{KEPT}-{least}", f"{FIXED}-{least}")
        )
        answer = (
            f"With {most} adapted components, the final RMS tracking error is {many} {unit}; with {least} adapted "
            f"components it is {few} {unit}, and with their true values held {held} {unit}."
        )
        return Told(findings, answer)


def from_nothing(
    mechanism: Mechanism,
    basis: FundamentalBasis,
    law: Callable[[ReducedModel, Any], SlotineLi],
    gain: Callable[[ReducedModel], Array],
    learning: Callable[[ReducedModel], GuardedLearning],
    gains: Gains,
    share: float,
    seed: int,
) -> list[Contender]:
    """Adaptive controllers from zero, and computed torque."""
    model, full = ReducedModel(mechanism, basis), ReducedModel.full(mechanism)
    true, k, P = mechanism.inertial_parameters, len(basis.columns), len(mechanism.parameter_names)
    off = f"{100 * share:.0f} % wrong"
    # Light joints with Coulomb friction follow far worse by it than by friction at the desired speed: 293 mrad for 0.5.
    exact = "exact; friction at the measured speed" if coulomb_friction(mechanism).any() else "exact"

    def computed_torque(parameters: Array) -> ComputedTorque:
        return ComputedTorque(mechanism, gains.bandwidth, parameters=parameters)

    def with_gravity() -> PDGravity:
        return PDGravity.from_model(model, gains.bandwidth * gains.damping, gains.damping)

    learned = Contender(LEARNING, f"Learning, {k} parameters", NO_MODEL, lambda: law(model, learning(model)))
    return [
        *([learned] if k <= MAX_LEARNED else []),
        Contender(ADAPTIVE, f"Gradient, {k} parameters", NO_MODEL, lambda: law(model, gain(model))),
        Contender(ADAPTATION_OFF, "Slotine-Li, adaptation off", NO_MODEL, lambda: law(model, None)),
        Contender("computed-torque", "Computed torque, true model", exact, lambda: computed_torque(true)),
        Contender(
            "computed-torque-wrong",
            f"Computed torque, model {off}",
            f"links {off}",
            lambda: computed_torque(scaled_links(mechanism, share, seed)),
        ),
        Contender("pd-gravity", "PD with true gravity", "gravity", with_gravity),
        Contender(FULL, f"Gradient, all {P} parameters", NO_MODEL, lambda: law(full, gain(full))),
    ]


def one_controller(outcome: Outcome, mapped: str) -> Iterator[Finding]:
    """Largest difference of torques between two runs."""
    if not {mapped, FULL} <= set(outcome.run):
        return
    one, other = (outcome.run[name].rollout for name in (mapped, FULL))
    common, sizes = min(len(one.time), len(other.time)), [run.estimate.shape[1] for run in (one, other)]
    yield Finding(
        "torque_difference_reduced_full",
        float(np.abs(one.torque[:common] - other.torque[:common]).max(initial=0.0)),
        "N m",
        f"largest difference between the torques of {sizes[0]} and of {sizes[1]} adapted parameters, Γ mapped",
    )
