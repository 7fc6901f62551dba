"""Positions in columns of torques or velocities of a log."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.joint import Joint
from adaptctl.logs.on_disk import each_column


def exchanged_words(logs: Iterable[tuple[Array, Array]]) -> str:
    """Words for logs of positions and torques (n, r), where of all joints the positions are the rougher ones."""
    ways = np.array([[[_way(own) for own in each_column(values)] for values in log] for log in logs])
    position, torque = ways.max(axis=0)
    told = ", and whether positions and torques are exchanged, as the torques are smoother"
    return told if (torque > 0.0).all() and (torque < position).all() else ""


def are_velocities(logs: Iterable[tuple[Array, Array]], joints: Sequence[Joint]) -> bool:
    """True for logs of times (n,) and values (n, r) that are, of all joints, within the limits of their velocities."""
    speed, way = np.array([[joint.limits.velocity, joint.limits.upper - joint.limits.lower] for joint in joints]).T
    each = ((own, np.cumsum(own * np.gradient(time)[:, None], axis=0)) for time, own in logs)
    return all((np.abs(own) <= speed).all() and (np.ptp(found, axis=0) <= way).all() for own, found in each)


def _way(values: Array) -> float:
    """Way of a column over its range."""
    return float(np.abs(np.diff(values)).sum() / max(np.ptp(values), np.finfo(float).tiny))
