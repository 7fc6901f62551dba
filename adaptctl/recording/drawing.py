"""Figures of reports: their style, drawn without a screen and kept as PNG files."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from adaptctl.files import replacing

if TYPE_CHECKING:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure


class Color(NamedTuple):
    """An sRGB colour: `red`, `green` and `blue`, whole numbers from 0 to 255, which are not checked."""

    red: int
    green: int
    blue: int

    @property
    def hex(self) -> str:
        """Hexadecimal text of the colour, as HTML and Matplotlib take it, such as "#1b6cd6"."""
        return f"#{self.red:02x}{self.green:02x}{self.blue:02x}"

    def faded(self, share: float, towards: Color) -> Color:
        """Mixture of this colour with the colour `towards`, channel by channel, rounded: a fraction `share` of 0 gives
        this colour, 1 gives `towards`. Nothing is checked."""
        return Color(*(round(mine + share * (other - mine)) for mine, other in zip(self, towards, strict=True)))


INK = Color(28, 34, 48)
"""Text and axes on paper."""
PAPER = Color(255, 255, 255)
DARK = Color(13, 13, 13)
"""The background of curves in a recording."""
MUTED = Color(120, 129, 146)
"""Colour of what is there for comparison only."""


def _palette(colors: str) -> tuple[Color, ...]:
    """Colours of a text of hexadecimal ones, apart by blanks."""
    return tuple(Color(*bytes.fromhex(color)) for color in colors.split())


RUNS = _palette(
    "1b6cd6 e86e1c 189270 9654be 788192 c83e6e 8c6e32 3ca0be 7ab02a "
    "d6a414 604ebe ec82b4 147080 b02c24 82aae8 f69c7c 467c3e c46ede"
)
"""One a controller: the adaptive one is blue, the same with adaptation off orange, the others follow in their order."""

SOLID = 5
"""runs whose curves are solid"""

JOINTS = _palette("2d7deb f08228 28aa6e e14b5f 9b69e1 aa8737 23afc3 d75faf 8296b4 96be3c")
"""One a joint; bright enough for a dark screen, dark enough for paper."""

GOAL = Color(150, 240, 205)
"""The desired arm and its positions; paler than any joint's green."""
LIMIT = Color(205, 208, 214)
"""Limits of torques."""
TRUTH = INK
"""True values, where each has a picture of its own."""
BODY = Color(226, 230, 238)
"""The arm's links."""
BASE = Color(96, 104, 120)
"""Colour of what stands still."""


def run_color(index: int) -> Color:
    """The colour, in recordings and reports, of the run of zero-based `index`: blue for 0, the run that a comparison is
    about, orange for 1, that with adaptation off, then others. There are 18, which then repeat. Nothing is checked."""
    return RUNS[index % len(RUNS)]


def run_style(index: int) -> dict[str, Any]:
    """Colour and line style, keywords of Matplotlib's, of the curve of the run of zero-based `index`: dashed from the
    sixth on, whose colours are harder to tell apart. Nothing is checked."""
    return {"color": run_color(index).hex, "linestyle": "-" if index < SOLID else (0, (4, 2))}


def joint_color(index: int) -> Color:
    """The colour, in recordings and reports, of the joint, or curve, of zero-based `index`. There are 10, which then
    repeat. Nothing is checked."""
    return JOINTS[index % len(JOINTS)]


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
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    written = {}
    for drawing in drawings:
        written[drawing.name] = Path(folder) / f"{drawing.name}.png"
        with mpl.rc_context(STYLE), replacing(written[drawing.name]) as beside:
            _draw_once(canvas := FigureCanvasAgg(drawing.draw()), beside)
            canvas.renderer = None  # axes hold their figure, and its pixels would stay beside those of the next
    return written


def _draw_once(canvas: FigureCanvasAgg, path: Path) -> None:
    """Write a figure as PNG; `savefig` would lay it out, which costs most of it, twice."""
    if layout := canvas.figure.get_layout_engine():
        layout.execute(canvas.figure)
        canvas.figure.set_layout_engine("none")
    canvas.print_png(path, metadata={"Software": "adaptctl"})  # type: ignore[no-untyped-call]  # Matplotlib has no types


def thinned(samples: int, most: int) -> slice:
    """Slice that takes evenly spaced samples, at most `most` of them, from so many `samples`, beginning with the first;
    all where there are no more than `most`. It is for drawings, which need no more. Raises `ZeroDivisionError` for a
    `most` of 0."""
    return slice(0, samples, max(1, -(-samples // most)))
