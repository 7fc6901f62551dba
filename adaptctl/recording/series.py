"""Curves over time, in a rerun recording: one entity holds many curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from adaptctl.arrays import Array
from adaptctl.recording.palette import Color
from adaptctl.recording.scene import TIMELINE


@dataclass(frozen=True)
class Style:
    """Names, colours and width of the curves of one entity."""

    names: Sequence[str]
    colors: Sequence[Color]
    width: float = 1.5


def log_series(recording: rr.RecordingStream, path: str, time: Array, values: Array, style: Style) -> None:
    """Log curves (T, n) over times (T,) under one entity."""
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
    """Log horizontal lines (n,) over the whole of the times (T,): limits and true values."""
    ends = np.array([time[0], time[-1]])
    log_series(recording, path, ends, np.stack([levels, levels]), style)


def thinned(samples: int, most: int) -> slice:
    """Slice of evenly spaced samples, at most `most`: a screen shows no more, and the table has them all."""
    return slice(0, samples, max(1, -(-samples // most)))
