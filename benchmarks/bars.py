"""The comparisons as bars, on paper of its own so that it reads on light and dark pages alike."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from adaptctl.files import replacing
from adaptctl.recording.colors import INK, MUTED, PAPER, run_color
from benchmarks.findings import Speedup

STYLE: dict[Any, Any] = {"svg.hashsalt": "adaptctl", "svg.fonttype": "none", "font.size": 9.0, "text.color": INK.hex}


def write_bars(path: Path, compared: Sequence[Speedup]) -> None:
    """A bar a comparison: its median, its quartiles, and a mark where it was asked to be."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 0.6 + 0.45 * len(compared)), facecolor=PAPER.hex, layout="constrained")
        axes = figure.subplots()
        _draw(axes, compared)
        with replacing(path) as beside:
            figure.savefig(beside, metadata={"Date": None})


def _draw(axes: Axes, compared: Sequence[Speedup]) -> None:
    for row, one in enumerate(compared):
        ratio = one.ratio
        axes.barh(row, ratio.median, height=0.6, color=run_color(0).hex)
        axes.plot([ratio.lower, ratio.upper], [row, row], color=INK.hex, linewidth=1.5)
        if one.at_least is not None:
            axes.plot([one.at_least] * 2, [row - 0.42, row + 0.42], color=run_color(1).hex, linewidth=2.0)
        at = (max(ratio.median, ratio.upper), row)
        axes.annotate(f"{ratio.median:,.0f}", at, (5, 0), textcoords="offset points", va="center")
    axes.set_yticks(range(len(compared)), [f"{one.what}\nagainst {one.against}".replace("`", "") for one in compared])
    axes.set(xscale="log", xlim=(1.0, 3.0 * max(one.ratio.median for one in compared)), facecolor=PAPER.hex)
    axes.xaxis.set_major_formatter("{x:,.0f}")
    axes.set_title("times faster: median and quartiles; orange: the goal", fontsize=9.0)
    axes.invert_yaxis()
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color=MUTED.hex, alpha=0.3)
    axes.set_axisbelow(True)
