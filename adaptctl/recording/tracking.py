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
    """Draw the arms of a `comparison` in a rerun recording, below the entity "world", with the paths of their tips. The
    arm of the first run is solid, in `color`; translucent ghosts are the desired motion, green, and, where there is
    one, the run with adaptation off, in its own colour.

    `parts` are the shapes they are drawn by, `floor` is the floor's height, m, and `within` a prefix of the entities'
    names below "world", ending in a slash, empty by default. Each run is thinned to at most 2000 samples. Raises
    `NonFiniteError` for positions that are NaN or infinite, `LoopError` where kinematic loops cannot be closed,
    `SingularityError` near a singularity of these.
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
    """Draw one curve in a rerun recording, as the entity `path`: `values` (T,), in the unit that its view states, at
    the times of the run's T samples, thinned to at most 4000. `style` has one name and one colour. Raises `ValueError`
    for values that are not one-dimensional; another number of them is not checked."""
    every = thinned(len(values), CURVE_SAMPLES)
    log_series(recording, path, run.rollout.time[every], values[every, None], style)


def log_decades(recording: rr.RecordingStream, path: str, run: ControllerRun, errors: Array, style: Style) -> None:
    """Draw the `errors` of a `run` in a rerun recording, as the entity `path`, on a logarithmic scale. The curve is
    log10(1000 e) for the errors e (T,), rad (m if prismatic), of T samples: the power of ten in mrad or mm. Errors
    below 1e-9 are drawn as 1e-9; samples are thinned to at most 4000. `style` has one name and one colour. Raises
    `ValueError` for errors that are not one-dimensional; another number of them is not checked."""
    log_curve(recording, path, run, np.log10(1e3 * np.maximum(errors, SMALLEST_ERROR)), style)


def log_joint_errors(recording: rr.RecordingStream, path: str, run: ControllerRun, names: tuple[str, ...]) -> None:
    """Draw the tracking errors of a run's r joints over time in a rerun recording, as the entity `path`, one curve a
    joint, in mrad or mm, thinned to at most 4000 samples. `names` are the r joints' names, for the legend. Nothing is
    checked."""
    every = thinned(len(run.rollout.time), CURVE_SAMPLES)
    log_series(recording, path, run.rollout.time[every], 1e3 * run.rollout.error[every], _joint_style(names))


def log_torque_shares(recording: rr.RecordingStream, path: str, comparison: Comparison) -> None:
    """Draw the applied torques of a comparison's first run over time in a rerun recording, each divided by its joint's
    torque limit, no unit: one curve a joint below the entity `path`/joints, and the limits, -1 and 1, at `path`/limit.
    All samples are drawn, so that no peak is lost. Raises `ValueError` for a run of another number of joints."""
    rollout = comparison.subject.rollout
    shares = rollout.applied / comparison.torque_limits
    log_series(recording, f"{path}/joints", rollout.time, shares, _joint_style(comparison.joint_names))
    log_limits(recording, f"{path}/limit", rollout.time, 1.0)


def log_limits(recording: rr.RecordingStream, path: str, time: Array, limit: float) -> None:
    """Draw a limit on both sides of zero in a rerun recording, as the entity `path`: horizontal grey lines at `limit`
    and -`limit`, in the unit that their view states, from the first to the last of T times `time` (T,), s. Raises
    `IndexError` without times."""
    log_levels(recording, path, time, np.array([-limit, limit]), Style(("limit", "limit"), (LIMIT, LIMIT), width=1.0))


def _joint_style(names: tuple[str, ...]) -> Style:
    return Style(names, [joint_color(j) for j in range(len(names))])
