"""Logs of joints: their positions and torques, in SI units."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import FileError
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.reading.table import LogTable

FEWEST = 100
"""Samples below which nothing can be learnt from a log."""


@dataclass(frozen=True, eq=False)
class JointLog:
    """Log of a robot's joints, n samples of r joints in SI units. `time` (n,) is in s, in ascending order, as logged;
    `position` (n, r) in rad (m for a prismatic joint); `torque` (n, r) in N m (N), where a motor's torque constant is
    unknown as if it were 1; and `velocity` (n, r) in rad/s (m/s), as logged, None, the default, where it was not.
    `source` is the log's file, as text; `len` gives n. Nothing is checked at construction."""

    source: str
    time: Array
    """(n,) s, rising"""
    position: Array
    """(n, r) rad or m"""
    torque: Array
    """(n, r) N m or N; with unknown torque constants, of constants of 1"""
    velocity: Array | None = None
    """(n, r) rad/s or m/s as logged; None where it was not"""

    def __len__(self) -> int:
        return len(self.time)


def joint_log(log: LogTable, drives: Drives, rate: float | None = None) -> JointLog:
    """The log of a robot's joints, a `JointLog`, from the table `log` of its motors' positions, torques and, if logged,
    velocities. Columns, units and the transmission from motors to joints are those of `drives`, in whose order the
    joints are.

    With a sampling `rate` (Hz, not checked) rows are taken as evenly spaced from time 0, else (None) by their stamps.
    Raises `FileError`, naming the column, for a column that is missing or not finite in every row, fewer than 100
    samples, positions or torques that are the same in every row, and times that do not rise from row to row or only
    count rows.
    """
    time = _time(log, drives, rate)
    position = np.stack([log.column(m.position, f"position of {m.name}") for m in drives.motors], axis=-1)
    torque = np.stack([log.column(m.torque, f"torque of {m.name}") for m in drives.motors], axis=-1)
    if len(log) < FEWEST:
        raise FileError(f"{log.source}: has {len(log)} samples; at least {FEWEST} are needed, some seconds of motion")
    _require_change(log, [m.position for m in drives.motors], position, "the joint is at rest throughout")
    _require_change(log, [m.torque for m in drives.motors], torque, "no torque was logged there")
    constants = np.nan_to_num(drives.constants, nan=1.0)
    return JointLog(
        log.source,
        time,
        drives.position(position * drives.units.position),
        drives.torque(torque * (drives.units.torque or 1.0) * constants),
        _velocity(log, drives),
    )


def _velocity(log: LogTable, drives: Drives) -> Array | None:
    names = [m.velocity for m in drives.motors]
    if drives.units.velocity is None or None in names:
        return None
    columns = [log.column(name, f"velocity of {m.name}") for m, name in zip(drives.motors, names, strict=True) if name]
    return drives.velocity(np.stack(columns, axis=-1) * drives.units.velocity)


def _time(log: LogTable, drives: Drives, rate: float | None) -> Array:
    if rate is not None:
        return np.arange(len(log)) / rate
    stamps = log.column(drives.time, "time")
    steps = np.diff(stamps)
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0))
        kind = "twice" if steps[row] == 0.0 else "after a later one"
        raise FileError(
            f"{log.source}: column {drives.time!r}: the stamp {stamps[row + 1]:g} of row {row + 2} comes {kind}; time "
            "must rise from row to row: remove repeated rows, sort them, or cut the log into several"
        )
    if len(steps) and np.all(steps == 1.0) and drives.units.time > 1e-3:
        raise FileError(
            f"{log.source}: column {drives.time!r} counts rows (0, 1, 2, ...), it is no time: give the sampling rate "
            "with --rate HZ"
        )
    return np.asarray(stamps * drives.units.time)


def _require_change(log: LogTable, names: list[str], values: Array, meaning: str) -> None:
    for name, still in zip(names, np.ptp(values, axis=0) == 0.0, strict=True):
        if still:
            raise FileError(
                f"{log.source}: column {name!r} is {log.columns[name][0]:g} in every row: {meaning}; choose another "
                "column or another log"
            )


def same_place(first: str | Path, second: str | Path) -> bool:
    """True if two paths mean one log: `first` and `second` are equal, or their last parts, the file names, are. No file
    is looked up, and nothing is raised."""
    return Path(first) == Path(second) or Path(first).name == Path(second).name
