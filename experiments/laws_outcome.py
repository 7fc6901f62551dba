"""Findings, sentences and figures on runs of adaptation laws, by what disturbed them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from adaptctl.control import ErrorFeedback, margins, typical_inertia
from adaptctl.dynamics.joint_units import error_unit, position_unit
from adaptctl.errors import GainError
from adaptctl.experiments.contest import ADAPTATION_OFF, Outcome, Told
from adaptctl.experiments.disturbed_arm import LABELS, REST, SAMPLES, DisturbedArm
from adaptctl.experiments.laws_controllers import controller, friction_columns
from adaptctl.experiments.laws_figures import (
    bandwidths_over_stiffness,
    friction_curves,
    parameter_errors,
    recovery_times,
)
from adaptctl.experiments.laws_measures import (
    WINDOW,
    ParameterErrors,
    Recovery,
    drift,
    float_tick,
    forgotten_notes,
    held_back,
    memory_findings,
)
from adaptctl.identifiability import FundamentalBasis, ReducedModel
from adaptctl.recording import Finding, wording
from adaptctl.recording.comparison import color_places
from adaptctl.recording.drawing import Drawing
from adaptctl.recording.wording import parameter_unit
from adaptctl.simulation import Plant, simulate_many

TELLING, TELLING_LOOPS = 0.25, 0.1
"""rad at 0.2 Hz: of the motion along which parameters are weighed where the arm rests; loops leave less room"""
BANDWIDTHS = 0.5 * 2.0 ** (np.arange(45) / 4.0)
"""1/s that are tried, from 0.5 to 1024"""
SHAKING, SATURATED = 0.25, 0.01
"""rad/s (m/s) of velocity errors (RMS) and share of periods with a motor at its limit, in the last third of a trial,
above which a bandwidth is not stable"""
END = 2.0
"""s: the end of a run, over which its last error is averaged"""


def told(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    """All that is said of the `outcome` of an experiment, by its disturbances."""
    parts = [
        part(of, outcome, basis)
        for part, asked in (
            (_recovered, of.recovers),
            (_drifted, of.motion == REST),
            (_saturated, of.is_weak),
            (_rubbed, bool(of.stribeck)),
            (_carried, of.has_springs),
            (_learned, True),
        )
        if asked
    ]
    findings = [finding for part in parts for finding in part.findings]
    answers = [part.answer for part in parts if part.answer]
    drawings = [drawing for part in parts for drawing in part.drawings]
    return Told(findings, " ".join((*answers, *forgotten_notes(findings))) or None, drawings)


def _span(ends: list[tuple[float, str]], unit: str = "") -> str:
    """Text of the least and the greatest of numbers, each with its run's label."""
    words = [" ".join(filter(None, (wording.number(value), unit, f"({label})"))) for value, label in sorted(ends)]
    return " to ".join(dict.fromkeys((*words[:1], *words[-1:])))


def _weighed(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> ParameterErrors:
    """Measure of parameter errors along the motion, or, where the arm rests, along one that tells of them."""
    mechanism, rests = outcome.mechanism, of.motion == REST
    telling = TELLING if mechanism.description.loops is None else TELLING_LOOPS
    times = np.linspace(0.0, 20.0 if rests else of.duration, SAMPLES)
    points = of.reference(mechanism, telling if rests else None)(times)
    return ParameterErrors.along(ReducedModel(mechanism, basis), points.p, points.v, points.a)


def _learned(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    errors = _weighed(of, outcome, basis)
    curves = {run.name: over for run in outcome.runs if (over := errors.of(run)) is not None}
    controllers = {one.name: one.controller for one in of.contenders(outcome.mechanism, basis)}
    findings = []
    for run in outcome.runs:
        if (over := curves.get(run.name)) is not None:
            meaning = f"{run.label}: parameter error at the end, of {over[0]:.3g} at the start"
            findings.append(Finding(f"parameter_error.{run.name}", float(over[-1]), "1", meaning))
        findings += memory_findings(controllers[run.name], run, outcome.mechanism)
        cost = 1e6 * float_tick(controllers[run.name], run)
        findings.append(Finding(f"tick_floats.{run.name}", cost, "us", f"{run.label}: a tick on Python floats"))
    ends = [(float(over[-1]), LABELS[name]) for name, over in curves.items() if name != ADAPTATION_OFF]
    off = wording.number(float(curves[ADAPTATION_OFF][0]) if ADAPTATION_OFF in curves else None, 2)
    start = f"In {of.duration:g} s the parameter error, at first {off} of the parameters, comes to"
    places = color_places(outcome.runs)
    drawn = [(places[run.name], run, curves[run.name]) for run in outcome.runs if run.name in curves]
    caption = (
        "Parameter errors, weighed by the torque that each parameter makes along the motion, in shares of the torque "
        "of all, one line a law that adapts, with its last value"
        f"{'; below, when a limit held a torque back' * of.is_weak}."
    )
    drawing = Drawing("parameter-error", caption, partial(parameter_errors, drawn, of.is_weak))
    return Told(findings, f"{start} {_span(ends)}." if ends else None, (drawing,) if drawn else ())


def _recovered(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    unit, found = error_unit(outcome.mechanism), list(_recoveries(of, outcome))
    findings = [finding for one in found if (finding := one.finding) is not None]
    for run in outcome.runs:
        if (earlier := run.rms_error(of.start - WINDOW, of.start)) is not None:
            meaning = f"{run.label}: RMS error in the {WINDOW:g} s before the pickup"
            findings.append(Finding(f"earlier_error.{run.name}", 1e3 * earlier, unit, meaning))
    sentences = []
    adapting = [one for one in found if one.run.rollout.estimate.shape[1] and one.run.name != ADAPTATION_OFF]
    for event in dict.fromkeys(one.event for one in adapting):
        here = [one for one in adapting if one.event == event]
        back = [(one.time, one.run.label) for one in here if one.time is not None]
        lost = sum(one.time is None and one.left is not None for one in here)
        said = [f"errors are below twice what they were before within {_span(back, 's')}"] if back else []
        said += [f"{lost} of {len(here)} laws {'does' if lost == 1 else 'do'} not come back"] if lost else []
        sentences.append(f"After the {event} {', and '.join(said) or 'no law came so far'}.")
    caption = (
        f"Time from either event until the error over {WINDOW:g} s is below twice the earlier one, which is given in "
        f"brackets, in {unit}: a law that tracked better before has more to come back to."
    )
    drawing = Drawing("recovery", caption, partial(recovery_times, found))
    return Told(findings, " ".join(sentences) or None, (drawing,) if found else ())


def _recoveries(of: DisturbedArm, outcome: Outcome) -> Iterator[Recovery]:
    """Recoveries of all laws from the first pickup and drop, and from the last ones where there are several."""
    events = [("pickup", of.start, of.stop), ("drop", of.stop, of.turn)]
    if of.times > 1:
        late = (of.times - 1) * of.turn
        events += [(f"last {event}", begin + late, end + late) for event, begin, end in events]
        events[1] = ("drop", of.stop, of.turn + of.start)
    for run in outcome.runs:
        earlier = run.rms_error(of.start - WINDOW, of.start)
        for event, begin, end in events:
            if earlier and run.duration > begin:
                yield Recovery.of(run, event, earlier, begin, end)


def _drifted(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    errors, findings, ends, mechanism = _weighed(of, outcome, basis), [], [], outcome.mechanism
    for run in outcome.runs:
        if errors.of(run) is not None:
            moved, meaning = (
                drift(errors, run),
                f"{run.label}: how far the estimate moves in a minute of the second half",
            )
            findings.append(Finding(f"drift.{run.name}", moved, "1/min", meaning))
            ends += [(moved, run.label)] if run.name != ADAPTATION_OFF else []
        if (error := run.rms_error()) is not None:
            unit, meaning = position_unit(mechanism), f"{run.label}: of all joints"
            findings.append(Finding(f"true_rms_error.{run.name}", error, unit, meaning))
    gains, period = of.gains(mechanism), of.control_period
    rates = zip(gains.bandwidth, gains.damping / typical_inertia(mechanism), strict=True)
    least = min(margins(ErrorFeedback(a * b, a + b, period).loop()).delay for a, b in set(rates))
    late = (of.delay + 0.5) * period + of.lag + (1.0 / (2.0 * np.pi * of.filter) if of.filter else 0.0)
    findings += [
        Finding("delay_margin", least, "s", "what the tracking loop tolerates of delay, at typical inertia"),
        Finding("delay", float(late), "s", "of computing, drives and velocity filter together, to first order"),
    ]
    answer = f"In the second half, estimates move by {_span(ends)} of the parameters a minute."
    return Told(findings, answer if ends else None)


def _saturated(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    findings, runs = [], outcome.run
    for name, run in runs.items():
        share, moved = float(np.mean(held_back(run))), float(np.abs(run.rollout.estimate).max(initial=0.0))
        meaning = f"{run.label}: share of periods with a torque held back"
        findings.append(Finding(f"saturated.{name}", share, "1", meaning))
        findings.append(
            Finding(f"largest_estimate.{name}", moved, "SI", f"{run.label}: largest estimate of any parameter")
        )
        if of.payload and (after := run.rms_error(start=of.stop)) is not None:
            unit, meaning = position_unit(outcome.mechanism), f"{run.label}: RMS error of all joints from the drop on"
            findings.append(Finding(f"rms_error_after.{name}", after, unit, meaning))
    if not {"gradient", "never-frozen"} <= set(runs):
        return Told(findings)
    words = partial(wording.error, unit=error_unit(outcome.mechanism))
    frozen, never = (runs[name].rms_error() for name in ("gradient", "never-frozen"))
    if frozen is not None and never:
        meaning = "RMS error of the whole run, frozen over never frozen"
        findings.append(Finding("freeze_over_none", frozen / never, "1", meaning))
    start = f"With adaptation frozen while motors saturate, the RMS error of the run is {words(frozen)}"
    answer = f"{start}, never frozen {words(never)}."
    last = [runs[name] for name in ("gradient", ADAPTATION_OFF) if name in runs]
    if of.payload and len(last) == 2 and min(run.duration for run in last) >= of.stop + END:
        on, off = (words(run.final_rms_error) for run in last)
        answer += f" In the last {END:g} s, the payload long gone, it is {on}, with adaptation off {off}."
    return Told(findings, answer)


def _rubbed(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    mechanism, model = outcome.mechanism, ReducedModel(outcome.mechanism, basis)
    last = [
        run.final_rms_error if (run := outcome.run.get(name)) else None
        for name in ("gradient", "no-friction-columns", "computed-torque-true")
    ]
    errors = [wording.error(one, error_unit(mechanism)) for one in last]
    answer = (
        f"With friction among its parameters the arm ends at {errors[0]} of tracking error, without at {errors[1]}, "
        f"though both adapt. Computed torque that knows all but Stribeck's excess stays at {errors[2]}."
    )
    findings = []
    if last[0] and last[1]:
        meaning = "RMS error of the last two seconds, with the friction's columns over without"
        findings.append(Finding("columns_over_none", last[0] / last[1], "1", meaning))
    learner = next((run for run in outcome.runs if run.rollout.estimate.shape[1] == len(model.names)), None)
    if learner is None:
        return Told(findings, answer)
    learned = dict(zip(model.names, learner.rollout.estimate[-1].tolist(), strict=True))
    for k, _ in friction_columns(model):
        name, true = model.names[k], model.fundamental_parameters[k]
        meaning = f"{name}, learned at the end by {learner.label}; true {true:.4g}"
        findings.append(Finding(f"learned.{name}", learned[name], parameter_unit(name, mechanism), meaning))
    caption = (
        "Friction over speed: the true one, and what was learned of it, at the speeds at which the joint moved "
        "(shaded: how often). A line of two numbers is fitted where the arm is, and need not be right elsewhere."
    )
    draw = partial(friction_curves, mechanism, learned, learner.rollout.v, of.stribeck, of.stribeck_speed)
    return Told(findings, answer, (Drawing("friction", caption, draw),))


def _carried(of: DisturbedArm, outcome: Outcome, basis: FundamentalBasis) -> Told:
    mechanism, names, findings = outcome.mechanism, (*of.laws, ADAPTATION_OFF), []
    reference, model = of.reference(mechanism), ReducedModel(mechanism, basis)
    springs = {f"{stiffness:g}": stiffness for stiffness in sorted(of.stiffness)} | {"rigid": 0.0}
    largest: dict[tuple[str, str], float] = {}
    for key, stiffness in springs.items():
        env: Any = of.plant_env(mechanism, reference, stiffness)
        where = f"springs of {key} N·m/rad" if stiffness else "the rigid arm"
        for name in names:
            largest[name, key] = _largest(of, env.unwrapped.plant, model, name)
            meaning = f"{LABELS[name]}: largest stable bandwidth on {where}, of those tried, 0.5 to 1024"
            findings.append(Finding(f"stable_bandwidth.{name}.{key}", largest[name, key], "1/s", meaning))
    soft, stiff, rigid = (wording.number(largest[of.laws[0], list(springs)[place]]) for place in (0, -2, -1))
    answer = (
        f"{outcome.runs[0].label} is stable up to {rigid} 1/s on the rigid arm, {stiff} 1/s with springs of "
        f"{max(of.stiffness):,.6g} N·m/rad in its joints and {soft} 1/s with springs of {min(of.stiffness):,.6g}."
    )
    lines = {LABELS[name]: [largest[name, key] for key in springs] for name in names}
    caption = "Largest stable bandwidth over the stiffness of the joints, one line a law; at the right, the rigid arm."
    draw = partial(bandwidths_over_stiffness, lines, list(springs), float(BANDWIDTHS[0]) / 2.0)
    return Told(findings, answer, (Drawing("stable-bandwidth", caption, draw),))


def _largest(of: DisturbedArm, plant: Plant, model: ReducedModel, name: str) -> float:
    """Largest bandwidth, 1/s, of those that are tried with which a law is stable; found by bisection."""
    low, high = -1, len(BANDWIDTHS)
    while high - low > 1:
        middle = (low + high) // 2
        other = replace(of, bandwidth=float(BANDWIDTHS[middle]))
        low, high = (middle, high) if _is_stable(other, plant, model, name) else (low, middle)
    return float(BANDWIDTHS[low]) if low >= 0 else 0.0


def _is_stable(of: DisturbedArm, plant: Plant, model: ReducedModel, name: str) -> bool:
    """True where in the last third of a trial velocity errors are small and motors below their limits."""
    try:
        law = controller(of, name, model)
    except GainError:
        return False
    run = simulate_many(plant, law, of.reference(model.mechanism), duration=of.trial, seed=of.seed)
    last = slice(2 * len(run.time) // 3, None)
    apart, torque = run.v[last] - run.reference_v[last], np.abs(run.torque[last])
    if not np.isfinite(apart).all():
        return False
    beyond = (torque >= np.asarray(plant.torque_limits)).any(axis=-1)
    return float(np.sqrt(np.mean(apart**2))) < SHAKING and float(beyond.mean()) < SATURATED
