"""Tracking of a comparison's runs in a rerun recording: arms in motion, errors and torques."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import rerun as rr

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import EssentialSpace
from adaptctl.recording.comparison import Comparison, ControllerRun
from adaptctl.recording.drawing import GOAL, LIMIT, MUTED, Color, joint_color, run_color, thinned
from adaptctl.recording.figures import shares, threshold
from adaptctl.recording.scene import GOAL_LOOK, entity, ghost_look, log_arm, log_base, log_path, log_trail, solid_look
from adaptctl.recording.skeleton import Skeleton
from adaptctl.recording.stream import Style, log_levels, log_series

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


def decades(space: EssentialSpace) -> Array:
    """Powers of ten (P,), no unit, by which the singular values of a mechanism's matrix of energy differences between
    states (rows), by its P inertial parameters (columns), lie above a threshold in their gap: log10(s_i / sqrt(s_k
    s_(k+1))). Here s_i = sigma_i/sigma_1 are the singular values over the largest, in descending order and at least
    1e-18, and k is the number of independent parameters; s_(k+1) is 1e-18 where k = P. The first k are positive, the
    others negative. `space` is the mechanism's essential space (directions of the parameters that change energies),
    which has the singular values. Nothing is raised."""
    return np.log10(shares(space) / threshold(space))


def log_spectrum(recording: rr.RecordingStream, path: str, space: EssentialSpace) -> None:
    """Draw the singular values of a mechanism's energy differences as bars in a rerun recording, the same at all times.
    A bar's height, no unit, is the power of ten by which its singular value lies above a threshold: that between the
    first k, k being the number of independent inertial parameters, and the others, which are round-off. The first k
    bars, positive, are blue, as the entity `path`/essential; the others, negative, are grey, as `path`/null_space.
    `space` is the mechanism's essential space (directions of the parameters that change energies), which has the
    singular values. Nothing is raised."""
    height, rank = decades(space), space.rank
    parts = (("essential", slice(0, rank), run_color(0)), ("null space", slice(rank, len(height)), MUTED))
    for name, part, color in parts:
        starts = np.arange(len(height))[part] + 0.5
        if len(starts):
            bars = rr.BarChart(height[part], abscissa=starts, color=color)
            recording.log(f"{path}/{entity(name)}", bars, static=True)


def finite_part(comparison: Comparison) -> Comparison:
    """The `comparison` with each of its runs cut off before the first sample at which a position, velocity, torque or
    parameter estimate is NaN or infinite; a run keeps at least its first sample. It is the comparison itself where all
    are finite. Nothing is raised."""
    counts = {run.name: _finite_samples(run) for run in comparison.runs}
    if all(counts[run.name] == len(run.rollout.time) for run in comparison.runs):
        return comparison
    leading = comparison.leading
    if leading is not None:
        leading = replace(leading, errors={name: leading.errors[name][:count] for name, count in counts.items()})
    runs = tuple(_beginning(run, counts[run.name]) for run in comparison.runs)
    return replace(comparison, runs=runs, leading=leading)


def _finite_samples(run: ControllerRun) -> int:
    """Number of a run's samples before the first that is not finite, at least 1."""
    rollout = run.rollout
    arrays = (rollout.p, rollout.v, rollout.torque, rollout.applied, rollout.estimate)
    holes = np.flatnonzero(~np.isfinite(np.concatenate(arrays, axis=1)).all(axis=1))
    return max(1, int(holes[0])) if len(holes) else len(rollout.time)


def _beginning(run: ControllerRun, count: int) -> ControllerRun:
    """A run's first samples, so many of them."""
    rollout = run.rollout
    arrays: dict[str, Any] = {name: x[:count] for name, x in vars(rollout).items() if isinstance(x, np.ndarray)}
    marks = {name: values[:count] for name, values in rollout.marks.items()}
    lyapunov = None if run.lyapunov is None else run.lyapunov[:count]
    return replace(run, rollout=replace(rollout, **arrays, marks=marks), lyapunov=lyapunov)
