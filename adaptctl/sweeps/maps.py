"""Figures of a sweep: the error, and the share of runs that were stable, over two settings."""

from __future__ import annotations

import base64
import io
from typing import Any, NamedTuple

from adaptctl.arrays import Array
from adaptctl.recording.page import Figure


class SettingsMap(NamedTuple):
    """Map of the outcomes of a sweep's runs over two of its settings, named `x` and `y`. `across` (c,) and `down` (d,)
    have c values of x and d of y, in ascending order, or the lower ends of bins of them. `error` (d, c) has root mean
    square errors of joint positions, rad or m, over the last two seconds (over all of a shorter run), as their mean
    over the runs of status "done"; `stable` (d, c) has the fraction of runs of status "done", 0 to 1; NaN where there
    are none. Nothing is checked."""

    x: str
    y: str
    across: list[Any]
    """values of x, or the lower ends of its bins"""
    down: list[Any]
    error: Array
    """at the end of the runs"""
    stable: Array
    """fraction of runs that were done"""


def map_figure(controller: str, shown: SettingsMap) -> Figure:
    """Figure for a report, a `Figure` of caption and PNG: the two maps in `shown` side by side, that of root mean
    square position errors, rad or m, and that of the fraction of stable runs, those of status "done". `controller` is
    the name of the controller whose runs these are, with which the caption begins. Nothing is checked."""
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(10.0, 3.8), layout="constrained")
    titles = ("error at the end, rad or m", "share of stable runs")
    for axes, values, title in zip(canvas.subplots(1, 2), (shown.error, shown.stable), titles, strict=True):
        shares = {"vmin": 0.0, "vmax": 1.0} if title.startswith("share") else {}
        image = axes.imshow(values, origin="lower", aspect="auto", cmap="viridis", **shares)
        axes.set_xticks(range(len(shown.across)), [f"{value:.3g}" for value in shown.across], rotation=45)
        axes.set_yticks(range(len(shown.down)), [f"{value:.3g}" for value in shown.down])
        axes.set(xlabel=shown.x, ylabel=shown.y, title=title)
        canvas.colorbar(image, ax=axes)
    data = io.BytesIO()
    canvas.savefig(data, format="png", dpi=110)
    caption = f"{controller}: {shown.x} and {shown.y}"
    return Figure(caption, base64.b64encode(data.getvalue()).decode("ascii"))
