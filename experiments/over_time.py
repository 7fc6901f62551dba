"""Figure of a quantity of all runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from adaptctl.arrays import Array
from adaptctl.recording import ControllerRun
from adaptctl.recording.comparison import color_indices

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLOTTED_SAMPLES = 600
"""samples of a curve"""


def over_time(runs: Sequence[ControllerRun], values: Mapping[str, Array], ylabel: str) -> Figure:
    """Figure of values (T,) on a logarithmic scale."""
    from adaptctl.recording.drawing import run_style, sheet, thinned

    figure, places = sheet(4.2), color_indices(runs)
    axes = figure.subplots()
    for run in runs:
        if (own := values.get(run.name)) is not None:
            every, place = thinned(len(own), PLOTTED_SAMPLES), places[run.name]
            axes.semilogy(run.rollout.time[every], own[every], label=run.label, **run_style(place))
    axes.set_xlabel("time [s]")
    axes.set_ylabel(ylabel)
    figure.legend(loc="outside upper left", ncols=3)
    return figure
