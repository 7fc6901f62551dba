"""Figures of reports."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, cast

from adaptctl.files import replacing
from adaptctl.recording.vector import Sheet

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Color(NamedTuple):
    """Color of red, green and blue, 0 to 255."""

    red: int
    green: int
    blue: int

    @property
    def hex(self) -> str:
        """Hexadecimal text of the color, such as "#1b6cd6"."""
        return f"#{self.red:02x}{self.green:02x}{self.blue:02x}"

    def faded(self, share: float, towards: Color) -> Color:
        """Mixture with another color, of which 1 gives the other."""
        return Color(*(round(mine + share * (other - mine)) for mine, other in zip(self, towards, strict=True)))


# Text and axes on paper.
INK = Color(28, 34, 48)
PAPER = Color(255, 255, 255)
# The background of curves in a recording.
DARK = Color(13, 13, 13)
# Colour of what is there for comparison only.
MUTED = Color(120, 129, 146)


def _palette(colors: str) -> tuple[Color, ...]:
    return tuple(Color(*bytes.fromhex(color)) for color in colors.split())


# Colors of controllers: the adaptive one is blue, the same with adaptation off orange, others follow.
RUN_COLORS = _palette(
    "1b6cd6 e86e1c 189270 9654be 788192 c83e6e 8c6e32 3ca0be 7ab02a "
    "d6a414 604ebe ec82b4 147080 b02c24 82aae8 f69c7c 467c3e c46ede"
)

# Number of runs whose curves are solid.
NUM_SOLID_CURVES = 5

# Colors of joints, bright enough for a dark screen, dark enough for paper.
JOINT_COLORS = _palette("2d7deb f08228 28aa6e e14b5f 9b69e1 aa8737 23afc3 d75faf 8296b4 96be3c")

# The desired arm and its positions; paler than any joint's green.
GOAL = Color(150, 240, 205)
# Limits of torques.
LIMIT = Color(205, 208, 214)
# Force on the arm.
FORCE = Color(255, 205, 70)
# True values, where each has a picture of its own.
TRUTH = INK
# The arm's links.
BODY = Color(226, 230, 238)
# Colour of fixed links.
BASE = Color(96, 104, 120)


def run_color(index: int) -> Color:
    """Color of a run by its index: blue for the subject, orange without adaptation."""
    return RUN_COLORS[index % len(RUN_COLORS)]


def run_style(index: int) -> dict[str, Any]:
    """Color and line style of a run's curve: dashed from the sixth on, whose colors are alike."""
    return {"color": run_color(index).hex, "linestyle": "-" if index < NUM_SOLID_CURVES else (0, (4, 2))}


def joint_color(index: int) -> Color:
    """Color of a joint by its index."""
    return JOINT_COLORS[index % len(JOINT_COLORS)]


# Width in inches at which the report shows figures.
FIGURE_WIDTH = 9.2
# Width in inches of a column of a paper.
COLUMN_WIDTH = 3.45
# Resolution of figures, and of those for print.
DOTS_PER_INCH, PRINT_DOTS_PER_INCH = 160, 300

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
    """Figure of a report: its name, caption and the function that draws it; `plain` if a `Sheet` has its methods."""

    name: str
    caption: str
    draw: Callable[[], Figure]
    plain: bool = False
    kind: ClassVar[str] = "drawing"

    def svg(self, width: float = FIGURE_WIDTH) -> str:
        """Figure as SVG, of a plain drawing, its width in inches."""
        token = _SVG_WIDTH.set(width)
        try:
            return cast("Sheet", self.draw()).svg()
        finally:
            _SVG_WIDTH.reset(token)


_SVG_WIDTH = ContextVar("_SVG_WIDTH", default=0.0)


def is_narrow() -> bool:
    """True while a figure for a phone is drawn: panels stand below each other."""
    return 0.0 < _SVG_WIDTH.get() < FIGURE_WIDTH


def sheet(height: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """Empty figure for a report, 9.2 inches wide, or as narrow as a phone."""
    if width := _SVG_WIDTH.get():
        return cast("Figure", Sheet(width, height))
    from matplotlib.figure import Figure

    return Figure(figsize=(FIGURE_WIDTH, height), dpi=DOTS_PER_INCH, layout=layout)


def write_drawings(folder: str | Path, drawings: Iterable[Drawing]) -> dict[str, Path]:
    """Write drawings as PNG files; their paths by name."""
    written = {}
    for drawing in drawings:
        written[drawing.name] = Path(folder) / f"{drawing.name}.png"
        with replacing(written[drawing.name]) as beside:
            _write_png(drawing, beside)
    return written


PAPER_STYLE: dict[Any, Any] = {
    "font.size": 7.5,
    "axes.labelsize": 8.0,
    "axes.titlesize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "pdf.fonttype": 42,
}


UNDATED: dict[str, dict[str, Any]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {}}


def write_for_paper(folder: str | Path, drawings: Iterable[Drawing]) -> list[Path]:
    """Write drawings a column wide as PDF, SVG and PNG files that are the same whenever they are written."""
    return _written(Path(folder), drawings, {**STYLE, **PAPER_STYLE}, UNDATED)


def write_figures(folder: str | Path, drawings: Sequence[Drawing]) -> None:
    """Write drawings as PNG files, and as PDF and SVG files for texts."""
    write_drawings(folder, drawings)
    _written(Path(folder), drawings, STYLE, ("pdf", "svg"))


def _written(folder: Path, drawings: Iterable[Drawing], style: dict[Any, Any], kinds: Iterable[str]) -> list[Path]:
    import matplotlib as mpl

    written = []
    with mpl.rc_context(style):
        for drawing in drawings:
            figure = drawing.draw()
            _lay_out(figure)
            for kind in kinds:
                written.append(folder / f"{drawing.name}.{kind}")
                with replacing(written[-1]) as beside:
                    figure.savefig(beside, format=kind, dpi=PRINT_DOTS_PER_INCH, metadata=UNDATED[kind])
    return written


def data_urls(drawings: Iterable[Drawing]) -> dict[str, str]:
    """URLs of drawings by name that contain them: SVG if plain, else PNG."""
    found = {}
    with TemporaryDirectory() as folder:
        for drawing in drawings:
            if drawing.plain:
                found[drawing.name] = data_url("image/svg+xml", drawing.svg().encode())
            else:
                found |= png_urls(write_drawings(folder, [drawing]))
    return found


def narrow_urls(drawings: Iterable[Drawing]) -> dict[str, str]:
    """URLs by name that contain plain drawings as wide as a phone, in SVG."""
    return {
        drawing.name: data_url("image/svg+xml", drawing.svg(COLUMN_WIDTH).encode())
        for drawing in drawings
        if drawing.plain
    }


def png_urls(figures: Mapping[str, Path]) -> dict[str, str]:
    """URLs by name that contain PNG files."""
    return {name: data_url("image/png", file.read_bytes()) for name, file in figures.items()}


def data_url(kind: str, content: bytes) -> str:
    """URL that contains a file of a MIME type."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _write_png(drawing: Drawing, path: Path) -> None:
    """Write a drawing as PNG; `savefig` would lay it out, which costs most of it, twice."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with mpl.rc_context(STYLE):
        canvas = FigureCanvasAgg(drawing.draw())
        _lay_out(canvas.figure)
        canvas.print_png(path, metadata={"Software": "adaptctl"})  # type: ignore[no-untyped-call]  # Matplotlib has no types
        canvas.renderer = None  # axes hold their figure, and its pixels would stay beside those of the next


def _lay_out(figure: Figure) -> None:
    """Lay a figure out, once for all that is made of it."""
    if layout := figure.get_layout_engine():
        layout.execute(figure)
        figure.set_layout_engine("none")


def thinned(samples: int, most: int) -> slice:
    """Slice of evenly spaced samples, at most `most`, for drawings."""
    return slice(0, samples, max(1, -(-samples // most)))
