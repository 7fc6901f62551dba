"""Task-space and joint-space control on one path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from adaptctl.control import (
    Composite,
    ComputedTorque,
    Gains,
    Sinusoids,
    SlotineLi,
    Spline,
    TaskSpaceSlotineLi,
)
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.errors import InputError
from adaptctl.experiments.contest import (
    ADAPTATION_OFF,
    NO_MODEL,
    Contender,
    FromRanges,
    Outcome,
    Told,
    chosen_gains,
)
from adaptctl.experiments.experiment import setting, validate_count
from adaptctl.experiments.over_time import over_time
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import Finding, Setting, TaskError, wording
from adaptctl.recording.controller_run import FINAL_ERROR_TIME, FIRST_ERROR_TIME

if TYPE_CHECKING:
    import gymnasium

KNOT = 0.02
"""s between samples of inverse kinematics"""
REFERENCE_OVERRUN = 1.0
"""s of the reference after the end"""


class ArmWithTip(NamedTuple):
    """Arm of three degrees of freedom with its tool."""

    name: str
    label: str
    robot: str
    link: str
    tip: tuple[float, float, float]
    start: tuple[float, float, float]
    printed_rank: int


ARMS = (
    # The forearm to the flange, with the wrist held straight: d4 + d6 of the PUMA 560, along link 3's z axis.
    ArmWithTip("serial", "Three-joint PUMA", "puma560_arm3", "link3", (0.0, 0.0, 0.48935), (0.0, -1.5, 3.0), 16),
    # The forearm's end: 0.5 m past the elbow, which is 0.41 m from its frame.
    ArmWithTip("graph", "Five-bar", "semi_direct_drive", "link5", (0.91, 0.0, 0.0), (0.0, -1.5, -3.1), 26),
)
START_TIME = 2.0
"""s: length of the smooth (quintic) start"""


@dataclass(frozen=True)
class TaskSpaceTracking(FromRanges):
    """Experiment of tracking a path in task space."""

    name: ClassVar[str] = "task-space"
    title: ClassVar[str] = "{robot}: tool path in the world frame"

    robot: str = setting("puma560_arm3", "puma560_arm3, or semi_direct_drive, whose tool moves through a closed loop")
    damping_scale: float = setting(
        3.0, "damping divided by Λ and the typical inertia of the joint", symbol="K/(Λ I)", low=0.1, high=100.0
    )
    singularity: float = setting(0.1, "damping of the damped Jacobian, m", symbol="μ", low=0.0, high=10.0)
    prediction_weight: float = setting(
        100.0, "weight of the torque prediction error, normalised by the limits, N m/s", low=1e-6, high=1e9
    )
    center: tuple[float, ...] = setting((0.55, 0.0, 0.47), "centre of the tool's path, m", low=-10.0, high=10.0)
    amplitude: tuple[float, ...] = setting((0.1, 0.25, 0.15), "amplitude of the tool's path, m", low=0.0, high=10.0)
    frequency: tuple[float, ...] = setting((0.4, 0.2, 0.2), "frequency of the tool's path, Hz", low=0.0, high=5.0)
    phase: tuple[float, ...] = setting((1.5708, 0.0, 1.5708), "phase of the tool's path, rad", low=-10.0, high=10.0)
    initial_error: float = setting(0.1, "initial error of every joint, rad or m", low=-1.0, high=1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_count(self, ("center", "amplitude", "frequency", "phase"), 3, "x, y and z")

    @property
    def purpose(self) -> str:
        """Question of the experiment."""
        return (
            "The tool follows a path in the world frame, with unknown inertial parameters. A task-space law, with "
            "joint velocities from the Jacobian, is compared with a joint-space law, with inverse kinematics. Every "
            f"controller starts {self.initial_error:g} rad off in every joint."
        )

    def environment(self, mechanism: Mechanism) -> gymnasium.Env[Any, Any]:
        """Tracking environment on the path, by inverse kinematics."""
        return self.tracking(mechanism, self.reference(mechanism), initial_error=self.initial_error)

    @property
    def path(self) -> Sinusoids:
        """Path of the tool in the world, m."""
        amplitude, frequency, phase = map(np.array, (self.amplitude, self.frequency, self.phase))
        return Sinusoids(np.array(self.center), amplitude, frequency, phase, START_TIME)

    def reference(self, mechanism: Mechanism) -> Spline:
        """Joint reference, a quintic spline through points every 0.02 s."""
        times = np.arange(0.0, self.duration + REFERENCE_OVERRUN + KNOT, KNOT)
        return Spline(self.tip(mechanism).joints(self.path(times).p, np.array(self.arm.start)), times)

    def gains(self, mechanism: Mechanism) -> Gains:
        """Gains from typical inertia."""
        return Gains.from_bandwidth(mechanism, self.bandwidth, self.damping_scale)

    @property
    def arm(self) -> ArmWithTip:
        """Arm, tool, and start of inverse kinematics."""
        known = {arm.robot: arm for arm in ARMS}
        if self.robot not in known:
            raise InputError(f"robot: expected {' or '.join(known)}, whose tools are defined, got {self.robot!r}")
        return known[self.robot]

    def tip(self, mechanism: Mechanism) -> Tip:
        """Tool as a point of a link."""
        return Tip(mechanism, self.arm.link, np.array(self.arm.tip))

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Controllers to compare, the task-space law first."""
        model, gains, tool = ReducedModel(mechanism, basis), self.gains(mechanism), np.array(self.arm.tip)
        gain = self.adaptation(model)
        composite = Composite(gain, self.prediction_weight / finite_torque_limits(mechanism) ** 2)

        def task_space(law: Any, singularity: float = 0.0) -> TaskSpaceSlotineLi:
            return TaskSpaceSlotineLi(
                model,
                gains.bandwidth,
                gains.damping,
                law,
                control_period=self.control_period,
                link=self.arm.link,
                tool=tool,
                singularity=singularity,
                reference_in_joints=True,
            )

        def in_joints() -> SlotineLi:
            return SlotineLi(model, gains.bandwidth, gains.damping, gain, None, self.control_period)

        true = partial(ComputedTorque, mechanism, gains.bandwidth)
        damped = partial(task_space, gain, self.singularity)
        return [
            Contender("task-space", "Task space, gradient", NO_MODEL, partial(task_space, gain)),
            Contender(ADAPTATION_OFF, "Task space, adaptation off", NO_MODEL, partial(task_space, None)),
            Contender("task-space-composite", "Task space, composite", NO_MODEL, partial(task_space, composite)),
            Contender("task-space-damped", "Task space, damped", NO_MODEL, damped),
            Contender("joint-space", "Joint space, gradient", NO_MODEL, in_joints),
            Contender("computed-torque", "Computed torque, true model", "exact", true),
        ]

    def chosen(self, mechanism: Mechanism, env: gymnasium.Env[Any, Any]) -> Iterator[Setting]:
        """Chosen settings: gains, path, tool."""
        yield from chosen_gains(self.gains(mechanism))
        law = "x(t) = centre + fade(t) · amplitude · sin(2π · frequency · t + phase)"
        yield Setting("path", law, "of the tool, in the world frame")
        yield Setting(
            "reference", f"spline of degree 5, knots every {KNOT:g} s", "in joint space, by inverse kinematics"
        )
        yield Setting("tool", " ".join(f"{x:g}" for x in self.arm.tip), f"m, in the frame of {self.arm.link}")

    def told(self, outcome: Outcome, basis: FundamentalBasis) -> Told:
        """First and last errors of the tool."""
        from adaptctl.recording.drawing import Drawing

        tip = self.tip(outcome.mechanism)
        errors = {
            run.name: np.linalg.norm(tip.at(run.rollout.p) - self.path(run.rollout.time).p, axis=1)
            for run in outcome.runs
        }
        task_error = TaskError("Distance of the tool from its path", "mm", errors)
        caption = "Distance of the tool from its path, one line per controller (logarithmic scale)."
        millimetres = {name: 1e3 * values for name, values in errors.items()}
        drawing = Drawing(
            "tool-error", caption, partial(over_time, outcome.runs, millimetres, "tool error [mm]"), plain=True
        )
        return Told(list(_findings(outcome, task_error)), _answer(outcome, task_error), (drawing,), task_error)


def _findings(outcome: Outcome, task_error: TaskError) -> Iterator[Finding]:
    """First and last errors of the tool, in runs that are long enough."""
    for run in outcome.runs:
        start = task_error.errors[run.name][run.rollout.time < FIRST_ERROR_TIME]
        first = None if run.first_rms_error is None else float(np.sqrt(np.mean(start**2)))
        for what, length, error in (
            ("first", FIRST_ERROR_TIME, first),
            ("final", FINAL_ERROR_TIME, task_error.final_rms(run)),
        ):
            if error is not None:
                meaning = f"{run.label}: RMS tool error, {what} {length:g} s"
                yield Finding(f"{what}_tool_error.{run.name}", 1e3 * error, "mm", meaning)


def _answer(outcome: Outcome, task_error: TaskError) -> str | None:
    """Last errors of the tool in words; None where the first run is too short."""
    final = ((run.name, task_error.final_rms(run)) for run in outcome.runs)
    last = {name: 1e3 * error for name, error in final if error is not None}
    if outcome.runs[0].name not in last:
        return None
    on, off = (wording.number(last.get(name)) for name in (outcome.runs[0].name, ADAPTATION_OFF))
    least = min(last, key=lambda name: last[name])
    return (
        f"The RMS tool error in the last {FINAL_ERROR_TIME:g} s is {on} mm, and {off} mm without adaptation. The "
        f"smallest error of all controllers is {wording.number(last[least])} mm ({outcome.run[least].label})."
    )
