"""Logs of robots that compensate their own weight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError, InputError
from adaptctl.identification.columns import JointLog
from adaptctl.identification.drives_file import Drives
from adaptctl.logs.on_disk import rowwise
from adaptctl.logs.table import LogTable

ADDED = "flag.compensation."
# Columns of a run of `drive` with the torques that the robot added, which its applied torques hold.


def validate_not_added(log: LogTable) -> None:
    """Refuse a run of `drive` in whose torques those of the robot are already."""
    if any(name.startswith(ADDED) and np.any(values) for name, values in log.columns.items()):
        raise FileError(
            f"{log.source}: the applied torques of this run hold the robot's own compensation; leave out --compensated"
        )


def with_own_gravity(log: JointLog, mechanism: Mechanism, drives: Drives) -> JointLog:
    """Log with the torques that hold the links of the robot's file added, which the robot itself had added."""
    if np.isnan(drives.constants).any():
        raise InputError(f"{log.source}: compensated: expected known torque constants, to add torques in N m to")

    def whole(torque: Array, position: Array) -> Array:
        rest = np.zeros_like(position)
        return torque + mechanism.inverse_dynamics(position, rest, rest)

    note = f"{log.source}: the gravity torques of the robot file were added to {len(log)} rows of compensated torques"
    return replace(log, torque=rowwise(whole, log.torque, log.position), notes=(*log.notes, note))
