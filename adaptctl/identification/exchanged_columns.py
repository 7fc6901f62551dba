"""Positions and torques in each other's columns of a log."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from adaptctl.arrays import Array
from adaptctl.logs.on_disk import each_column


def exchanged_words(logs: Iterable[tuple[Array, Array]]) -> str:
    """Words for logs of positions and torques (n, r), where of all joints the positions are the rougher ones."""
    ways = np.array([[[_way(own) for own in each_column(values)] for values in log] for log in logs])
    position, torque = ways.max(axis=0)
    told = ", and whether positions and torques are exchanged, as the torques are smoother"
    return told if (torque > 0.0).all() and (torque < position).all() else ""


def _way(values: Array) -> float:
    """Way of a column over its range."""
    return float(np.abs(np.diff(values)).sum() / max(np.ptp(values), np.finfo(float).tiny))
