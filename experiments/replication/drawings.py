"""Figures of the replication."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from adaptctl.arrays import Array
from adaptctl.experiments.replication.arms import Arm
from adaptctl.recording.colors import run_color
from adaptctl.recording.drawing import Drawing, sheet

BANDS = "Line: median of the seeds; bands: from the 5th to the 95th percentile, and all; crosses: printed"
PANELS = 3
"""panels per row"""


def bands(
    name: str, caption: str, ylabel: str, panels: Mapping[str, tuple[Array, Mapping[int, float]]], first: int = 0
) -> Drawing:
    """Drawing of positive values of all seeds against the number of components."""

    def draw() -> Figure:
        rows, columns = -(-len(panels) // PANELS), min(len(panels), PANELS)
        figure = sheet(2.3 * rows + 1.1)
        grid = np.ravel(figure.subplots(rows, columns, sharey=True, squeeze=False))
        for axes, (title, (values, printed)) in zip(grid, panels.items(), strict=True):
            place = np.arange(first, first + values.shape[1])
            for outside, alpha in ((0.0, 0.13), (5.0, 0.22)):
                edges = np.percentile(values, [outside, 100.0 - outside], axis=0)
                axes.fill_between(place, *edges, color=run_color(0).hex, alpha=alpha, linewidth=0)
            axes.plot(place, np.median(values, axis=0), color=run_color(0).hex, label="computed")
            for marker, way, label in (("x", 1.0, "printed"), ("v", -1.0, "less than, in the text")):
                points = {s: way * value for s, value in printed.items() if way * value > 0.0}
                axes.plot(list(points), list(points.values()), marker, color=run_color(1).hex, label=label, zorder=5)
            axes.set(title=title, yscale="log")
        figure.supxlabel("number", size=9)
        figure.supylabel(ylabel, size=9)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        return figure

    return Drawing(name, f"{caption}. {BANDS}.", draw)


def torques(name: str, arm: Arm, joint: int, curves: Mapping[str, Array]) -> Drawing:
    """Drawing of Figure 4 or 6."""

    def draw() -> Figure:
        figure = sheet(3.6)
        axes = figure.subplots()
        for i, (label, values) in enumerate(curves.items()):
            axes.plot(arm.motion.time, values, color=run_color(i).hex, linestyle="--" if i == 3 else "-", label=label)
        axes.set(xlabel="time [s]", ylabel=f"torque of joint {joint} [N·m]")
        figure.legend(loc="outside upper left", ncols=2)
        return figure

    caption = "torque along the given sinusoid, with all parameters and with the largest components of the first draw"
    return Drawing(name, f"{name.replace('-', ' ').title()}: {caption}; mean square errors in the legend.", draw)
