"""Tracking of a comparison's runs in a rerun recording: arms in motion, errors and torques."""

from __future__ import annotations

import numpy as np
import rerun as rr

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.recording.comparison import Comparison, ControllerRun
from adaptctl.recording.palette import GOAL, LIMIT, Color, joint_color, run_color
from adaptctl.recording.scene import GOAL_LOOK, ghost_look, log_arm, log_base, log_path, log_trail, solid_look
from adaptctl.recording.series import Style, log_levels, log_series, thinned
from adaptctl.recording.skeleton import Skeleton

CURVE_SAMPLES, POSE_SAMPLES = 4000, 2000
"""At most as many samples are shown; the table beside the recording has them all."""
SMALLEST_ERROR = 1e-9
"""rad or m: smaller errors are shown as this, since the axis is logarithmic"""


def log_scene(
    recording: rr.RecordingStream,
    comparison: Comparison,
    parts: Skeleton,
    floor: float,
    color: Color,
    within: str = "",
) -> None:
    """Draw the subject, the desired arm and the arm with adaptation off, and the paths of their tips.

    Entities go below ``world/`` and `within`, which ends with a slash if it is anything; `floor` is in m.
    """
    mechanism, rollout = comparison.mechanism, comparison.subject.rollout
    every = thinned(len(rollout.time), POSE_SAMPLES)
    log_base(recording, mechanism, parts, floor, f"{within}base")
    goal = log_arm(
        recording, f"{within}desired", mechanism, parts, rollout.time[every], rollout.reference_p[every], GOAL_LOOK
    )
    log_path(recording, f"{within}path/desired", goal, GOAL)
    _log_moving(recording, within, mechanism, parts, comparison.subject, color, ghost=False)
    if (baseline := comparison.baseline) is not None:
        other = run_color(comparison.color_places[baseline.name])
        _log_moving(recording, within, mechanism, parts, baseline, other, ghost=True)


def _log_moving(
    recording: rr.RecordingStream,
    within: str,
    mechanism: Mechanism,
    parts: Skeleton,
    run: ControllerRun,
    color: Color,
    *,
    ghost: bool,
) -> None:
    """Draw the arm of one run, with its tip's trail."""
    every = thinned(len(run.rollout.time), POSE_SAMPLES)
    time, p = run.rollout.time[every], run.rollout.p[every]
    look = ghost_look(color) if ghost else solid_look(color)
    tip = log_arm(recording, f"{within}{run.name}", mechanism, parts, time, p, look)
    log_trail(recording, f"{within}trail/{run.name}", time, tip, color)


def log_curve(recording: rr.RecordingStream, path: str, run: ControllerRun, values: Array, style: Style) -> None:
    """Draw one curve (T,) over the time of a run."""
    every = thinned(len(values), CURVE_SAMPLES)
    log_series(recording, path, run.rollout.time[every], values[every, None], style)


def log_decades(recording: rr.RecordingStream, path: str, run: ControllerRun, errors: Array, style: Style) -> None:
    """Draw errors (T,), rad or m, as powers of ten of a thousandth."""
    log_curve(recording, path, run, np.log10(1e3 * np.maximum(errors, SMALLEST_ERROR)), style)


def log_joint_errors(recording: rr.RecordingStream, path: str, run: ControllerRun, names: tuple[str, ...]) -> None:
    """Draw the tracking errors of a run's joints, whose names are given, in thousandths of rad or m."""
    every = thinned(len(run.rollout.time), CURVE_SAMPLES)
    log_series(recording, path, run.rollout.time[every], 1e3 * run.rollout.error[every], _joint_style(names))


def log_torque_shares(recording: rr.RecordingStream, path: str, comparison: Comparison) -> None:
    """Draw the subject's torques over their limits, every sample, so that no peak is lost; and the limits."""
    rollout = comparison.subject.rollout
    shares = rollout.applied / comparison.torque_limits
    log_series(recording, f"{path}/joints", rollout.time, shares, _joint_style(comparison.joint_names))
    log_limits(recording, f"{path}/limit", rollout.time, 1.0)


def log_limits(recording: rr.RecordingStream, path: str, time: Array, limit: float) -> None:
    """Draw a limit on either side of zero."""
    log_levels(recording, path, time, np.array([-limit, limit]), Style(("limit", "limit"), (LIMIT, LIMIT), width=1.0))


def _joint_style(names: tuple[str, ...]) -> Style:
    return Style(names, [joint_color(j) for j in range(len(names))])
