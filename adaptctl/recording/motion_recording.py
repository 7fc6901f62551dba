"""A motion of an arm beside its reference, recorded or shown live."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.files import replacing
from adaptctl.recording import views
from adaptctl.recording.colors import GOAL, run_color
from adaptctl.recording.live import is_file
from adaptctl.recording.scene import WORLD, log_arm, log_base, log_trail
from adaptctl.recording.skeleton import Skeleton, Viewpoint, floor_height, skeleton
from adaptctl.recording.stream import Curves, log_curves, of_joints, written

RATE = 50.0
"""Hz, at most"""


def record_motion(path: Path, mechanism: Mechanism, time: Array, p: Array, reference_p: Array, torque: Array) -> None:
    """Write positions, references (n, r) and torques at times (n,) in s, and the arm that has them, as an .rrd file."""
    every = max(1, round(1.0 / (RATE * float(time[1] - time[0]))))
    rows = np.column_stack((time, p, reference_p, torque))[::every]
    with replacing(path) as beside:
        recording, parts = started(mechanism, str(beside), rows, "motion")
        draw(recording, mechanism, parts, rows)
        written(recording)
        recording.disconnect()


def started(mechanism: Mechanism, url: str, first: Array, what: str) -> tuple[rr.RecordingStream, Skeleton]:
    """Recording at a place, laid out for an arm that moves as its first samples say, and the arm's shapes."""
    recording = rr.RecordingStream(f"adaptctl-{what}", make_default=False)
    recording.save(url) if is_file(url) else recording.connect_grpc(url)
    parts, r = skeleton(mechanism), mechanism.dof
    around = np.concatenate((first[:, 1 : 1 + r], first[:, 1 + r : 1 + 2 * r]))
    names = [("/error", "Tracking error [mrad or mm]"), ("/torque", "Torque [N·m or N]"), ("/position", "Position")]
    arm = views.arm(WORLD, "The arm · desired: green ghost", Viewpoint.of(mechanism, parts, around))
    recording.send_blueprint(views.live(arm, [views.curves(origin, name, None) for origin, name in names]))
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.send_recording_name(f"{mechanism.name}, {what}")
    log_base(recording, mechanism, parts, floor_height(mechanism, parts, around))
    return recording, parts


def draw(recording: rr.RecordingStream, mechanism: Mechanism, parts: Skeleton, rows: Array) -> None:
    """Draw samples (k, 1 + 3 r)."""
    r, times = mechanism.dof, rows[:, 0]
    p, desired, torque = (rows[:, 1 + k * r : 1 + (k + 1) * r] for k in range(3))
    tip = log_arm(recording, "arm", mechanism, parts, times, p, run_color(0))
    log_arm(recording, "desired", mechanism, parts, times, desired, GOAL, ghost=True)
    log_trail(recording, "trail/arm", times, tip, run_color(0))
    names = [joint.name for joint in mechanism.primary_joints]
    kinds = {"error": 1e3 * (p - desired), "torque": torque, "position/actual": p}
    log_curves(recording, (of_joints(path, times, values, names) for path, values in kinds.items()))
    pale = Curves("position/desired", times, desired, [f"{name} desired" for name in names], [GOAL] * r, 1.0)
    log_curves(recording, [pale])
