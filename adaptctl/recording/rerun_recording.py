"""Recording of a comparison for rerun."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from adaptctl.dynamics.joint_units import position_units
from adaptctl.recording import views
from adaptctl.recording.colors import DARK, FORCE, GOAL, LIMIT, MUTED, Color, joint_color, run_color
from adaptctl.recording.comparison import Comparison
from adaptctl.recording.contact_force import contact_forces, contact_points, touched
from adaptctl.recording.controller_run import ControllerRun
from adaptctl.recording.drawing import thinned
from adaptctl.recording.figures import shares, threshold
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
from adaptctl.recording.scene import WORLD, entity, log_arm, log_arrows, log_base, log_path, log_surroundings, log_trail
from adaptctl.recording.skeleton import Skeleton, Viewpoint, floor_height, skeleton
from adaptctl.recording.stream import (
    Curves,
    in_decades,
    levels,
    log_curves,
    log_markdown,
    of_joints,
    saved_stream,
    written,
)
from adaptctl.recording.summary import properties
from adaptctl.recording.touches import touches
from adaptctl.recording.views import TIMELINE
from adaptctl.recording.wording import error, parameter_unit, torque_units, typeset

# Controllers whose small views have no room for a legend of joints, whose colours are those of the overview
MAX_RUNS_WITH_LEGENDS = 8
# Controllers above which a legend of all of them needs more than half of the window's height
MAX_RUNS_IN_LEGEND = 12
# Characters of a short name in a legend
MAX_SHORT_NAME = 12
# Parameters shown at a glance.
MAX_OVERVIEW_PARAMETERS = 4
# Time in s over which errors are averaged where they are shown in powers of ten
AVERAGING_TIME = 0.25
# Largest number of positions of an arm.
MAX_POSES = 2000


def write_recording(path: str | Path, comparison: Comparison) -> None:
    """Write the recording of a comparison, whole or not at all."""
    words, told, comparison = summary_markdown(comparison), properties(comparison), finite_part(comparison)
    positions = np.ascontiguousarray(comparison.subject.rollout.p).tobytes()
    parts = skeleton(comparison.mechanism)
    layout, of = blueprint(comparison, parts), comparison.mechanism
    with saved_stream(path, comparison, positions, layout, of, told) as recording:
        log_markdown(recording, "summary", words)
        floor = floor_height(comparison.mechanism, parts, comparison.subject.rollout.p)
        log_scene(recording, comparison, parts, floor, run_color(0))
        log_curves(recording, _curves(comparison))
        _log_spectrum(recording, comparison)
        _log_touches(recording, comparison)
        log_markdown(recording, "basis/equations", _equations(comparison))


def log_scene(
    recording: rr.RecordingStream,
    comparison: Comparison,
    parts: Skeleton,
    floor: float,
    color: Color,
    within: str = "",
) -> None:
    """Draw the arms of a comparison: the subject solid, desired motion and baseline as ghosts."""
    mechanism, subject, baseline = comparison.mechanism, comparison.subject, comparison.baseline
    log_base(recording, mechanism, parts, floor, f"{within}base")
    log_surroundings(recording, f"{within}surroundings", comparison.surroundings)
    every = thinned(len(subject.rollout.time), MAX_POSES)
    time, desired = subject.rollout.time[every], subject.rollout.reference_p[every]
    goal = log_arm(recording, f"{within}desired", mechanism, parts, time, desired, GOAL, ghost=True)
    written(recording)  # an arm's meshes are megabytes
    log_path(recording, f"{within}path/desired", goal, GOAL)
    moving = [(subject, color)]
    moving += [(baseline, run_color(comparison.color_indices[baseline.name]))] if baseline else []
    for run, paint in moving:
        every = thinned(len(run.rollout.time), MAX_POSES)
        time, p, ghost = run.rollout.time[every], run.rollout.p[every], run is not subject
        tip = log_arm(recording, f"{within}{run.name}", mechanism, parts, time, p, paint, ghost=ghost)
        log_trail(recording, f"{within}trail/{run.name}", time, tip, paint)
        written(recording)
    if (forces := contact_forces(subject.rollout)).any():
        every = thinned(len(subject.rollout.time), MAX_POSES)
        points = contact_points(subject.rollout)[every]
        log_arrows(
            recording, f"{within}contact", subject.rollout.time[every], points, forces[every], parts.reach, FORCE
        )


def joint_errors(path: str, run: ControllerRun, names: tuple[str, ...]) -> Curves:
    """Curves of a run's tracking errors in mrad or mm."""
    return of_joints(path, run.rollout.time, 1e3 * run.rollout.error, names)


def torque_shares(path: str, comparison: Comparison) -> Iterator[Curves]:
    """Curves of the subject's torques over their limits, with all samples, so that no peak is lost."""
    rollout = comparison.subject.rollout
    names, shares = comparison.joint_names, rollout.applied / comparison.torque_limits
    yield of_joints(f"{path}/joints", rollout.time, shares, names, most=len(shares))
    yield levels(f"{path}/limit", rollout.time, np.array([-1.0, 1.0]), ("limit", "limit"), (LIMIT, LIMIT))


def _curves(comparison: Comparison) -> Iterator[Curves]:
    rollout, task_error, V = comparison.subject.rollout, comparison.task_error, comparison.subject.lyapunov
    time, applied = rollout.time, rollout.applied
    for run in comparison.runs:
        yield joint_errors(f"error/{run.name}", run, comparison.joint_names)
        label, colors = (run.label,), (run_color(comparison.color_indices[run.name]),)
        of_run = [("error_decades", run.moving_rms_error(AVERAGING_TIME))]
        of_run += [("task_error", task_error.errors[run.name])] if task_error else []
        for path, errors in of_run:
            yield Curves(f"{path}/{run.name}", run.rollout.time, in_decades(errors), label, colors, width=2.0)
    yield from torque_shares("torque_share", comparison)
    for j, (name, limit) in enumerate(zip(comparison.joint_names, comparison.torque_limits, strict=True)):
        both, color = np.column_stack([rollout.reference_p[:, j], rollout.p[:, j]]), joint_color(j)
        yield Curves(f"position/{entity(name)}", time, both, ("desired", "actual"), (GOAL, color))
        path = f"torque/{entity(name)}"
        yield Curves(f"{path}/applied", time, applied[:, j], (name,), (color,), most=len(time))
        yield levels(f"{path}/limit", time, np.array([-limit, limit]), ("limit", "limit"), (LIMIT, LIMIT))
    for run in touched(comparison):
        size = in_decades(1e-3 * np.linalg.norm(contact_forces(run.rollout), axis=1))
        label, colors = (run.label,), (run_color(comparison.color_indices[run.name]),)
        yield Curves(f"contact_force/{run.name}", run.rollout.time, size, label, colors, width=2.0)
    if V is not None:
        yield Curves(f"lyapunov/{comparison.subject.name}", time, V, ("V",), (run_color(0),), width=2.5)
    yield Curves("energy", time, rollout.energy, ("energy",), (run_color(0),))
    if rollout.estimate.shape[1]:
        yield from _estimates(comparison)


def _estimates(comparison: Comparison) -> Iterator[Curves]:
    names, rollout = comparison.model.names, comparison.subject.rollout
    most = sorted(np.argsort(-np.ptp(rollout.estimate, axis=0), kind="stable")[:MAX_OVERVIEW_PARAMETERS].tolist())
    groups = {"most_learnt": (most, [names[i] for i in most])}
    for link in estimated_links(comparison):
        own = [i for i, name in enumerate(names) if name.rpartition(".")[0] == link]
        groups[entity(link)] = own, [names[i].rpartition(".")[2] for i in own]
    for path, (indices, told) in groups.items():
        if comparison.truth_known:
            pale = [joint_color(i).faded(0.3, DARK) for i in range(len(indices))]
            true, shown = comparison.true_parameters[indices], [f"{name}, true" for name in told]
            yield levels(f"estimate/{path}/truth", rollout.time, true, shown, pale)
        yield of_joints(f"estimate/{path}/estimate", rollout.time, rollout.estimate[:, indices], told)


def _log_spectrum(recording: rr.RecordingStream, comparison: Comparison) -> None:
    """Bars of the singular values as powers of ten about the threshold: blue ones count, grey ones are round-off."""
    heights, rank = np.log10(shares(comparison.space) / threshold(comparison.space)), comparison.space.rank
    parts = (("essential", slice(0, rank), run_color(0)), ("null_space", slice(rank, len(heights)), MUTED))
    for name, part, color in parts:
        if len(heights[part]):
            bars = rr.BarChart(heights[part], abscissa=np.arange(len(heights))[part] + 0.5, color=color)
            recording.log(f"basis/spectrum/{name}", bars, static=True)


def _log_touches(recording: rr.RecordingStream, comparison: Comparison) -> None:
    """Events at which touches of the subject begin and end."""
    found = touches(comparison.subject, comparison.joint_names)
    units = dict(zip(comparison.joint_names, torque_units(comparison.mechanism), strict=True))
    begins = [(one.start, f"touched: {one.joint} feels {one.torque:.2g} {units[one.joint]}") for one in found]
    events = sorted([*begins, *((one.end, "touch ends") for one in found)])
    if events:
        time, said = zip(*events, strict=True)
        columns = rr.TextLog.columns(text=said, level=["WARN"] * len(said))
        recording.send_columns("touches", [rr.TimeColumn(TIMELINE, duration=time)], columns)


def blueprint(comparison: Comparison, parts: Skeleton) -> rrb.Blueprint:
    """Layout of a comparison's recording, in tabs."""
    end, joints = comparison.subject.duration, comparison.joint_names
    errors = _error_views(comparison)
    title = f"All controllers: RMS error of all joints, log10 [{comparison.error_unit}]"
    shares = [3, 2] if len(errors) > MAX_RUNS_IN_LEGEND else [1, 1]
    grid = rrb.Grid(*errors, grid_columns=min(len(errors), 4))
    together = rrb.Vertical(views.curves("/error_decades", title, end), grid, row_shares=shares, name="Controllers")
    position = [
        views.curves(f"/position/{entity(name)}", f"{name}: actual and desired position [{unit}]", end)
        for name, unit in zip(joints, position_units(comparison.mechanism), strict=True)
    ]
    torque = [
        views.curves(f"/torque/{entity(name)}", f"{name}: torque and limits [{unit}]", end)
        for name, unit in zip(joints, torque_units(comparison.mechanism), strict=True)
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
        rrb.Horizontal(_spectrum(), views.text("basis/equations", "Base parameters"), name="Offline analysis"),
    )


def _overview(comparison: Comparison, viewpoint: Viewpoint) -> rrb.Container:
    end, task_error, rise = comparison.subject.duration, comparison.task_error, comparison.subject.lyapunov_max_increase
    arm = views.arm(WORLD, "The arm · desired: green ghost · adaptation off: orange ghost", viewpoint)
    below = [views.text("summary", "Summary")]
    if touches(comparison.subject, comparison.joint_names):
        below.append(rrb.TextLogView(origin="/touches", name="Touches"))
    left = rrb.Vertical(arm, *below, row_shares=[11, *[9 // len(below)] * len(below)])
    title = f"{task_error.meaning}, log10 [{task_error.unit}]" if task_error else ""
    curves = [views.curves("/task_error", title, end, room=views.LONG_LEGEND)] if task_error else []
    curves += _error_views(comparison, legend=True)[: 2 - len(curves)]
    if touched(comparison):
        curves.append(views.curves("/contact_force", "Contact force, log10 [N] · arrow: force on the arm", end))
    elif rise is None:
        curves.append(views.curves("/energy", "Energy [J]", end))
    else:
        curves.append(views.curves("/lyapunov", f"Lyapunov function [J] · {lyapunov_words(rise)}", end))
    most = f"Estimates with the largest changes · {_truth(comparison)}"
    curves += [
        views.curves("/torque_share", "Torque over limit", end, (-1.1, 1.1), legend_room(comparison.joint_names)),
        views.curves("/estimate/most_learnt", most, end, room=views.LONG_LEGEND),
    ]
    right = rrb.Grid(*curves, _spectrum(), grid_columns=2)
    return rrb.Horizontal(left, right, column_shares=[5, 7], name="Overview")


def _error_views(comparison: Comparison, *, legend: bool | None = None) -> list[rrb.View]:
    first = [run for run in (comparison.subject, comparison.baseline) if run is not None]
    shown = first + [run for run in comparison.runs if run not in first]
    errors = 1e3 * np.concatenate([run.rollout.error for run in shown[:2]])
    margin = 0.06 * float(np.ptp(errors)) + 1e-6
    bounds = (float(errors.min()) - margin, float(errors.max()) + margin)
    end, room = comparison.subject.duration, legend_room(comparison.joint_names)
    shows = len(shown) <= MAX_RUNS_WITH_LEGENDS if legend is None else legend
    told = f"joint tracking errors [{comparison.error_unit}]"
    return [
        views.curves(f"/error/{run.name}", f"{run.label} · {told}", end, bounds, room, legend=shows) for run in shown
    ]


def legend_room(names: Sequence[str]) -> float:
    """Fraction of the time shown that a legend of these names needs."""
    return views.LONG_LEGEND if max(map(len, names)) > MAX_SHORT_NAME else views.SHORT_LEGEND


def estimated_links(comparison: Comparison) -> dict[str, str]:
    """Units of the estimates of each link and of each joint's friction, by its name."""
    found: dict[str, dict[str, None]] = {}
    if comparison.subject.is_estimating:
        for name in comparison.model.names:
            units = found.setdefault(name.rpartition(".")[0], {})
            units[typeset(parameter_unit(name, comparison.mechanism))] = None
    return {link: ", ".join(units) for link, units in found.items()}


def _truth(comparison: Comparison) -> str:
    return "pale: true values" if comparison.truth_known else "true values unknown"


def _spectrum() -> rrb.View:
    title = "Singular values, log10 over the threshold · grey: null space"
    return rrb.BarChartView(origin="/basis/spectrum", name=title, plot_legend=rrb.PlotLegend(visible=False))


def _equations(comparison: Comparison) -> str:
    equations = Lines([str(equation) for equation in comparison.basis.equations()]).markdown()
    return f"""# Base parameters: rank {comparison.space.rank} of {len(comparison.space.parameter_names)}

Found from energies. A star marks a parameter into which others are regrouped; parameters that are not listed
affect no torque.

{equations}
"""


def summary_markdown(comparison: Comparison) -> str:
    """Summary of a comparison in Markdown: outcome, facts and runs."""
    task_error = comparison.task_error
    heads = ["first second", "last 2 s"]
    if task_error is not None:
        heads = [f"{task_error.meaning}, last 2 s", "joints, first second", "joints, last 2 s"]
    rows = []
    for run in comparison.runs:
        first = [] if task_error is None else [error(task_error.final_rms(run), task_error.unit)]
        errors = [*first, first_error(comparison, run), final_error(comparison, run)]
        rows.append([run.label, run.prior_knowledge or "–", *errors, outcome(run)])
    runs = Table(["controller", "knows", *heads, "outcome"], rows)
    head = Report(comparison.experiment, comparison.title, outcome_words(comparison), complete=comparison.complete)
    estimates = [on_truth(comparison)] if comparison.subject.is_estimating else []
    return head.markdown(answers_table(tuple(facts(comparison))), runs, *estimates)


def finite_part(comparison: Comparison) -> Comparison:
    """Comparison with each run cut off before its first sample that is not finite."""
    counts = {run.name: _finite_samples(run) for run in comparison.runs}
    if all(counts[run.name] == len(run.rollout.time) for run in comparison.runs):
        return comparison
    task_error = comparison.task_error
    if task_error is not None:
        task_error = replace(
            task_error, errors={name: task_error.errors[name][:count] for name, count in counts.items()}
        )
    runs = tuple(_beginning(run, counts[run.name]) for run in comparison.runs)
    return replace(comparison, runs=runs, task_error=task_error)


def _finite_samples(run: ControllerRun) -> int:
    rollout = run.rollout
    arrays = (rollout.p, rollout.v, rollout.torque, rollout.applied, rollout.estimate)
    if all(np.isfinite(x).all() for x in arrays):
        return len(rollout.time)
    return max(1, int(np.logical_and.reduce([np.isfinite(x).all(axis=1) for x in arrays]).argmin()))


def _beginning(run: ControllerRun, count: int) -> ControllerRun:
    rollout = run.rollout
    arrays: dict[str, Any] = {name: x[:count] for name, x in vars(rollout).items() if isinstance(x, np.ndarray)}
    marks = {name: values[:count] for name, values in rollout.flags.items()}
    lyapunov = None if run.lyapunov is None else run.lyapunov[:count]
    return replace(run, rollout=replace(rollout, **arrays, flags=marks), lyapunov=lyapunov)
