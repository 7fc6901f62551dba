"""Figures of reports: their style, drawn without a screen and kept as PNG files."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from adaptctl.files import replacing
from adaptctl.recording.palette import INK, PAPER

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 9.2
"""inches; the report shows figures at that width"""
DOTS = 160
"""dots an inch"""

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.color": INK.hex,
    "axes.edgecolor": INK.faded(0.65, PAPER).hex,
    "axes.labelcolor": INK.hex,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlepad": 8.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": INK.faded(0.9, PAPER).hex,
    "grid.linewidth": 0.7,
    "xtick.color": INK.faded(0.3, PAPER).hex,
    "ytick.color": INK.faded(0.3, PAPER).hex,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.size": 0.0,
    "ytick.major.size": 0.0,
    "ytick.minor.size": 0.0,
    "lines.linewidth": 1.5,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "figure.facecolor": PAPER.hex,
    "svg.hashsalt": "adaptctl",
}


@dataclass(frozen=True)
class Drawing:
    """Figure of a report, drawn when it is asked for: its `name`, that of its PNG file without the suffix, its
    `caption` in words, and `draw`, a function without arguments that returns it as a Matplotlib figure. Nothing is
    checked at construction."""

    name: str
    caption: str
    draw: Callable[[], Figure]
    kind: ClassVar[str] = "drawing"


def sheet(height: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """An empty Matplotlib figure for a report, 9.2 inches wide and `height` inches tall, with 160 dots an inch and the
    `layout` of that name of Matplotlib, None for none. Raises `ValueError` for a height that is negative or not
    finite."""
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH, height), dpi=DOTS, layout=layout)


def write_drawings(folder: str | Path, drawings: Iterable[Drawing]) -> dict[str, Path]:
    """Write `drawings` as PNG files into an existing `folder`, each whole or not at all, in the reports' style, and
    return the files' paths by the drawings' names, such as "torque" for torque.png. Raises `FileError` where a file
    cannot be written, and what a drawing's own function raises."""
    import matplotlib as mpl

    written = {}
    for drawing in drawings:
        written[drawing.name] = Path(folder) / f"{drawing.name}.png"
        with mpl.rc_context(STYLE), replacing(written[drawing.name]) as beside:
            figure = drawing.draw()
            figure.savefig(beside, format="png", metadata={"Software": "adaptctl"})
            figure.clear()  # what is drawn holds the figure, and its pixels would stay beside those of the next
    return written


def thinned(samples: int, most: int) -> slice:
    """Slice that takes evenly spaced samples, at most `most` of them, from so many `samples`, beginning with the first;
    all where there are no more than `most`. It is for drawings, which need no more. Raises `ZeroDivisionError` for a
    `most` of 0."""
    return slice(0, samples, max(1, -(-samples // most)))
