"""A comparison as a rerun recording: the arm in motion, and everything else over the same time."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr

from adaptctl.recording.bars import log_spectrum
from adaptctl.recording.blueprint import ScreenContents, blueprint
from adaptctl.recording.comparison import Comparison, ControllerRun
from adaptctl.recording.overview import equations_markdown, summary_markdown
from adaptctl.recording.palette import GOAL, Color, joint_color, run_color
from adaptctl.recording.scene import GOAL_LOOK, entity, ghost_look, log_arm, log_base, log_path, log_trail, solid_look
from adaptctl.recording.series import Style, log_levels, log_series, thinned
from adaptctl.recording.skeleton import ROOT_RADIUS, skeleton
from adaptctl.recording.stream import log_markdown, saved_stream
from adaptctl.recording.viewpoint import Viewpoint, floor_height

CURVE_SAMPLES, POSE_SAMPLES = 4000, 2000
"""At most as many samples are shown; the table beside the recording has them all."""
MOST = 6
"""Parameters shown at a glance."""
AVERAGE = 0.25
"""s over which errors are averaged where they are shown in powers of ten"""
SMALLEST_ERROR = 1e-9
"""rad or m: smaller ones are shown as this, for a logarithm knows no zero"""
LIMIT = Color(235, 87, 87)
DARK = Color(13, 13, 13)


def write_recording(path: str | Path, comparison: Comparison) -> None:
    """Write the recording whole or not at all. Raises FileError."""
    layout = blueprint(_layout(comparison))
    with saved_stream(path, comparison.experiment, _identifier(comparison), layout) as recording:
        _log(recording, comparison)


def _identifier(comparison: Comparison) -> str:
    """Equal runs, equal names: two recordings that are opened together must not be mixed up."""
    digest = hashlib.sha256(np.ascontiguousarray(comparison.subject.rollout.p).tobytes()).hexdigest()
    return f"{comparison.experiment}-seed{comparison.seed}-{digest[:12]}"


def _log(recording: rr.RecordingStream, comparison: Comparison) -> None:
    recording.send_recording_name(comparison.title)
    recording.send_property(
        "adaptctl",
        rr.AnyValues(experiment=comparison.experiment, seed=comparison.seed, complete=comparison.complete),
    )
    log_markdown(recording, "summary", summary_markdown(comparison))
    _log_scene(recording, comparison)
    _log_tracking(recording, comparison)
    _log_torques(recording, comparison)
    _log_lyapunov(recording, comparison)
    if comparison.subject.rollout.estimate.shape[1]:
        _log_estimates(recording, comparison)
    _log_offline(recording, comparison)


def _log_scene(recording: rr.RecordingStream, comparison: Comparison) -> None:
    mechanism, rollout = comparison.mechanism, comparison.subject.rollout
    parts = skeleton(mechanism)
    every = thinned(len(rollout.time), POSE_SAMPLES)
    time = rollout.time[every]
    log_base(recording, mechanism, floor_height(mechanism, parts, rollout.p), 1.15 * ROOT_RADIUS * parts.reach)
    goal = log_arm(recording, "desired", mechanism, parts, time, rollout.reference_p[every], GOAL_LOOK)
    log_path(recording, "desired", goal, GOAL)
    tip = log_arm(recording, "adaptive", mechanism, parts, time, rollout.p[every], solid_look(run_color(0)))
    log_trail(recording, "adaptive", time, tip, run_color(0))
    if (baseline := comparison.baseline) is not None:
        color, other = run_color(comparison.runs.index(baseline)), baseline.rollout
        every = thinned(len(other.time), POSE_SAMPLES)
        look = ghost_look(color)
        tip = log_arm(recording, baseline.name, mechanism, parts, other.time[every], other.p[every], look)
        log_trail(recording, baseline.name, other.time[every], tip, color)


def _log_tracking(recording: rr.RecordingStream, comparison: Comparison) -> None:
    names, rollout = comparison.joint_names, comparison.subject.rollout
    every = thinned(len(rollout.time), CURVE_SAMPLES)
    colors = [joint_color(j) for j in range(len(names))]
    for run in comparison.runs:
        kept = thinned(len(run.rollout.time), CURVE_SAMPLES)
        errors = 1e3 * run.rollout.error[kept]
        log_series(recording, f"error/{run.name}", run.rollout.time[kept], errors, Style(names, colors))
    for i, run in enumerate(comparison.runs):
        kept, style = thinned(len(run.rollout.time), CURVE_SAMPLES), Style((run.label,), (run_color(i),), width=2.0)
        decades_of_error = np.log10(1e3 * np.maximum(run.moving_rms_error(AVERAGE), SMALLEST_ERROR))
        log_series(recording, f"error_decades/{run.name}", run.rollout.time[kept], decades_of_error[kept, None], style)
    for j, name in enumerate(names):
        both = np.stack([rollout.reference_p[every, j], rollout.p[every, j]], axis=-1)
        style = Style(("desired", "actual"), (GOAL, joint_color(j)))
        log_series(recording, f"position/{entity(name)}", rollout.time[every], both, style)


def _log_torques(recording: rr.RecordingStream, comparison: Comparison) -> None:
    names, rollout = comparison.joint_names, comparison.subject.rollout
    limits, time, applied = comparison.torque_limits, rollout.time, rollout.applied  # no peak must be lost
    colors = [joint_color(j) for j in range(len(names))]
    log_series(recording, "torque_share/joints", time, applied / limits, Style(names, colors))
    bounds = Style(("limit", "limit"), (LIMIT, LIMIT), width=1.0)
    log_levels(recording, "torque_share/limit", time, np.array([-1.0, 1.0]), bounds)
    for j, name in enumerate(names):
        path, style = f"torque/{entity(name)}", Style((name,), (joint_color(j),))
        log_series(recording, f"{path}/applied", time, applied[:, j : j + 1], style)
        log_levels(recording, f"{path}/limit", time, np.array([-limits[j], limits[j]]), bounds)


def _log_lyapunov(recording: rr.RecordingStream, comparison: Comparison) -> None:
    for i, run in enumerate(comparison.runs):
        if run.lyapunov is not None and run is comparison.subject:
            every = thinned(len(run.lyapunov), CURVE_SAMPLES)
            style = Style(("V",), (run_color(i),), width=2.5)
            log_series(recording, f"lyapunov/{run.name}", run.rollout.time[every], run.lyapunov[every, None], style)
    rollout = comparison.subject.rollout
    every = thinned(len(rollout.time), CURVE_SAMPLES)
    style = Style(("energy",), (run_color(0),))
    log_series(recording, "energy", rollout.time[every], rollout.energy[every, None], style)


def _log_estimates(recording: rr.RecordingStream, comparison: Comparison) -> None:
    names = comparison.model.names
    estimate = comparison.subject.rollout.estimate
    most = sorted(np.argsort(-np.ptp(estimate, axis=0), kind="stable")[:MOST].tolist())
    _log_group(recording, "most_learnt", comparison, most, [names[i] for i in most])
    for link in _links(comparison):
        own = [i for i, name in enumerate(names) if name.rpartition(".")[0] == link]
        _log_group(recording, entity(link), comparison, own, [names[i].rpartition(".")[2] for i in own])


def _log_group(
    recording: rr.RecordingStream, path: str, comparison: Comparison, indices: list[int], names: list[str]
) -> None:
    rollout = comparison.subject.rollout
    every = thinned(len(rollout.time), CURVE_SAMPLES)
    colors = [joint_color(i) for i in range(len(indices))]
    time, values = rollout.time[every], rollout.estimate[every][:, indices]
    pale = Style(["true"] * len(names), [c.faded(0.55, DARK) for c in colors], width=1.0)
    log_levels(recording, f"estimate/{path}/truth", time, comparison.true_parameters[indices], pale)
    log_series(recording, f"estimate/{path}/estimate", time, values, Style(names, colors))


def _links(comparison: Comparison) -> list[str]:
    """Links that own fundamental parameters, in order."""
    return list(dict.fromkeys(name.rpartition(".")[0] for name in comparison.model.names))


def _log_offline(recording: rr.RecordingStream, comparison: Comparison) -> None:
    log_spectrum(recording, "basis/spectrum", comparison.space)
    log_markdown(recording, "basis/equations", equations_markdown(comparison))


def _layout(comparison: Comparison) -> ScreenContents:
    parts = skeleton(comparison.mechanism)
    shown = _shown(comparison)
    errors = np.concatenate([run.rollout.error for run in shown[:2]])
    margin = 0.06 * float(np.ptp(errors)) + 1e-9
    has_estimates = comparison.subject.rollout.estimate.shape[1] > 0
    return ScreenContents(
        viewpoint=Viewpoint.of(comparison.mechanism, parts, comparison.subject.rollout.reference_p),
        error_unit=comparison.error_unit,
        error_range=(1e3 * (float(errors.min()) - margin), 1e3 * (float(errors.max()) + margin)),
        links=tuple(entity(link) for link in _links(comparison)) if has_estimates else (),
        joints=tuple(entity(name) for name in comparison.joint_names),
        position_units=comparison.position_units,
        torque_units=comparison.torque_units,
        runs=tuple(run.name for run in shown),
        labels=tuple(run.label for run in shown),
        has_lyapunov=comparison.subject.lyapunov is not None,
    )


def _shown(comparison: Comparison) -> list[ControllerRun]:
    """The runs whose errors get a view each: the subject, adaptation off, then the rest."""
    first = [run for run in (comparison.subject, comparison.baseline) if run is not None]
    return first + [run for run in comparison.runs if run not in first]
