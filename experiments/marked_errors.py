"""Figure of parameter errors over time, with the times at which each run was marked below."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.experiments.parameter_errors import SAMPLES
from adaptctl.recording import ControllerRun

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Marked(NamedTuple):
    """Curve of a `run`, a `ControllerRun` of T samples, for a figure: `error` (T,), its parameter error, no unit;
    `marked` (T,), positive at samples at which an event held, such as a torque at its limit; and `place`, the index,
    from 0, of its colour in the palette. Nothing is checked at construction."""

    run: ControllerRun
    error: Array
    marked: Array
    place: int
    """of its colour among the palette's"""


def marked_errors(curves: Sequence[Marked], meaning: str) -> Figure:
    """Matplotlib figure of the parameter errors (no unit, logarithmic) of the runs in `curves`, at least one, over
    time, s, and below them a bar for each run, filled while an event held, such as a torque at its limit. `meaning`,
    the title of the bars, says what the event is. Nothing is checked."""
    from adaptctl.recording.drawing import run_color, sheet, thinned

    figure = sheet(3.6 + 0.22 * len(curves))
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3.0, 0.25 * len(curves) + 0.2))
    for i, (run, error, marked, place) in enumerate(curves):
        every, color = thinned(len(error), SAMPLES), run_color(place).hex
        above.semilogy(run.rollout.time[every], error[every], color=color, label=run.label)
        below.broken_barh(spans(run.rollout.time, marked), (-i - 0.35, 0.7), color=color)
    above.set_ylabel("parameter error")
    below.set_yticks([-i for i in range(len(curves))], [curve.run.label for curve in curves])
    below.set_ylim(-len(curves) + 0.4, 0.6)
    below.set_title(meaning)
    below.set_xlabel("time [s]")
    figure.legend(*above.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


def spans(time: Array, marked: Array) -> list[tuple[float, float]]:
    """Intervals of time in which `marked` (T,) is positive, as a list of pairs (start, length), s, in order. `time`
    (T,), s, is that of the T evenly spaced samples, each of which counts until the next; the last counts as long as the
    others. Nothing is checked."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], (marked > 0.0).astype(int), [0]))))
    period = float(time[1] - time[0]) if len(time) > 1 else 0.0
    starts, stops = edges[::2], edges[1::2]
    return [(float(time[a]), float(time[b - 1] - time[a]) + period) for a, b in zip(starts, stops, strict=True)]
