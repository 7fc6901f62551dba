"""Comparison of control of the tool against control of the joints, on a tool's path in the world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import (
    Composite,
    ComputedTorque,
    TaskSpaceSlotineLi,
)
from adaptctl.control.gains.torque_limits import finite_torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.errors import InputError
from adaptctl.experiments.contest import Contender, Outcome
from adaptctl.experiments.experiment import require_count, setting
from adaptctl.experiments.learning import ADAPTATION_OFF, Found, Learning
from adaptctl.experiments.tip_path import ARMS, ArmWithTip, TipPath
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import ControllerRun, Finding, Leading, Setting
from adaptctl.recording.comparison import color_places

if TYPE_CHECKING:
    import gymnasium
    from matplotlib.figure import Figure

    from adaptctl.recording.drawing import Drawing

BEGINNING, END = 1.0, 2.0
"""s at the start and at the end of a run over which the tool's error is averaged"""
SAMPLES = 600


@dataclass(frozen=True)
class TaskSpaceTracking(TipPath, Learning):
    """Experiment on control in task space: the tool of an arm of three degrees of freedom tracks a path in the world,
    from zero initial estimates of the arm's parameters.

    The laws are Slotine and Li's in task space, with the gradient, with composite adaptation, with a damped Jacobian
    and with adaptation off; in joints, on the same path by inverse kinematics; and computed torque with the true
    parameters. In the settings Λ is the bandwidth (1/s) and I a joint's typical inertia (the median of its entry of the
    mass matrix's diagonal over 200 random configurations). Raises `InputError` at construction for a `center`,
    `amplitude`, `frequency` or `phase` that has not three entries (x, y, z), and for settings of the wrong type or out
    of their bounds, `NonFiniteError` for NaN or infinity.
    """

    name: ClassVar[str] = "task-space"
    title: ClassVar[str] = "{robot}: a tool on a path in the world"

    robot: str = setting("puma560_arm3", "puma560_arm3, or semi_direct_drive, whose tool moves through a closed loop")
    stiffness: float = setting(
        3.0, "damping K is this times Λ times each joint's typical inertia", symbol="K/(Λ I)", low=0.1, high=100.0
    )
    mass_range: float = setting(10.0, "prior range of masses, kg", low=1e-3, high=1e3)
    first_moment_range: float = setting(4.0, "prior range of first moments, kg m", low=1e-3, high=1e3)
    inertia_range: float = setting(1.0, "prior range of inertias, kg m^2", low=1e-3, high=1e3)
    singularity: float = setting(0.1, "damping of the damped Jacobian, m", symbol="μ", low=0.0, high=10.0)
    prediction: float = setting(
        100.0, "weight of torque prediction errors in parts of the torque limits, N m/s", symbol="R", low=1e-6, high=1e9
    )
    center: tuple[float, ...] = setting((0.55, 0.0, 0.47), "centre of the tool's path, m", low=-10.0, high=10.0)
    amplitude: tuple[float, ...] = setting((0.1, 0.25, 0.15), "amplitude of the tool's path, m", low=0.0, high=10.0)
    frequency: tuple[float, ...] = setting((0.4, 0.2, 0.2), "frequency of the tool's path, Hz", low=0.0, high=5.0)
    phase: tuple[float, ...] = setting((1.5708, 0.0, 1.5708), "phase of the tool's path, rad", low=-10.0, high=10.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count(self, ("center", "amplitude", "frequency", "phase"), 3, "x, y and z")

    @property
    def purpose(self) -> str:
        """Paragraph of text for the experiment's report that states its question: how control in task space compares
        with control in joints on a tool's path."""
        return (
            "A tool follows a path in the world, and nobody tells the controller the arm's inertial parameters. The "
            "task-space law takes the tool's error and chooses joint velocities through the Jacobian; the law in "
            "joints gets the same path by inverse kinematics. Every controller drives the same environment from the "
            f"same seed, and starts {self.initial_error:g} rad off in every joint."
        )

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Gymnasium tracking environment of a `mechanism` on the tool's path, turned into joint positions (rad). Raises
        `InputError` for a robot whose tool is not known and for a path that is out of reach."""
        import gymnasium

        return gymnasium.make(
            "adaptctl.envs:adaptctl/Tracking-v0",
            robot=mechanism,
            reference=self.in_joints(self.tip(mechanism), self.arm),
            duration=self.duration,
            control_period=self.control_period,
            initial_error=self.initial_error,
        )

    @property
    def arm(self) -> ArmWithTip:
        """Arm that the setting `robot` names, with the point that is its tool, an `ArmWithTip`. Raises `InputError` for
        a robot whose tool is not known."""
        known = {arm.robot: arm for arm in ARMS}
        if self.robot not in known:
            raise InputError(f"robot: expected one whose tool is known, {' or '.join(known)}, got {self.robot!r}")
        return known[self.robot]

    def tip(self, mechanism: Mechanism) -> Tip:
        """Tool of a `mechanism`, a `Tip`: a point fixed to one of its links. Raises `InputError` for a `robot` whose
        tool is not known, or a mechanism without that link."""
        return self.arm.on(mechanism)

    def reference_settings(self, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Iterator over settings for the report, a `Setting` (name, value and meaning) each: the path's formula, how it
        is turned into joint positions, and the tool's position (m) in its link's frame. `env`, the tracking
        environment, is not used. Raises `InputError` for a `robot` whose tool is not known."""
        yield from self.path_settings("tool")
        yield Setting("tool", " ".join(f"{x:g}" for x in self.arm.tip), f"m, in the frame of {self.arm.link}")

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """List of the controllers to compare, a `Contender` (name, label and controller) each, in the order in which
        they run: Slotine and Li's law in task space with the gradient, the experiment's subject; the same with
        adaptation off, with composite adaptation, and with a damped Jacobian; Slotine and Li's law in joints; and
        computed torque with the true parameters. `basis`, a `FundamentalBasis`, has the k fundamental (base) parameters
        that they adapt. Raises `GainError` for gains too large for the control period, `InputError` for a robot whose
        tool is not known and a basis of another geometry than the mechanism's."""
        model, gains = ReducedModel(mechanism, basis), self.gains(mechanism)
        gain, tool = self.adaptation(model), np.array(self.arm.tip)
        composite = Composite(gain, self.prediction / finite_torque_limits(mechanism) ** 2)

        def task_space(law: Any, singularity: float = 0.0) -> TaskSpaceSlotineLi:
            return TaskSpaceSlotineLi(
                model,
                gains.bandwidth,
                gains.damping,
                law,
                period=self.control_period,
                link=self.arm.link,
                tool=tool,
                singularity=singularity,
                reference_in_joints=True,
            )

        true = ComputedTorque(mechanism, gains.bandwidth)
        return [
            Contender.of("task-space", "Task space, gradient", "nothing", task_space(gain)),
            Contender.of(ADAPTATION_OFF, "Task space, adaptation off", "nothing", task_space(None)),
            Contender.of("task-space-composite", "Task space, composite", "nothing", task_space(composite)),
            Contender.of("task-space-damped", "Task space, damped", "nothing", task_space(gain, self.singularity)),
            Contender.of("joint-space", "Joints, gradient", "nothing", self.slotine_li(model, gain)),
            Contender.of("computed-torque", "Computed torque, true model", "everything", true),
        ]

    def findings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Finding]:
        """Iterator over the findings, a `Finding` (named number with unit) each: the RMS distance, mm, between the tool
        and its desired position on the path, of each run in the first second and in the last two. `outcome`, an
        `Outcome`, has the runs; `basis` is not used. Nothing is checked."""
        for run in outcome.runs:
            errors, time = self._tool_errors(outcome.mechanism, run), run.rollout.time
            for what, inside in (("first", time < BEGINNING), ("final", time >= run.duration - END)):
                rms = float(np.sqrt(np.mean(errors[inside] ** 2)))
                meaning = f"{run.label}: the tool's RMS error, {what} {BEGINNING if what == 'first' else END:g} s"
                yield Finding(f"{what}_tool_error.{run.name}", 1e3 * rms, "mm", meaning)

    def answer(self, outcome: Outcome, found: Found) -> str | None:
        """Sentences for the report, never None here, with the tool's RMS distances from its path in the last two
        seconds, mm: under the experiment's subject, with adaptation off, and the least of all controllers. `outcome`,
        an `Outcome`, has the runs, `found` the findings by name. Nothing is checked."""
        subject, off = (found.text(f"final_tool_error.{name}") for name in ("task-space", ADAPTATION_OFF))
        text = f"In the last {END:g} s the tool is off its path by {subject} mm (RMS), with adaptation off by {off} mm."
        least = found.each("final_tool_error", outcome.runs, "mm", rising=True)[:1]
        return " ".join((text, *(f"The least of all controllers is {one}." for one in least)))

    def leading(self, outcome: Outcome) -> Leading | None:
        """Errors that recording and report show before the joints' errors, a `Leading`, never None here: the distances
        (T,), m and shown in mm, of the tool from its path at the T samples of each run in `outcome`. Raises
        `InputError` for a robot whose tool is not known."""
        errors = {run.name: self._tool_errors(outcome.mechanism, run) for run in outcome.runs}
        return Leading("Distance of the tool from its path", "mm", errors)

    def drawings(self, outcome: Outcome, basis: FundamentalBasis) -> Iterator[Drawing]:
        """Iterator over one figure for the report, a `Drawing` (name, caption and function that draws it): the tool's
        distance from its path, mm, over time, s. `outcome`, an `Outcome`, has the runs; `basis` is not used. Nothing is
        checked."""
        from adaptctl.recording.drawing import Drawing

        places = color_places(outcome.runs)
        curves = [(places[run.name], run, self._tool_errors(outcome.mechanism, run)) for run in outcome.runs]
        yield Drawing(
            "tool-error",
            "Distance of the tool from its path, one line a controller (logarithmic scale).",
            partial(tool_errors, curves),
        )

    def _tool_errors(self, mechanism: Mechanism, run: ControllerRun) -> Array:
        """Distances (T,) of the tool from its path, m."""
        away = self.tip(mechanism).at(run.rollout.p) - self.path(run.rollout.time).p
        return np.asarray(np.linalg.norm(away, axis=1))


def tool_errors(curves: list[tuple[int, ControllerRun, Array]]) -> Figure:
    """Matplotlib figure of a tool's distances from its path (mm, logarithmic) over time, s, a line for each of
    `curves`: triples of the colour's index from 0 in the palette, the run, and its distances (T,), m, at its T
    samples. Nothing is checked."""
    from adaptctl.recording.drawing import run_color, sheet, thinned

    figure = sheet(3.8)
    axes = figure.subplots()
    for i, run, values in curves:
        every = thinned(len(values), SAMPLES)
        axes.semilogy(run.rollout.time[every], 1e3 * values[every], color=run_color(i).hex, label=run.label)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("tool error [mm]")
    figure.legend(loc="outside upper left", ncols=3)
    return figure
