"""Arms side by side as a rerun recording: one scene, and the same curves of each."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from adaptctl.arrays import Array
from adaptctl.experiments.serial_versus_graph.figures import side_color
from adaptctl.experiments.serial_versus_graph.result import Side, SideBySide
from adaptctl.experiments.serial_versus_graph.wording import WHY_NOT_16, rows, verdict
from adaptctl.recording import views
from adaptctl.recording.comparison import ControllerRun
from adaptctl.recording.palette import GOAL, RUNS, Color, joint_color
from adaptctl.recording.rerun_recording import CURVE_SAMPLES, LIMIT, POSE_SAMPLES
from adaptctl.recording.scene import (
    GOAL_LOOK,
    WORLD,
    ghost_look,
    log_arm,
    log_base,
    log_path,
    log_trail,
    solid_look,
)
from adaptctl.recording.series import Style, log_levels, log_series, thinned
from adaptctl.recording.skeleton import ROOT_RADIUS, Skeleton, skeleton, with_tip
from adaptctl.recording.stream import log_markdown, saved_stream
from adaptctl.recording.viewpoint import Viewpoint, floor_height
from adaptctl.recording.wording import INCOMPLETE

APART = 1.35
"""m between the arms' bases; each has its own path, the same one"""
OFF = RUNS[1]
"""the colour of runs with adaptation off"""
SMALLEST_ERROR = 1e-7
"""m: smaller ones are shown as this, for a logarithm knows no zero"""


def write_recording(path: str | Path, result: SideBySide) -> None:
    """Write the recording whole or not at all. Raises FileError."""
    with saved_stream(path, result.experiment, _identifier(result), _blueprint(result)) as recording:
        recording.send_recording_name(result.title)
        recording.send_property(
            "adaptctl", rr.AnyValues(experiment=result.experiment, seed=result.seed, complete=result.complete)
        )
        log_markdown(recording, "summary", _markdown(result))
        floor = _floor(result)
        for i, side in enumerate(result.sides):
            _log_scene(recording, side, side_color(i), _place(i, result), floor)
            _log_curves(recording, side, side_color(i))


def _identifier(result: SideBySide) -> str:
    """Equal runs, equal names: two recordings that are opened together must not be mixed up."""
    moved = b"".join(np.ascontiguousarray(side.comparison.subject.rollout.p).tobytes() for side in result.sides)
    return f"{result.experiment}-seed{result.seed}-{hashlib.sha256(moved).hexdigest()[:12]}"


def _place(index: int, result: SideBySide) -> Array:
    """Where the index-th arm stands: from left to right, seen from the front."""
    return np.array([0.0, APART * (index - 0.5 * (len(result.sides) - 1)), 0.0])


def _parts(side: Side) -> Skeleton:
    return with_tip(skeleton(side.comparison.mechanism), side.tip_link, side.tip)


def _log_scene(recording: rr.RecordingStream, side: Side, color: Color, place: Array, floor: float) -> None:
    mechanism, parts = side.comparison.mechanism, _parts(side)
    recording.log(f"{WORLD}/{side.name}", rr.Transform3D(translation=place), static=True)
    log_base(recording, mechanism, floor, 1.15 * ROOT_RADIUS * parts.reach, f"{side.name}/base")
    subject, baseline = side.comparison.subject, side.comparison.baseline
    every = thinned(len(subject.rollout.time), POSE_SAMPLES)
    time, rollout = subject.rollout.time[every], subject.rollout
    log_arm(recording, f"{side.name}/desired", mechanism, parts, time, rollout.reference_p[every], GOAL_LOOK)
    log_path(recording, side.name, side.desired[subject.name][every] + place, GOAL)
    log_arm(recording, f"{side.name}/adaptive", mechanism, parts, time, rollout.p[every], solid_look(color))
    log_trail(recording, side.name, time, side.tips[subject.name][every] + place, color)
    if baseline is not None:
        every = thinned(len(baseline.rollout.time), POSE_SAMPLES)
        time, p = baseline.rollout.time[every], baseline.rollout.p[every]
        log_arm(recording, f"{side.name}/{baseline.name}", mechanism, parts, time, p, ghost_look(OFF))


def _log_curves(recording: rr.RecordingStream, side: Side, color: Color) -> None:
    subject, comparison = side.comparison.subject, side.comparison
    every = thinned(len(subject.rollout.time), CURVE_SAMPLES)
    time = subject.rollout.time[every]
    _log_error(recording, side, subject, Style((f"{side.label}, learning",), (color,), width=2.0))
    if comparison.baseline is not None:
        pale = color.faded(0.55, Color(13, 13, 13))
        _log_error(recording, side, comparison.baseline, Style((f"{side.label}, adaptation off",), (pale,)))
    names = comparison.joint_names
    style = Style(names, [joint_color(j) for j in range(len(names))])
    log_series(recording, f"error/{side.name}", time, 1e3 * subject.rollout.error[every], style)
    shares = subject.rollout.applied / comparison.torque_limits  # no peak must be lost
    log_series(recording, f"torque_share/{side.name}/joints", subject.rollout.time, shares, style)
    bounds = Style(("limit", "limit"), (LIMIT, LIMIT), width=1.0)
    log_levels(recording, f"torque_share/{side.name}/limit", time, np.array([-1.0, 1.0]), bounds)
    if subject.lyapunov is not None and subject.lyapunov[0] > 0.0:
        share = subject.lyapunov[every, None] / subject.lyapunov[0]
        log_series(recording, f"lyapunov/{side.name}", time, share, Style((side.label,), (color,), width=2.0))


def _log_error(recording: rr.RecordingStream, side: Side, run: ControllerRun, style: Style) -> None:
    every = thinned(len(run.rollout.time), CURVE_SAMPLES)
    decades = np.log10(1e3 * np.maximum(side.tip_errors(run)[every], SMALLEST_ERROR))
    path = f"tip_error/{side.name}_{run.name}"
    log_series(recording, path, run.rollout.time[every], decades[:, None], style)


def _floor(result: SideBySide) -> float:
    """The floor's height (m): low enough for everything that moves to stay above it."""
    return min(
        floor_height(side.comparison.mechanism, _parts(side), side.comparison.subject.rollout.p)
        for side in result.sides
    )


def _markdown(result: SideBySide) -> str:
    """The outcome, and the table."""
    warning = "" if result.complete else f"**{INCOMPLETE}**\n\n"
    heads = " | ".join(side.label for side in result.sides)
    lines = [f"| | {heads} |", "|---" * (1 + len(result.sides)) + "|"]
    for row in rows(result):
        values = row.values or ("",) * len(result.sides)
        what = f"**{row.what}**" if row.section else row.what
        lines.append(f"| {what} | {' | '.join(values)} |")
    return warning + verdict(result) + "\n\n" + "\n".join(lines) + f"\n\n{WHY_NOT_16}\n"


def _blueprint(result: SideBySide) -> rrb.Blueprint:
    """Both arms and the table on the left, curves on the right."""
    left = rrb.Vertical(_scene(result), views.text("summary", "Table"), row_shares=[1, 1])
    curves = [views.curves("/tip_error", "Distance of the tip from its path, powers of ten of a mm")]
    curves.append(views.curves("/lyapunov", "Lyapunov function over its first value · must never rise"))
    for side in result.sides:
        unit = side.comparison.error_unit
        curves.append(views.curves(f"/error/{side.name}", f"{side.label}: tracking error [{unit}]"))
    for side in result.sides:
        curves.append(views.curves(f"/torque_share/{side.name}", f"{side.label}: torque / limit", (-1.1, 1.1)))
    return views.tabs(rrb.Horizontal(left, rrb.Grid(*curves, grid_columns=2), column_shares=[5, 7], name="Overview"))


def _scene(result: SideBySide) -> rrb.View:
    target = np.array([0.2, 0.0, 0.12])
    away = np.array([1.5, -0.75, 0.6]) * (0.5 + 0.45 * APART * (len(result.sides) - 1))
    names = [*(side.label for side in result.sides), "desired: green ghost", "adaptation off: orange"]
    return views.arm(WORLD, " · ".join(names), Viewpoint(target + away, target, _floor(result)))
