"""Motion of an earlier log, to which the next one is to add what is open."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from adaptctl.control.excitation.excitation_trajectory import INDEPENDENT_ROW_RATE, Motion
from adaptctl.dynamics import Mechanism
from adaptctl.identification.columns import JointLog, joint_columns, joint_log
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.filtered_dynamics import motions_of
from adaptctl.identification.log_files import read_log
from adaptctl.identification.preparation import prepare

# Hz, below the noise of encoders, which accelerations would take for excitation.
CUTOFF = 10.0


def read_earlier_motion(
    mechanism: Mechanism,
    logs: Sequence[str | Path],
    drives: Drives | None = None,
    columns: dict[str, str] | None = None,
    units: dict[str, str] | None = None,
) -> Motion:
    """Positions, velocities and accelerations (n, r) of log files, of whose columns `identify` has the meaning."""
    tables = [read_log(path) for path in logs]
    if drives is None:
        drives = joint_columns(mechanism, tables[0], columns, units, True)
    known = drives.ordered_like(mechanism)
    return earlier_motion(mechanism, [joint_log(log, known) for log in tables])


def earlier_motion(mechanism: Mechanism, logs: Sequence[JointLog]) -> Motion:
    """Positions, velocities and accelerations (n, r) of logs, 50 rows a second."""
    pieces = [piece for log in logs for piece in prepare(log, mechanism)[0]]
    parts: list[Motion] = []
    for motion in motions_of(pieces, CUTOFF):
        every = max(1, round(motion.rate / INDEPENDENT_ROW_RATE))
        p, v, a = (values[::every] for values in motion.states())
        parts.append((p, v, a))
    p, v, a = (np.concatenate(each) for each in zip(*parts, strict=True))
    return p, v, a
