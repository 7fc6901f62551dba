"""Recording of an arm along samples."""

from __future__ import annotations

from pathlib import Path
from time import sleep

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.recording.live import Live

RATE = 50.0
"""Hz, at most"""


def record_motion(path: Path, mechanism: Mechanism, time: Array, p: Array, reference_p: Array, torque: Array) -> None:
    """Write positions, references (n, r) and torques at times (n,) in s, and the arm that has them, as an .rrd file."""
    with Live(mechanism, str(path), rate=RATE) as recording:
        for k in range(0, len(time), max(1, round(1.0 / (RATE * float(time[1] - time[0]))))):
            recording.show(float(time[k]), p[k], reference_p[k], torque[k])
            sleep(1e-3)  # for the process that draws, which would drop samples
