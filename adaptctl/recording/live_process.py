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
from adaptctl.recording.live import is_file
from adaptctl.recording.motion_recording import draw, started
from adaptctl.recording.scene import log_surroundings

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
            recording, parts = started(mechanism, url, first, "live")
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


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2])
