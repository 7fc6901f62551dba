"""Recording of a motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.files import replacing
from adaptctl.recording.live_process import draw, started
from adaptctl.recording.stream import written

RATE = 50.0
"""Hz, at most"""


def record_motion(path: Path, mechanism: Mechanism, time: Array, p: Array, reference_p: Array, torque: Array) -> None:
    """Write positions, references (n, r) and torques at times (n,) in s, and the arm that has them, as an .rrd file."""
    every = max(1, round(1.0 / (RATE * float(time[1] - time[0]))))
    rows = np.column_stack((time, p, reference_p, torque))[::every]
    with replacing(path) as beside:
        recording, parts = started(mechanism, str(beside), rows)
        draw(recording, mechanism, parts, rows)
        written(recording)
        recording.disconnect()
