"""Curves over time, in a rerun recording: one entity holds many curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from adaptctl.arrays import Array
from adaptctl.recording.drawing import thinned as thinned
from adaptctl.recording.palette import Color
from adaptctl.recording.scene import TIMELINE


@dataclass(frozen=True)
class Style:
    """Style of n curves that are drawn under one entity of a recording: their `names`, for the legend, and `colors`, n
    of each. The line `width` of all is in points of the screen, 1.5 by default. Nothing is checked at construction."""

    names: Sequence[str]
    colors: Sequence[Color]
    width: float = 1.5


def log_series(recording: rr.RecordingStream, path: str, time: Array, values: Array, style: Style) -> None:
    """Log n curves under the entity `path` of a rerun recording: `values` (T, n), in the unit that their view states,
    at T times `time` (T,), s, with the names and colours of `style`, n each. Without curves (n = 0) nothing is logged.
    Raises `ValueError` for values that are not two-dimensional; where there are not T times, rerun warns and draws no
    curve."""
    samples, curves = values.shape
    if curves == 0:
        return
    lines = rr.SeriesLines(colors=list(style.colors), names=list(style.names), widths=[style.width] * curves)
    recording.log(path, lines, static=True)
    recording.send_columns(
        path,
        [rr.TimeColumn(TIMELINE, duration=time)],
        rr.Scalars.columns(scalars=np.ascontiguousarray(values).ravel()).partition(np.full(samples, curves)),
    )


def log_levels(recording: rr.RecordingStream, path: str, time: Array, levels: Array, style: Style) -> None:
    """Log n horizontal lines, such as limits or true values, under the entity `path` of a rerun recording: at the
    heights `levels` (n,), in the unit that their view states, from the first to the last of T times `time` (T,), s,
    with the names and colours of `style`, n each. Raises `IndexError` without times."""
    ends = np.array([time[0], time[-1]])
    log_series(recording, path, ends, np.stack([levels, levels]), style)
