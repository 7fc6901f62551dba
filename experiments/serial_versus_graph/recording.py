"""Recording of arms side by side for rerun: one scene, and the same curves of each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from adaptctl.experiments.serial_versus_graph.figures import side_color
from adaptctl.experiments.serial_versus_graph.result import Side, SideBySide
from adaptctl.experiments.serial_versus_graph.wording import WHY_NOT_16, outcome_words, rows
from adaptctl.recording import views
from adaptctl.recording.comparison import ControllerRun
from adaptctl.recording.palette import DARK, Color
from adaptctl.recording.scene import WORLD
from adaptctl.recording.series import Style
from adaptctl.recording.skeleton import Skeleton, skeleton, with_tip
from adaptctl.recording.stream import log_markdown, saved_stream
from adaptctl.recording.tracking import log_curve, log_decades, log_joint_errors, log_scene, log_torque_shares
from adaptctl.recording.viewpoint import Viewpoint, floor_height
from adaptctl.recording.wording import INCOMPLETE

APART = 1.35
"""m between the arms' bases; each has its own path, the same one"""


def write_recording(path: str | Path, result: SideBySide) -> None:
    """Write the recording of a comparison of arms, `result`, for the rerun viewer, a file .rrd at `path`, whole or not
    at all: both arms in one scene, with the same curves of each (tip errors, tracking errors, torques, Lyapunov
    function). Nothing is returned. Raises `FileError` where the file cannot be written."""
    positions = b"".join(np.ascontiguousarray(side.comparison.subject.rollout.p).tobytes() for side in result.sides)
    with saved_stream(path, result, positions, _blueprint(result)) as recording:
        log_markdown(recording, "summary", _markdown(result))
        for i, side in enumerate(result.sides):
            place = [0.0, APART * (i - 0.5 * (len(result.sides) - 1)), 0.0]  # from left to right, from the front
            recording.log(f"{WORLD}/{side.name}", rr.Transform3D(translation=place), static=True)
            log_scene(recording, side.comparison, _parts(side), _floor(result), side_color(i), f"{side.name}/")
            _log_curves(recording, side, side_color(i))


def _parts(side: Side) -> Skeleton:
    return with_tip(skeleton(side.comparison.mechanism), side.tip_link, side.tip)


def _log_curves(recording: rr.RecordingStream, side: Side, color: Color) -> None:
    subject, baseline = side.comparison.subject, side.comparison.baseline
    _log_tip_error(recording, side, subject, Style((f"{side.label}, learning",), (color,), width=2.0))
    if baseline is not None:
        _log_tip_error(recording, side, baseline, Style((f"{side.label}, adaptation off",), (color.faded(0.3, DARK),)))
    log_joint_errors(recording, f"error/{side.name}", subject, side.comparison.joint_names)
    log_torque_shares(recording, f"torque_share/{side.name}", side.comparison)
    if subject.lyapunov is not None and subject.lyapunov[0] > 0.0:
        style = Style((side.label,), (color,), width=2.0)
        log_curve(recording, f"lyapunov/{side.name}", subject, subject.lyapunov / subject.lyapunov[0], style)


def _log_tip_error(recording: rr.RecordingStream, side: Side, run: ControllerRun, style: Style) -> None:
    log_decades(recording, f"tip_error/{side.name}_{run.name}", run, side.tip_errors(run), style)


def _floor(result: SideBySide) -> float:
    """Height of the floor (m): low enough for everything that moves to stay above it."""
    return min(
        floor_height(side.comparison.mechanism, _parts(side), side.comparison.subject.rollout.p)
        for side in result.sides
    )


def _markdown(result: SideBySide) -> str:
    """Summary in Markdown: the outcome, and the table."""
    warning = "" if result.complete else f"**{INCOMPLETE}**\n\n"
    heads = " | ".join(side.label for side in result.sides)
    lines = [f"| | {heads} |", "|---" * (1 + len(result.sides)) + "|"]
    for row in rows(result):
        values = row.values or ("",) * len(result.sides)
        what = f"**{row.what}**" if row.section else row.what
        lines.append(f"| {what} | {' | '.join(values)} |")
    return warning + outcome_words(result) + "\n\n" + "\n".join(lines) + f"\n\n{WHY_NOT_16}\n"


def _blueprint(result: SideBySide) -> rrb.Blueprint:
    """Layout of the screen: both arms and the table on the left, curves on the right."""
    left = rrb.Vertical(_scene(result), views.text("summary", "Table"), row_shares=[1, 1])
    end = max(side.comparison.subject.duration for side in result.sides)
    curves = [
        views.curves("/tip_error", "Distance of the tip from its path, powers of ten of a mm", end, room=views.LONG)
    ]
    curves.append(views.curves("/lyapunov", "Lyapunov function over its first value · in theory it never rises", end))
    for side in result.sides:
        unit = side.comparison.error_unit
        curves.append(views.curves(f"/error/{side.name}", f"{side.label}: tracking error [{unit}]", end))
    for side in result.sides:
        curves.append(views.curves(f"/torque_share/{side.name}", f"{side.label}: torque / limit", end, (-1.1, 1.1)))
    return views.tabs(rrb.Horizontal(left, rrb.Grid(*curves, grid_columns=2), column_shares=[5, 7], name="Overview"))


def _scene(result: SideBySide) -> rrb.View:
    floor = _floor(result)
    target = np.array([0.2, 0.0, 0.12 + 0.4 * floor])
    away = np.array([1.5, -0.75, 0.6]) * (0.45 - 0.3 * floor + 0.45 * APART * (len(result.sides) - 1))
    names = [*(side.label for side in result.sides), "desired: green ghost", "adaptation off: orange"]
    return views.arm(WORLD, " · ".join(names), Viewpoint(target + away, target, floor))
