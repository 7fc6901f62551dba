"""Adaptation and control laws on one roughly known arm."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import ConsistentAdaptation, Controller, ErrorFeedback, Natural, margins, typical_inertia
from adaptctl.control.adaptation.natural import pseudos
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit, position_unit
from adaptctl.errors import GainError
from adaptctl.experiments.contest import ADAPTATION_OFF, Contender, Outcome, Told
from adaptctl.experiments.disturbed_arm import LABELS, REST, SAMPLES, STRIBECK_SPEED, WINDOW, DisturbedArm
from adaptctl.experiments.laws_controllers import controller, friction_columns
from adaptctl.experiments.over_time import over_time
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import ControllerRun, Finding, wording
from adaptctl.recording.colors import TRUTH, run_color
from adaptctl.recording.drawing import Drawing, sheet
from adaptctl.recording.wording import number, parameter_unit, typeset
from adaptctl.simulation import Plant, simulate_many

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WEIGHING_AMPLITUDE, WEIGHING_AMPLITUDE_LOOPS = 0.25, 0.1
"""rad at 0.2 Hz, of the weighing motion of an arm at rest, without and with loops"""
BANDWIDTHS = 0.5 * 2.0 ** (np.arange(45) / 4.0)
"""1/s that are tried"""
MAX_VELOCITY_ERROR, MAX_SATURATED_SHARE = 0.25, 0.01
"""RMS velocity error, rad/s (m/s), and saturated share of the last third, above which a bandwidth is unstable"""
RECOVERY_RATIO = 2.0
"""error ratio below which a law has recovered"""
COLUMNS = 3
"""panels per row"""


@dataclass(frozen=True, kw_only=True)
class Laws(DisturbedArm):
    """Experiment that compares adaptation and control laws."""

    name: ClassVar[str] = "laws"
    title: ClassVar[str] = "{robot}: comparison of adaptation and control laws"

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Controllers to compare, the last without adaptation."""
        model, prior_knowledge = ReducedModel(mechanism, basis), f"links within {100 * self.parameter_error:.0f} %"
        names = (*self.laws, ADAPTATION_OFF)
        return [
            Contender(name, LABELS[name], prior_knowledge, partial(controller, self, name, model)) for name in names
        ]

    def told(self, outcome: Outcome, basis: FundamentalBasis) -> Told:
        """Parameter errors and internal states of all laws."""
        asked = {
            _recovered: self.recovers,
            _drifted: self.motion == REST,
            _saturated: self.is_weak,
            _rubbed: bool(self.stribeck),
            _carried: self.has_springs,
            _learned: True,
        }
        parts = [part(self, outcome, basis) for part, is_asked in asked.items() if is_asked]
        answer = " ".join(part.answer for part in parts if part.answer)
        findings = [finding for part in parts for finding in part.findings]
        return Told(findings, answer or None, [drawing for part in parts for drawing in part.drawings])


def each(
    runs: Iterable[ControllerRun], name: str, unit: str, meaning: str, value: Callable[[ControllerRun], float | None]
) -> list[Finding]:
    """Findings on each run for which `value` gives one."""
    found = ((run, value(run)) for run in runs)
    return [Finding(f"{name}.{run.name}", x, unit, f"{run.label}: {meaning}") for run, x in found if x is not None]


def _span(ends: list[tuple[float, str]], unit: str = "") -> str:
    """Least and greatest number, with labels."""
    words = [" ".join(filter(None, (number(value), unit, f"({label})"))) for value, label in sorted(ends)]
    return " to ".join(dict.fromkeys((*words[:1], *words[-1:])))


@dataclass(frozen=True, eq=False)
class ParameterErrors:
    """Relative errors of estimates, weighted by torques."""

    model: ReducedModel
    weights: Array

    @classmethod
    def along(cls, of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> ParameterErrors:
        """Measure along the experiment's motion, or an exciting one where the arm rests."""
        mechanism, rests = outcome.mechanism, of.motion == REST
        telling = WEIGHING_AMPLITUDE if mechanism.description.loops is None else WEIGHING_AMPLITUDE_LOOPS
        times = np.linspace(0.0, 20.0 if rests else of.duration, SAMPLES)
        points, model = of.reference(mechanism, telling if rests else None)(times), ReducedModel(mechanism, basis)
        rows = model.torque_regressor(points.p, points.v, points.a)
        return cls(model, np.sqrt(np.mean(rows**2, axis=(0, 1))))

    def of(self, run: ControllerRun) -> Array | None:
        """Errors (T,), or None without estimates."""
        estimate = run.rollout.estimate
        known = estimate.shape[1] in self.model.regrouping.shape
        return self.apart(estimate, self.model.fundamental_parameters) if known else None

    def apart(self, one: Array, other: Array) -> Array:
        """Distances of estimates (..., k) or (..., P)."""
        K, true = self.model.regrouping, self.model.fundamental_parameters
        one, other = (x @ K.T if x.shape[-1] == K.shape[1] else x for x in (one, other))
        weighed = np.linalg.norm((one - other) * self.weights, axis=-1)
        return np.asarray(weighed / np.linalg.norm(true * self.weights))


def _learned(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    errors = ParameterErrors.along(of, outcome, basis)
    curves = {run.name: over for run in outcome.runs if (over := errors.of(run)) is not None}
    findings, model = list[Finding](), ReducedModel(outcome.mechanism, basis)
    for run in outcome.runs:
        if (over := curves.get(run.name)) is not None:
            meaning = f"final parameter error; initially {over[0]:.3g}"
            findings.append(Finding(f"parameter_error.{run.name}", float(over[-1]), "1", f"{run.label}: {meaning}"))
        findings += memory_findings(controller(of, run.name, model), run, outcome.mechanism)
    ends = [(float(over[-1]), LABELS[name]) for name, over in curves.items() if name != ADAPTATION_OFF]
    first = number(float(curves[ADAPTATION_OFF][0]) if ADAPTATION_OFF in curves else None, 2)
    said = [f"After {of.duration:g} s, the relative parameter error is {_span(ends)}; initially {first}."]
    said = said if ends else []
    said += [
        f"{f.meaning.split(':')[0]} stored no samples: the excitation never exceeded the threshold; reduce it."
        for f in findings
        if f.name.startswith("remembered.") and f.value == 0.0
    ]
    last = {name: f"  {number(float(over[-1]), 2)}" for name, over in curves.items()}
    runs = [replace(run, label=run.label + last.get(run.name, "")) for run in outcome.runs]
    caption = (
        "Parameter errors, weighted by the torque of each parameter along the motion, relative to the torque of all "
        "parameters; one line per adaptive law, with its final value."
    )
    drawing = Drawing("parameter-error", caption, partial(over_time, runs, curves, "parameter error"), plain=True)
    return Told(findings, " ".join(said) or None, (drawing,) if curves else ())


def _threshold(adapting: object) -> float | None:
    """Excitation threshold, 1/s, of a law with memory."""
    names = ("excitation_threshold", "novelty_threshold")
    return next((getattr(adapting, name) for name in names if hasattr(adapting, name)), None)


def memory_findings(law: Controller[Any], run: ControllerRun, mechanism: Mechanism) -> Iterator[Finding]:
    """Findings on the internal state of an adaptation law."""
    adapting, learning = getattr(getattr(law, "inner", law), "adaptation_law", None), run.rollout.logged_state
    if isinstance(adapting, Natural | ConsistentAdaptation):
        bodies = len(mechanism.description.bodies)
        kept = run.rollout.estimate if isinstance(adapting, Natural) else learning
        value = float(np.linalg.eigvalsh(pseudos(kept[:, : 10 * bodies].reshape(-1, bodies, 10)))[..., 0].min())
        meaning = "smallest eigenvalue of the pseudo-inertias of all links, over the samples of the run"
        yield from each([run], "smallest_eigenvalue", "SI", meaning, lambda _: value)
    elif learning.size and (threshold := _threshold(adapting)) is not None:
        share = float(np.mean(learning > 0.0))
        meaning = f"fraction of periods with excitation above the threshold of {threshold:g} 1/s"
        yield from each([run], "remembered", "1", meaning + ": no samples were stored" * (not share), lambda _: share)


class Recovery(NamedTuple):
    """Recovery from an event."""

    run: ControllerRun
    event: str
    earlier: float
    time: float | None
    left: float | None

    @classmethod
    def of(cls, run: ControllerRun, event: str, earlier: float, begin: float, end: float) -> Recovery:
        """Recovery from `begin` until `end`, s."""
        end = min(end, run.duration)
        last = run.rms_error(max(begin, end - WINDOW), end)
        coming = run.moving_rms_error(WINDOW)[round(WINDOW / run.rollout.sample_time) - 1 :]
        times = run.rollout.time[: len(coming)]
        back = np.flatnonzero((times >= begin) & (times <= end - WINDOW) & (coming < RECOVERY_RATIO * earlier))
        returned = float(times[back[0]]) - begin if back.size else None
        return cls(run, event, earlier, returned, None if last is None else last / earlier)

    @property
    def findings(self) -> list[Finding]:
        """Recovery time, s, or the final error ratio."""
        name, after = f"after_{self.event.replace(' ', '_')}", f"after the {self.event}"
        if self.time is not None:
            meaning = f"time {after} until the error is below twice the earlier"
            return each([self.run], f"return_{name}", "s", meaning, lambda _: self.time)
        meaning = f"no recovery {after}; final error divided by the earlier one"
        return each([self.run], f"not_back_{name}", "1", meaning, lambda _: self.left)


def _recovered(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    found = list(_recoveries(of, outcome))
    findings, unit = [finding for one in found for finding in one.findings], error_unit(outcome.mechanism)

    def earlier(run: ControllerRun) -> float | None:
        error = run.rms_error(of.payload_start - WINDOW, of.payload_start)
        return None if error is None else 1e3 * error

    meaning = f"RMS error in the {WINDOW:g} s before the pickup"
    findings += each(outcome.runs, "earlier_error", unit, meaning, earlier)
    sentences = []
    adapting = [one for one in found if one.run.rollout.estimate.shape[1] and one.run.name != ADAPTATION_OFF]
    for event in dict.fromkeys(one.event for one in adapting):
        here = [one for one in adapting if one.event == event]
        back = [(one.time, one.run.label) for one in here if one.time is not None]
        lost = sum(one.time is None and one.left is not None for one in here)
        said = [f"the errors are below twice their earlier values within {_span(back, 's')}"] if back else []
        said += [f"{lost} of {len(here)} laws {'does' if lost == 1 else 'do'} not recover"] if lost else []
        sentences.append(f"After the {event}, {', and '.join(said) or 'no run lasted so long'}.")
    return Told(findings, " ".join(sentences) or None)


def _recoveries(of: DisturbedArm, outcome: Outcome) -> Iterator[Recovery]:
    """Recoveries from the first and last pickups and drops."""
    late = (of.payload_cycles - 1) * of.turn
    events = [
        ("pickup", of.payload_start, of.payload_stop),
        ("drop", of.payload_stop, of.turn + of.payload_start if late else of.turn),
    ]
    if late:
        events += [
            ("last pickup", of.payload_start + late, of.payload_stop + late),
            ("last drop", of.payload_stop + late, of.turn + late),
        ]
    for run in outcome.runs:
        earlier = run.rms_error(of.payload_start - WINDOW, of.payload_start)
        for event, begin, end in events:
            if earlier and run.duration > begin:
                yield Recovery.of(run, event, earlier, begin, end)


def _drifted(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    errors, mechanism = ParameterErrors.along(of, outcome, basis), outcome.mechanism

    def drift(run: ControllerRun) -> float:
        """Drift, 1/min, from the third quarter to the last."""
        third, fourth = (part.mean(axis=0) for part in np.array_split(run.rollout.estimate, 4)[2:])
        return float(errors.apart(third, fourth)) / (0.25 * run.duration / 60.0)

    moved = {run: drift(run) for run in outcome.runs if errors.of(run) is not None}
    findings = each(moved, "drift", "1/min", "drift of the estimate per minute in the second half", moved.get)
    unit = position_unit(mechanism)
    findings += each(outcome.runs, "true_rms_error", unit, "of all joints", lambda run: run.rms_error())
    gains, period = of.gains(mechanism), of.control_period
    rates = zip(gains.bandwidth, gains.damping / typical_inertia(mechanism), strict=True)
    least = min(margins(ErrorFeedback(a * b, a + b, period).loop()).delay for a, b in set(rates))
    late = (
        (of.delay + 0.5) * period
        + of.drive_time_constant
        + (1.0 / (2.0 * np.pi * of.velocity_cutoff) if of.velocity_cutoff else 0.0)
    )
    findings += [
        Finding("delay_margin", least, "s", "delay margin of the tracking loop, at typical inertia"),
        Finding("delay", float(late), "s", "total delay of computation, drives and velocity filter, to first order"),
    ]
    ends = [(value, run.label) for run, value in moved.items() if run.name != ADAPTATION_OFF]
    answer = f"In the second half, the relative drift of the estimates is {_span(ends)} per minute."
    return Told(findings, answer if ends else None)


def _saturated(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    runs = outcome.run
    findings = each(outcome.runs, "saturated", "1", "fraction of periods with a limited torque", held_back)
    largest = {run.name: float(np.abs(run.rollout.estimate).max(initial=0.0)) for run in outcome.runs}
    findings += each(outcome.runs, "largest_estimate", "SI", "of any parameter", lambda run: largest[run.name])
    if of.payload:
        unit, meaning = position_unit(outcome.mechanism), "RMS error of all joints after the release"
        findings += each(
            outcome.runs, "rms_error_after", unit, meaning, lambda run: run.rms_error(start=of.payload_stop)
        )
    if not {"gradient", "never-frozen"} <= set(runs):
        return Told(findings)
    frozen, never = (runs[name].rms_error() for name in ("gradient", "never-frozen"))
    if frozen is not None and never:
        meaning = "RMS error of the whole run with freezing, divided by that without"
        findings.append(Finding("freeze_over_none", frozen / never, "1", meaning))
    words = partial(wording.error, unit=error_unit(outcome.mechanism))
    start = f"With adaptation frozen during saturation, the RMS error of the run is {words(frozen)}"
    return Told(findings, f"{start}, without freezing {words(never)}.")


def held_back(run: ControllerRun) -> float:
    """Share of samples with limited torque."""
    marks = [run.rollout.flags[name] for name in ("torque_limited", "rate_limited") if name in run.rollout.flags]
    return float(np.mean(np.max([run.rollout.clipped, *marks], axis=0)))


def _rubbed(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    mechanism, model = outcome.mechanism, ReducedModel(outcome.mechanism, basis)
    names = ("gradient", "no-friction-columns", "computed-torque-true")
    last = [run.final_rms_error if (run := outcome.run.get(name)) else None for name in names]
    errors = [wording.error(one, error_unit(mechanism)) for one in last]
    answer = (
        f"With friction parameters, the final tracking error is {errors[0]}, without them {errors[1]}; both "
        f"controllers adapt. Computed torque with the exact model except Stribeck friction has {errors[2]}."
    )
    findings = []
    if last[0] and last[1]:
        meaning = "RMS error of the last two seconds with friction parameters, divided by that without"
        findings.append(Finding("columns_over_none", last[0] / last[1], "1", meaning))
    learner = next((run for run in outcome.runs if run.rollout.estimate.shape[1] == len(model.names)), None)
    if learner is None:
        return Told(findings, answer)
    learned = dict(zip(model.names, learner.rollout.estimate[-1].tolist(), strict=True))
    for k, _ in friction_columns(model):
        name, true = model.names[k], model.fundamental_parameters[k]
        meaning = f"{name}, final estimate of {learner.label}; true value {true:.4g}"
        findings.append(Finding(f"learned.{name}", learned[name], parameter_unit(name, mechanism), meaning))
    caption = (
        "Friction against velocity: true and estimated, in the velocity range of the motion. The two-parameter model "
        "is fitted in this range, and may be inaccurate elsewhere."
    )
    draw = partial(friction_curves, mechanism, learned, learner.rollout.v, of.stribeck)
    return Told(findings, answer, (Drawing("friction", caption, draw, plain=True),))


def friction_curves(mechanism: Mechanism, learned: Mapping[str, float], v: Array, stribeck: float) -> Figure:
    """Figure of true and learned friction."""
    joints = mechanism.primary_joints
    rows = -(-len(joints) // COLUMNS)
    figure = sheet(2.0 * rows + 0.4)
    panels = figure.subplots(rows, min(COLUMNS, len(joints)), squeeze=False).ravel()
    for axes, joint, moved in zip(panels, joints, np.abs(v).T, strict=False):
        speeds = np.linspace(0.0, moved.max(), 200)
        viscous, coulomb = joint.drive.viscous or 0.0, joint.drive.coulomb or 0.0
        true = viscous * speeds + coulomb * (1.0 + stribeck / (1.0 + (speeds / STRIBECK_SPEED) ** 2))
        found = [learned.get(f"{joint.name}.{kind}", 0.0) for kind in ("viscous", "coulomb")]
        axes.plot(speeds, true, color=TRUTH.hex, label="true, with Stribeck effect")
        axes.plot(speeds, found[0] * speeds + found[1], color=run_color(0).hex, label="estimate: viscous, Coulomb")
        axes.set_ylim(bottom=0.0)
        axes.set_title(f"{joint.name} [{typeset(joint.kind.effort_unit)}]")
    units = " or ".join(sorted({f"{joint.kind.position_unit}/s" for joint in joints}, reverse=True))
    figure.supxlabel(f"velocity [{units}]", size=9)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def _carried(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    mechanism, names, findings = outcome.mechanism, (*of.laws, ADAPTATION_OFF), list[Finding]()
    reference, model = of.reference(mechanism), ReducedModel(mechanism, basis)
    springs = {f"{stiffness:g}": stiffness for stiffness in sorted(of.joint_stiffness)} | {"rigid": 0.0}
    largest: dict[str, list[float]] = {name: [] for name in names}
    for key, stiffness in springs.items():
        plant = of.plant_env(mechanism, reference, stiffness).unwrapped.plant
        where = f"a joint stiffness of {key} N·m/rad" if stiffness else "the rigid arm"
        for name in names:
            largest[name].append(_largest(of, plant, model, name))
            meaning = f"{LABELS[name]}: largest stable bandwidth for {where}, among the tried ones, 0.5 to 1024"
            findings.append(Finding(f"stable_bandwidth.{name}.{key}", largest[name][-1], "1/s", meaning))
    soft, stiff, rigid = (number(largest[of.laws[0]][place]) for place in (0, -2, -1))
    answer = (
        f"{outcome.runs[0].label} is stable up to {rigid} 1/s for the rigid arm, {stiff} 1/s with a joint stiffness of "
        f"{max(of.joint_stiffness):,.6g} N·m/rad, and {soft} 1/s with {min(of.joint_stiffness):,.6g} N·m/rad."
    )
    return Told(findings, answer)


def _largest(of: DisturbedArm, plant: Plant, model: ReducedModel, name: str) -> float:
    """Largest stable bandwidth, 1/s, of those tried, by bisection."""
    low, high = -1, len(BANDWIDTHS)
    while high - low > 1:
        middle = (low + high) // 2
        other = replace(of, bandwidth=float(BANDWIDTHS[middle]))
        low, high = (middle, high) if _is_stable(other, plant, model, name) else (low, middle)
    return float(BANDWIDTHS[low]) if low >= 0 else 0.0


def _is_stable(of: DisturbedArm, plant: Plant, model: ReducedModel, name: str) -> bool:
    """True for small velocity errors and unsaturated motors in the last third."""
    try:
        law = controller(of, name, model)
    except GainError:
        return False
    run = simulate_many(plant, law, of.reference(model.mechanism), duration=of.trial_duration, seed=of.seed)
    last = slice(2 * len(run.time) // 3, None)
    apart, torque = run.v[last] - run.reference_v[last], np.abs(run.torque[last])
    if not np.isfinite(apart).all():
        return False
    beyond = (torque >= np.asarray(plant.torque_limits)).any(axis=-1)
    return float(np.sqrt(np.mean(apart**2))) < MAX_VELOCITY_ERROR and float(beyond.mean()) < MAX_SATURATED_SHARE
