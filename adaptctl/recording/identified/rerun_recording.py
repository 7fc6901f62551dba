"""An identification as a rerun recording: the arm in the validation's motion, and its torques."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from adaptctl.identification import Identification
from adaptctl.recording import views
from adaptctl.recording.identified.report import components, consistency, verdict
from adaptctl.recording.palette import MUTED, joint_color, run_color
from adaptctl.recording.scene import WORLD, entity, log_arm, log_base, log_trail, solid_look
from adaptctl.recording.series import Style, log_series, thinned
from adaptctl.recording.skeleton import skeleton
from adaptctl.recording.stream import log_markdown, saved_stream
from adaptctl.recording.units import torque_error_unit, typeset
from adaptctl.recording.viewpoint import Viewpoint, floor_height

SAMPLES = 3000


@dataclass(frozen=True)
class Titled:
    """Title and origin of an identification's recording: `title`, a few words for its readers; `experiment`, the name
    of the command, "identify" unless given; `seed`, that of random numbers, 0 by default; and `complete`, True by
    default, False where it was interrupted. Nothing is checked at construction."""

    title: str
    experiment: str = "identify"
    seed: int = 0
    complete: bool = True


def write_recording(path: str | Path, found: Identification) -> None:
    """Write the recording of an identification for the rerun viewer to the file `path` (.rrd), whole or not at all. It
    shows the arm in the logs' motion, the torques of every joint measured and predicted over the validation, their
    errors, and the outcome in words. Raises `FileError` where the file cannot be written or read back."""
    content = np.ascontiguousarray(found.validation.measured).tobytes()
    with saved_stream(path, Titled(f"{found.mechanism.name}, identified"), content, _blueprint(found)) as recording:
        log_markdown(recording, "summary", "\n\n".join((verdict(found), consistency(found), components(found))))
        _log_arm(recording, found)
        _log_torques(recording, found)


def _log_arm(recording: rr.RecordingStream, found: Identification) -> None:
    """The motion of the logs that were learnt from, one after the other."""
    mechanism, parts = found.mechanism, skeleton(found.mechanism)
    p = np.concatenate([motion.position for motion in found.motions])
    time = np.concatenate(
        [_times(motion.log.time[motion.first :], motion.every, len(motion.position)) for motion in found.motions]
    )
    order = np.argsort(time, kind="stable")
    kept = order[thinned(len(order), SAMPLES)]
    log_base(recording, mechanism, parts, floor_height(mechanism, parts, p))
    tip = log_arm(recording, "logged", mechanism, parts, time[kept], p[kept], solid_look(run_color(0)))
    log_trail(recording, "logged", time[kept], tip, run_color(0))


def _times(time: np.ndarray, every: int, count: int) -> np.ndarray:
    return time[::every][:count]


def _log_torques(recording: rr.RecordingStream, found: Identification) -> None:
    validation, joints = found.validation, found.mechanism.primary_joints
    every = thinned(len(validation.time), SAMPLES)
    for j, joint in enumerate(joints):
        both = np.stack([validation.measured[every, j], validation.predicted[every, j]], axis=-1)
        style = Style(("measured", "predicted"), (MUTED, joint_color(j)))
        log_series(recording, f"torque/{entity(joint.name)}", validation.time[every], both, style)
    colors = [joint_color(j) for j in range(len(joints))]
    names = [joint.name for joint in joints]
    log_series(recording, "error", validation.time[every], validation.error[every], Style(names, colors))


def _blueprint(found: Identification) -> rrb.Blueprint:
    time, mechanism = found.validation.time, found.mechanism
    start, end = float(time[0]), float(time[-1])
    torques = [
        views.curves(
            f"torque/{entity(joint.name)}",
            f"{joint.name}: torque [{typeset(joint.kind.effort_unit)}]",
            end,
            start=start,
        )
        for joint in mechanism.primary_joints
    ]
    error = views.curves(
        "error", f"All joints: predicted minus measured [{torque_error_unit(mechanism)}]", end, start=start
    )
    p = np.concatenate([motion.position for motion in found.motions])
    viewpoint = Viewpoint.of(mechanism, skeleton(mechanism), p)
    arm, summary = views.arm(WORLD, "The log's motion", viewpoint), views.text("summary", "Summary")
    left = rrb.Vertical(arm, summary, row_shares=[3, 2])
    right = rrb.Grid(*torques, error, grid_columns=2)
    return views.tabs(rrb.Horizontal(left, right, column_shares=[2, 3], name="Torques on the validation"))
