"""Figures of reports."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar, Literal, cast

from adaptctl.files import replacing
from adaptctl.recording.colors import AXES, GRID, INK, PAPER, TICKS, run_color
from adaptctl.recording.vector import Sheet
from adaptctl.recording.vector_marks import CURVE_WIDTH, GRID_WIDTH, TEXT_SIZE, TICK_SIZE, TITLE_SIZE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Number of runs whose curves are solid.
NUM_SOLID_CURVES = 5


def run_style(index: int) -> dict[str, Any]:
    """Color and line style of a run's curve: dashed from the sixth on, whose colors are alike."""
    return {"color": run_color(index).hex, "linestyle": "-" if index < NUM_SOLID_CURVES else (0, (4, 2))}


# Width in inches at which the report shows figures.
FIGURE_WIDTH = 9.2
# Width in inches of a column of a paper.
COLUMN_WIDTH = 3.45
# Resolution of figures, and of those for print.
DOTS_PER_INCH, PRINT_DOTS_PER_INCH = 160, 300

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": TEXT_SIZE,
    "text.color": INK.hex,
    "axes.edgecolor": AXES.hex,
    "axes.labelcolor": INK.hex,
    "axes.titlelocation": "left",
    "axes.titlesize": TITLE_SIZE,
    "axes.titleweight": "bold",
    "axes.titlepad": 8.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID.hex,
    "grid.linewidth": GRID_WIDTH,
    "xtick.color": TICKS.hex,
    "ytick.color": TICKS.hex,
    "xtick.labelsize": TICK_SIZE,
    "ytick.labelsize": TICK_SIZE,
    "xtick.major.size": 0.0,
    "ytick.major.size": 0.0,
    "ytick.minor.size": 0.0,
    "lines.linewidth": CURVE_WIDTH,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": TICK_SIZE,
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


_SVG_WIDTH: ContextVar[float | None] = ContextVar("_SVG_WIDTH", default=None)


def is_narrow() -> bool:
    """True while a figure for a phone is drawn: panels stand below each other."""
    return (_SVG_WIDTH.get() or FIGURE_WIDTH) < FIGURE_WIDTH


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
