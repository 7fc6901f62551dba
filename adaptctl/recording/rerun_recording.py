"""Recording of a comparison for rerun: the arm in motion, and all curves over the same time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr

from adaptctl.recording.blueprint import ScreenContents, blueprint
from adaptctl.recording.comparison import Comparison, ControllerRun
from adaptctl.recording.finite_part import finite_part
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
from adaptctl.recording.palette import DARK, GOAL, joint_color, run_color
from adaptctl.recording.scene import entity
from adaptctl.recording.series import Style, log_levels, log_series, thinned
from adaptctl.recording.skeleton import skeleton
from adaptctl.recording.spectrum import log_spectrum
from adaptctl.recording.stream import log_markdown, saved_stream
from adaptctl.recording.trace import parameter_unit
from adaptctl.recording.tracking import (
    CURVE_SAMPLES,
    log_curve,
    log_decades,
    log_joint_errors,
    log_limits,
    log_scene,
    log_torque_shares,
)
from adaptctl.recording.units import typeset
from adaptctl.recording.viewpoint import Viewpoint, floor_height
from adaptctl.recording.wording import error

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
    with saved_stream(path, comparison, positions, blueprint(_contents(comparison))) as recording:
        log_markdown(recording, "summary", words)
        parts = skeleton(comparison.mechanism)
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
    pale = Style([f"{name}, true" for name in names], [c.faded(0.3, DARK) for c in colors], width=1.0)
    if comparison.truth_known:
        log_levels(recording, f"estimate/{path}/truth", time, comparison.true_parameters[indices], pale)
    log_series(recording, f"estimate/{path}/estimate", time, values, Style(names, colors))


def _links(comparison: Comparison) -> list[str]:
    """Links that own fundamental parameters, in order."""
    return list(dict.fromkeys(name.rpartition(".")[0] for name in comparison.model.names))


def _units(comparison: Comparison, link: str) -> str:
    """Units of a link's or joint's parameters."""
    own = (name for name in comparison.model.names if name.rpartition(".")[0] == link)
    return ", ".join(dict.fromkeys(typeset(parameter_unit(name, comparison.mechanism)) for name in own))


def _contents(comparison: Comparison) -> ScreenContents:
    parts = skeleton(comparison.mechanism)
    shown, leading, rise = _shown(comparison), comparison.leading, comparison.subject.lyapunov_max_increase
    errors = np.concatenate([run.rollout.error for run in shown[:2]])
    margin = 0.06 * float(np.ptp(errors)) + 1e-9
    links = _links(comparison) if comparison.subject.rollout.estimate.shape[1] else []
    return ScreenContents(
        viewpoint=Viewpoint.of(comparison.mechanism, parts, comparison.subject.rollout.reference_p),
        error_unit=comparison.error_unit,
        error_range=(1e3 * (float(errors.min()) - margin), 1e3 * (float(errors.max()) + margin)),
        links=tuple(map(entity, links)),
        link_units=tuple(_units(comparison, link) for link in links),
        joints=tuple(entity(name) for name in comparison.joint_names),
        position_units=comparison.position_units,
        torque_units=comparison.torque_units,
        runs=tuple(run.name for run in shown),
        labels=tuple(run.label for run in shown),
        lyapunov=None if rise is None else lyapunov_words(rise),
        leading=f"{leading.meaning}, powers of ten of a {leading.unit}" if leading else None,
        end=comparison.subject.duration,
        truth_known=comparison.truth_known,
    )


def _shown(comparison: Comparison) -> list[ControllerRun]:
    """Runs whose errors get a view each: the subject, adaptation off, then the rest."""
    first = [run for run in (comparison.subject, comparison.baseline) if run is not None]
    return first + [run for run in comparison.runs if run not in first]


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
