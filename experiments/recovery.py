"""Times that errors take to return after an event, and a figure of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.recording import ControllerRun
from adaptctl.recording.wording import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WINDOW = 2.0
"""s over which errors are averaged, before an event and after it"""
TWICE = 2.0


@dataclass(frozen=True)
class Recovery:
    """Recovery of the tracking error of a `run`, a `ControllerRun`, after an `event`, such as a payload's drop.
    `earlier` is the RMS error of all joints (rad, m if prismatic) over the 2 s before the first event; `time`, s, that
    from the event until the RMS error over the next 2 s is below twice `earlier`, None if it never is; and `left` the
    RMS error of the last 2 s before the next event or the run's end, but not from before the event, divided by
    `earlier` (no unit), None without samples then. Nothing is checked at construction."""

    run: ControllerRun
    event: str
    earlier: float
    """RMS error over WINDOW before the first event"""
    time: float | None
    """s from the event until the RMS error over the coming WINDOW is below TWICE the earlier; None for never"""
    left: float | None
    """RMS error over the last WINDOW before the next event, over the earlier"""


def recovery(run: ControllerRun, event: str, earlier: float, begin: float, end: float) -> Recovery:
    """Recovery, a `Recovery`, of the tracking error of a `run` between an event called `event` at `begin` (s) and the
    next at `end` (s, or the run's end). `earlier` is the RMS error (rad, m if prismatic) before the first event of the
    run, not zero. Without samples in the last 2 s before `end`, the recovery's `left` is None. Nothing is checked."""
    end = min(end, run.duration)
    last = run.rms_error(max(begin, end - WINDOW), end)
    left = None if last is None else last / earlier
    return Recovery(run, event, earlier, time_to_return(run, begin, end, TWICE * earlier), left)


def time_to_return(run: ControllerRun, begin: float, end: float, below: float) -> float | None:
    """Time, s, from `begin` (s) to the first sample at which a run's tracking error is back below a bound: the first t
    at which the root mean square error of all joints (rad, m if prismatic) from t to t + 2 s is less than `below`, in
    its unit. Only samples from `begin` on with t + 2 s up to `end` (s) count; None if there is none. Nothing is
    checked."""
    length = round(WINDOW / run.rollout.spacing)
    coming = run.moving_rms_error(WINDOW)[length - 1 :]
    time = run.rollout.time[: len(coming)]
    back = np.flatnonzero((time >= begin) & (time <= end - WINDOW) & (coming < below))
    return float(time[back[0]]) - begin if back.size else None


def recovery_times(found: Sequence[Recovery]) -> Figure:
    """Matplotlib figure of the times, s, that the tracking errors of runs took to recover after events, from the
    recoveries `found`: a panel for each event, with a bar for each run. For a run whose error did not recover, the text
    of the ratio of its last RMS error to that before the events replaces the bar. Nothing is checked."""
    from adaptctl.recording.drawing import sheet

    events = list(dict.fromkeys(one.event for one in found))
    runs = list(dict.fromkeys(one.run.label for one in found))
    figure = sheet(1.0 + 0.3 * len(runs))
    panels = figure.subplots(1, len(events), sharey=True, squeeze=False)[0]
    for axes, event in zip(panels, events, strict=True):
        _bars(axes, [one for one in found if one.event == event], runs)
        axes.set_title(f"after the {event}")
        axes.set_xlabel("time to return [s]")
    names = {one.run.label: f"{one.run.label}  ({1e3 * one.earlier:.2g})" for one in found}
    panels[0].set_yticks(range(len(runs)), [names[label] for label in runs])
    panels[0].invert_yaxis()
    return figure


def _bars(axes: Axes, found: Sequence[Recovery], runs: Sequence[str]) -> None:
    from adaptctl.recording.drawing import MUTED, run_color

    longest = max((one.time for one in found if one.time is not None), default=1.0) or 1.0
    for one in found:
        place = runs.index(one.run.label)
        if one.time is None:
            axes.text(0.02 * longest, place, f"not back: {number(one.left, 2)} × earlier", va="center", color=MUTED.hex)
            continue
        axes.barh(place, one.time, height=0.6, color=run_color(0).hex)
        axes.text(one.time + 0.02 * longest, place, f"{one.time:.2g}", va="center")
    axes.set_xlim(0.0, 1.18 * longest)
