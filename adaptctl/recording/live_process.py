"""Process that draws a live view."""

from __future__ import annotations

import json
import signal
import socket
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import rerun as rr

from adaptctl.arrays import Array
from adaptctl.description import GROUND
from adaptctl.description.pose import Pose
from adaptctl.description.visual import Box, Visual
from adaptctl.dynamics import Mechanism, load
from adaptctl.recording import views
from adaptctl.recording.drawing import GOAL, run_color
from adaptctl.recording.live import is_file
from adaptctl.recording.scene import WORLD, log_arm, log_base, log_surroundings, log_trail
from adaptctl.recording.skeleton import Skeleton, Viewpoint, floor_height, skeleton
from adaptctl.recording.stream import Curves, log_curves, of_joints

# Time in s of samples that are drawn together, for a viewer and for a file: rerun keeps an entry in memory, for the
# file's index, of all that was written together.
BATCH_TIME, FILE_BATCH_TIME = 0.05, 2.0
# Largest sample in bytes.
MAX_SAMPLE_BYTES = 1 << 16


def main(descriptor: int, url: str) -> None:
    """Draw a live view until its samples end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the loop, which then closes the socket
    given = json.load(sys.stdin)
    mechanism = _mechanism(given["robot"])
    with socket.socket(fileno=descriptor) as samples:
        rows = _Rows(samples, 1 + 3 * mechanism.dof, FILE_BATCH_TIME if is_file(url) else BATCH_TIME)
        first = rows.next()
        if first is not None:
            recording, parts = started(mechanism, url, first)
            log_surroundings(recording, "surroundings", _surroundings(given["boxes"]))
            draw(recording, mechanism, parts, first)
            while (more := rows.next()) is not None:
                draw(recording, mechanism, parts, more)
            _end(recording)


def _end(recording: rr.RecordingStream) -> None:
    """Send what is left, if the viewer was not closed."""
    with suppress(RuntimeError):
        recording.flush()
        recording.disconnect()


def _mechanism(text: str) -> Mechanism:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "mechanism.toml"
        file.write_text(text, encoding="utf-8")
        return load(file, as_written=True)


def _surroundings(boxes: Sequence[Any]) -> list[Visual]:
    """Boxes, each by its rotation (3, 3), center (3,) in m and edge lengths (3,) in m."""
    poses = [(Pose(np.array(rotation), np.array(center)), tuple(size)) for rotation, center, size in boxes]
    return [Visual(GROUND, pose, Box(size)) for pose, size in poses]


class _Rows:
    """Samples (k, 1 + 3 r) as they come: time, positions, desired positions, torques."""

    def __init__(self, samples: socket.socket, width: int, batch_time: float = BATCH_TIME) -> None:
        self._samples, self._width, self._batch_time, self._over = samples, width, batch_time, False

    def next(self) -> Array | None:
        """Numbers received within a short while; None at the end."""
        rows: list[Array] = []
        deadline = time.monotonic() + self._batch_time
        while not self._over and (not rows or time.monotonic() < deadline):
            self._samples.settimeout(max(deadline - time.monotonic(), 1e-3) if rows else None)
            try:
                data = self._samples.recv(MAX_SAMPLE_BYTES)
            except TimeoutError:
                break
            self._over = not data
            if len(data) == self._width * np.dtype(np.float64).itemsize:
                rows.append(np.frombuffer(data))
        return np.stack(rows) if rows else None


def started(mechanism: Mechanism, url: str, first: Array) -> tuple[rr.RecordingStream, Skeleton]:
    """Recording at a place, laid out for an arm that moves as its first samples say, and the arm's shapes."""
    recording = rr.RecordingStream("adaptctl-live", make_default=False)
    recording.save(url) if is_file(url) else recording.connect_grpc(url)
    parts, r = skeleton(mechanism), mechanism.dof
    around = np.concatenate((first[:, 1 : 1 + r], first[:, 1 + r : 1 + 2 * r]))
    names = [("/error", "Tracking error [mrad or mm]"), ("/torque", "Torque [N·m or N]"), ("/position", "Position")]
    arm = views.arm(WORLD, "The arm · desired: green ghost", Viewpoint.of(mechanism, parts, around))
    recording.send_blueprint(views.live(arm, [views.curves(origin, name, None) for origin, name in names]))
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.send_recording_name(f"{mechanism.name}, live")
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


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2])
