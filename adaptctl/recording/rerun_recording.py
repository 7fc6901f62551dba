"""Recording of a comparison for rerun: the arm in motion, and all curves over the same time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from adaptctl.recording import views
from adaptctl.recording.comparison import Comparison, ControllerRun
from adaptctl.recording.drawing import DARK, GOAL, joint_color, run_color, thinned
from adaptctl.recording.judgement import (
    facts,
    final_error,
    first_error,
    lyapunov_words,
    on_truth,
    outcome,
    outcome_words,
)
from adaptctl.recording.page import Lines, Report, Table, answers_table
from adaptctl.recording.scene import WORLD, entity
from adaptctl.recording.skeleton import Skeleton, Viewpoint, floor_height, skeleton
from adaptctl.recording.stream import Style, log_levels, log_markdown, log_series, saved_stream
from adaptctl.recording.tracking import (
    CURVE_SAMPLES,
    finite_part,
    log_curve,
    log_decades,
    log_joint_errors,
    log_limits,
    log_scene,
    log_spectrum,
    log_torque_shares,
)
from adaptctl.recording.wording import error, parameter_unit, typeset

MANY = 8
"""controllers whose small views have no room for a legend of joints, whose colours are those of the overview"""
TALL = 12
"""controllers above which a legend of all of them needs more than half of the window's height"""
LONGEST = 12
"""characters of a short name in a legend"""
MOST = 4
"""Parameters shown at a glance."""
AVERAGE = 0.25
"""s over which errors are averaged where they are shown in powers of ten"""


def write_recording(path: str | Path, comparison: Comparison) -> None:
    """Write the recording of a `comparison` of runs for the rerun viewer to the file `path` (.rrd), whole or not at
    all: arms in motion, curves of errors, torques, energies and estimates over time, and tables. Motion and curves of a
    run end before its first sample that is not finite; the texts judge the whole run. Raises `FileError` where the file
    cannot be written or read back, `InputError` for parameter estimates with the basis of another mechanism, and
    `NonFiniteError`, a subclass of it, for a run whose first positions are NaN or infinite."""
    words, comparison = summary_markdown(comparison), finite_part(comparison)
    positions = np.ascontiguousarray(comparison.subject.rollout.p).tobytes()
    parts = skeleton(comparison.mechanism)
    with saved_stream(path, comparison, positions, blueprint(comparison, parts)) as recording:
        log_markdown(recording, "summary", words)
        floor = floor_height(comparison.mechanism, parts, comparison.subject.rollout.p)
        log_scene(recording, comparison, parts, floor, run_color(0))
        _log_tracking(recording, comparison)
        _log_leading(recording, comparison)
        _log_torques(recording, comparison)
        _log_energies(recording, comparison.subject)
        if comparison.subject.rollout.estimate.shape[1]:
            _log_estimates(recording, comparison)
        log_spectrum(recording, "basis/spectrum", comparison.space)
        log_markdown(recording, "basis/equations", _equations(comparison))


def _log_tracking(recording: rr.RecordingStream, comparison: Comparison) -> None:
    names, rollout = comparison.joint_names, comparison.subject.rollout
    for run in comparison.runs:
        log_joint_errors(recording, f"error/{run.name}", run, names)
        style = Style((run.label,), (run_color(comparison.color_places[run.name]),), width=2.0)
        log_decades(recording, f"error_decades/{run.name}", run, run.moving_rms_error(AVERAGE), style)
    every = thinned(len(rollout.time), CURVE_SAMPLES)
    for j, name in enumerate(names):
        both = np.stack([rollout.reference_p[every, j], rollout.p[every, j]], axis=-1)
        style = Style(("desired", "actual"), (GOAL, joint_color(j)))
        log_series(recording, f"position/{entity(name)}", rollout.time[every], both, style)


def _log_leading(recording: rr.RecordingStream, comparison: Comparison) -> None:
    if (leading := comparison.leading) is None:
        return
    for run in comparison.runs:
        style = Style((run.label,), (run_color(comparison.color_places[run.name]),), width=2.0)
        log_decades(recording, f"leading/{run.name}", run, leading.errors[run.name], style)


def _log_torques(recording: rr.RecordingStream, comparison: Comparison) -> None:
    time, applied = comparison.subject.rollout.time, comparison.subject.rollout.applied
    log_torque_shares(recording, "torque_share", comparison)
    for j, (name, limit) in enumerate(zip(comparison.joint_names, comparison.torque_limits.tolist(), strict=True)):
        path, style = f"torque/{entity(name)}", Style((name,), (joint_color(j),))
        log_series(recording, f"{path}/applied", time, applied[:, j : j + 1], style)
        log_limits(recording, f"{path}/limit", time, limit)


def _log_energies(recording: rr.RecordingStream, subject: ControllerRun) -> None:
    if subject.lyapunov is not None:
        style = Style(("V",), (run_color(0),), width=2.5)
        log_curve(recording, f"lyapunov/{subject.name}", subject, subject.lyapunov, style)
    log_curve(recording, "energy", subject, subject.rollout.energy, Style(("energy",), (run_color(0),)))


def _log_estimates(recording: rr.RecordingStream, comparison: Comparison) -> None:
    names = comparison.model.names
    estimate = comparison.subject.rollout.estimate
    most = sorted(np.argsort(-np.ptp(estimate, axis=0), kind="stable")[:MOST].tolist())
    _log_group(recording, "most_learnt", comparison, most, [names[i] for i in most])
    for link in estimated_links(comparison):
        own = [i for i, name in enumerate(names) if name.rpartition(".")[0] == link]
        _log_group(recording, entity(link), comparison, own, [names[i].rpartition(".")[2] for i in own])


def _log_group(
    recording: rr.RecordingStream, path: str, comparison: Comparison, indices: list[int], names: list[str]
) -> None:
    rollout = comparison.subject.rollout
    every = thinned(len(rollout.time), CURVE_SAMPLES)
    colors = [joint_color(i) for i in range(len(indices))]
    time, values = rollout.time[every], rollout.estimate[every][:, indices]
    pale = Style([f"{name}, true" for name in names], [c.faded(0.3, DARK) for c in colors], width=1.0)
    if comparison.truth_known:
        log_levels(recording, f"estimate/{path}/truth", time, comparison.true_parameters[indices], pale)
    log_series(recording, f"estimate/{path}/estimate", time, values, Style(names, colors))


def blueprint(comparison: Comparison, parts: Skeleton) -> rrb.Blueprint:
    """Blueprint, the layout of a comparison's rerun recording, in tabs: an overview; errors of all controllers;
    positions; torques; parameter estimates, where there are any; and the independent parameters with their equations.
    `parts` are the shapes that the arm is drawn by. Raises what `Viewpoint.of` raises for the desired positions."""
    end, joints = comparison.subject.duration, comparison.joint_names
    errors = _error_views(comparison)
    title = f"All controllers: RMS error of all joints, powers of ten of a {comparison.error_unit}"
    shares = [3, 2] if len(errors) > TALL else [1, 1]
    grid = rrb.Grid(*errors, grid_columns=min(len(errors), 4))
    together = rrb.Vertical(views.curves("/error_decades", title, end), grid, row_shares=shares, name="Controllers")
    position = [
        views.curves(f"/position/{entity(name)}", f"{name}: actual and desired position [{unit}]", end)
        for name, unit in zip(joints, comparison.position_units, strict=True)
    ]
    torque = [
        views.curves(f"/torque/{entity(name)}", f"{name}: torque and limits [{unit}]", end)
        for name, unit in zip(joints, comparison.torque_units, strict=True)
    ]
    found = [
        views.curves(f"/estimate/{entity(link)}", f"{link}: estimates · {_truth(comparison)} [{units}]", end)
        for link, units in estimated_links(comparison).items()
    ]
    grids = {"Tracking": position, "Torque": torque} | ({"Parameters": found} if found else {})
    return views.tabs(
        _overview(comparison, Viewpoint.of(comparison.mechanism, parts, comparison.subject.rollout.reference_p)),
        together,
        *(rrb.Grid(*each, grid_columns=3 if len(each) > 2 else 1, name=name) for name, each in grids.items()),
        rrb.Horizontal(_spectrum(), views.text("basis/equations", "Independent parameters"), name="Offline stage"),
    )


def _overview(comparison: Comparison, viewpoint: Viewpoint) -> rrb.Container:
    end, leading, rise = comparison.subject.duration, comparison.leading, comparison.subject.lyapunov_max_increase
    arm = views.arm(WORLD, "The arm · desired: green ghost · adaptation off: orange ghost", viewpoint)
    left = rrb.Vertical(arm, views.text("summary", "Summary"), row_shares=[11, 9])
    title = f"{leading.meaning}, powers of ten of a {leading.unit}" if leading else ""
    curves = [views.curves("/leading", title, end, room=views.LONG)] if leading else []
    curves += _error_views(comparison, legend=True)[: 2 - len(curves)]
    if rise is None:
        curves.append(views.curves("/energy", "Energy [J]", end))
    else:
        curves.append(views.curves("/lyapunov", f"Lyapunov function [J] · {lyapunov_words(rise)}", end))
    most = f"Estimates that moved most · {_truth(comparison)}"
    curves += [
        views.curves("/torque_share", "Torque / limit", end, (-1.1, 1.1), legend_room(comparison.joint_names)),
        views.curves("/estimate/most_learnt", most, end, room=views.LONG),
    ]
    right = rrb.Grid(*curves, _spectrum(), grid_columns=2)
    return rrb.Horizontal(left, right, column_shares=[5, 7], name="Overview")


def _error_views(comparison: Comparison, *, legend: bool | None = None) -> list[rrb.View]:
    """Errors of the joints, a view a run: the subject, adaptation off, then the rest, all in one range."""
    first = [run for run in (comparison.subject, comparison.baseline) if run is not None]
    shown = first + [run for run in comparison.runs if run not in first]
    errors = 1e3 * np.concatenate([run.rollout.error for run in shown[:2]])
    margin = 0.06 * float(np.ptp(errors)) + 1e-6
    bounds = (float(errors.min()) - margin, float(errors.max()) + margin)
    end, room = comparison.subject.duration, legend_room(comparison.joint_names)
    shows = len(shown) <= MANY if legend is None else legend
    told = f"joints' tracking errors [{comparison.error_unit}]"
    return [
        views.curves(f"/error/{run.name}", f"{run.label} · {told}", end, bounds, room, legend=shows) for run in shown
    ]


def legend_room(names: Sequence[str]) -> float:
    """Room, a fraction of the time shown, for a legend of the `names`. Nothing is raised."""
    return views.LONG if max(map(len, names), default=0) > LONGEST else views.SHORT


def estimated_links(comparison: Comparison) -> dict[str, str]:
    """Units of the fundamental parameters of each link, and of each joint's friction, as one text such as "kg·m,
    kg·m²", by its name; empty where the first run has no estimates. Raises `InputError` for the basis of another
    mechanism."""
    found: dict[str, dict[str, None]] = {}
    if comparison.subject.rollout.estimate.shape[1]:
        for name in comparison.model.names:
            units = found.setdefault(name.rpartition(".")[0], {})
            units[typeset(parameter_unit(name, comparison.mechanism))] = None
    return {link: ", ".join(units) for link, units in found.items()}


def _truth(comparison: Comparison) -> str:
    return "level lines: true values" if comparison.truth_known else "true values unknown"


def _spectrum() -> rrb.View:
    return views.bars("/basis/spectrum", "Energy spectrum, powers of ten above the threshold · grey: null space")


def _equations(comparison: Comparison) -> str:
    """Regrouping equations of the fundamental parameters in Markdown."""
    equations = Lines([str(equation) for equation in comparison.basis.equations()]).markdown()
    return f"""# Independent parameters: rank {comparison.space.rank} of {len(comparison.space.parameter_names)}

Found from energies alone. A star marks a parameter into which others are regrouped; what is not named here
changes no torque by itself.

{equations}
"""


def summary_markdown(comparison: Comparison) -> str:
    """Summary of a `comparison` of runs as Markdown text, for its recording: its outcome in words, a table of facts,
    and a table with a row for each run, with its tracking errors and how it ended. Raises `ValueError` for a first run
    of another number of joints than there are torque limits."""
    leading = comparison.leading
    heads = ["first second", "last 2 s"]
    if leading is not None:
        heads = [f"{leading.meaning}, last 2 s", "joints, first second", "joints, last 2 s"]
    rows = []
    for run in comparison.runs:
        first = [] if leading is None else [error(leading.final_rms(run), leading.unit)]
        errors = [*first, first_error(comparison, run), final_error(comparison, run)]
        rows.append([run.label, run.knows or "–", *errors, outcome(run)])
    runs = Table(["controller", "knows", *heads, "outcome"], rows)
    head = Report(comparison.experiment, comparison.title, outcome_words(comparison), complete=comparison.complete)
    return head.markdown(answers_table(tuple(facts(comparison))), runs, on_truth(comparison))
