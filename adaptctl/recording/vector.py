"""Figures as SVG, drawn by a few of Matplotlib's methods without its import."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.recording.colors import AXES, GRID, INK, TICKS
from adaptctl.recording.vector_marks import (
    GRID_WIDTH,
    LETTER,
    LINE,
    TEXT_SIZE,
    TICK_SIZE,
    TITLE_SIZE,
    Axis,
    Mark,
    Scale,
    ShadedSpan,
    Words,
    drawn,
    written,
)

POINTS = 72.0
"""Points per inch, the unit of all lengths here."""
STYLE = (
    f"text{{font-family:'DejaVu Sans',sans-serif;fill:{INK.hex}}}.t{{fill:{TICKS.hex}}}.b{{font-weight:bold}}"
    f".g{{stroke:{GRID.hex};stroke-width:{GRID_WIDTH:g}}}.a{{stroke:{AXES.hex};fill:none;stroke-width:.8}}"
)


@dataclass
class Panel:
    """Axes of a sheet."""

    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    marks: list[Mark] = field(default_factory=list)
    spans: list[ShadedSpan] = field(default_factory=list)
    texts: list[Words] = field(default_factory=list)
    title: str = ""
    title_size: float = TITLE_SIZE
    visible: bool = True
    inner_legend: bool = False
    transAxes: str = "shares"

    def plot(self, x: ArrayLike, y: ArrayLike, kind: str = "", **style: Any) -> None:
        """Add a curve, or dots."""
        self.marks.append(Mark(np.asarray(x), np.asarray(y), style, "dots" if kind == "." else "line"))

    def semilogy(self, x: ArrayLike, y: ArrayLike, kind: str = "", **style: Any) -> None:
        """Add a curve on a logarithmic scale."""
        self.set_yscale("log")
        self.plot(x, y, kind, **style)

    def fill_between(self, x: ArrayLike, y: ArrayLike, **style: Any) -> None:
        """Fill the area below a curve."""
        self.marks.append(Mark(np.asarray(x), np.asarray(y), style, "area"))

    def axhline(self, y: float, **style: Any) -> None:
        """Add a horizontal line."""
        self.marks.append(Mark(np.array([-np.inf, np.inf]), np.array([y, y]), style, "level"))

    def axhspan(self, low: float, high: float, color: str, alpha: float, **_: Any) -> None:
        """Shade a horizontal band."""
        self.spans.append(ShadedSpan(np.array([low]), np.array([high]), [color], alpha))

    def bar(self, places: Array, heights: Array, bottom: float, color: Sequence[str], width: float) -> None:
        """Add bars."""
        low = np.full(len(heights), bottom)
        self.spans.append(ShadedSpan(low, low + heights, color, 1.0, np.asarray(places), width))

    def text(self, x: float, y: float, text: str, **style: Any) -> None:
        """Add a text."""
        self.texts.append(Words(x, y, text, style))

    def set_title(self, title: str, size: float = TITLE_SIZE, **_: Any) -> None:
        """Set the title."""
        self.title, self.title_size = title, size

    def set_xlabel(self, name: str) -> None:
        """Name the horizontal axis."""
        self.x.name = name

    def set_ylabel(self, name: str) -> None:
        """Name the vertical axis."""
        self.y.name = name

    def set_xlim(self, low: float, high: float) -> None:
        """Set the ends of the horizontal axis."""
        self.x.low, self.x.high = float(low), float(high)

    def set_ylim(self, low: float | None = None, high: float | None = None, *, bottom: float | None = None) -> None:
        """Set the ends of the vertical axis."""
        self.y.low, self.y.high = bottom if low is None else low, high

    def set_yscale(self, kind: str) -> None:
        """Set the kind of scale."""
        self.y.log = kind == "log"

    def grid(self, visible: bool, axis: str) -> None:
        """Show or hide an axis's grid."""
        getattr(self, axis).grid = visible

    def set_visible(self, visible: bool) -> None:
        """Show or hide the panel."""
        self.visible = visible

    def tick_params(self, labelsize: float | None = None, labelbottom: bool = True, **_: Any) -> None:
        """Set size and presence of ticks' texts."""
        self.x.labelled = self.x.labelled and labelbottom
        self.x.label_size = self.y.label_size = labelsize or self.x.label_size

    def locator_params(self, nbins: int) -> None:
        """Set the largest number of ticks."""
        self.x.most = self.y.most = nbins

    def legend(self, **_: Any) -> None:
        """Show labels within the panel."""
        self.inner_legend = True

    def get_legend_handles_labels(self) -> tuple[list[Mark], list[str]]:
        """Curves with labels, and the labels."""
        marks = [mark for mark in self.marks if mark.label]
        return marks, [mark.label for mark in marks]

    def ranges(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Least and greatest values of both axes."""
        bars = [(span.places, span.high) for span in self.spans if span.places is not None]
        x = [mark.x for mark in self.marks if mark.kind != "level"] + [places for places, _ in bars]
        return self.x.limits(x), self.y.limits([*(mark.y for mark in self.marks), *(high for _, high in bars)])

    def room(self, height: float) -> float:
        """Width of ticks' texts and name beside the panel."""
        ticks = self.y.ticks(*self.ranges()[1], height)
        letters = max((len(text) for _, text in ticks), default=0)
        return 6.0 + LETTER * self.y.label_size * letters + (LINE if self.y.name else 0.0)

    @property
    def below(self) -> float:
        """Height of ticks' texts and name below the panel."""
        return (self.x.label_size + 6.0 if self.x.labelled else 4.0) + (LINE if self.x.name else 0.0)

    def svg(self, left: float, top: float, width: float, height: float) -> str:
        """SVG of the panel in a rectangle."""
        (x0, x1), (y0, y1) = self.ranges()

        def across(x: Array) -> Array:
            return np.clip(width * (x - x0) / (x1 - x0), -width, 2.0 * width)

        def down(y: Array) -> Array:
            return np.clip(height * (y1 - self.y.scaled(y)) / (y1 - y0), -9.0 * height, 10.0 * height)

        given = across, down, width, height
        parts = [f'<g transform="translate({left:.1f} {top:.1f})">', *self._ticks(*given), *self._spans(*given)]
        parts.append(f'<svg width="{width:.1f}" height="{height:.1f}">')
        parts += [drawn(mark, *given) for mark in sorted(self.marks, key=lambda one: one.style.get("zorder", 2))]
        parts += ["</svg>", f'<path class="a" d="M0 0V{height:.1f}H{width:.1f}"/>', *self._words(*given), "</g>"]
        return "\n".join(parts)

    def _spans(self, across: Scale, down: Scale, width: float, height: float) -> Iterable[str]:
        for span in self.spans:
            both = np.clip([down(span.high), down(span.low)], 0.0, height)
            ends = zip(both.min(axis=0), both.max(axis=0), strict=True)
            half = across(np.array([0.5 * span.width]))[0] - across(np.zeros(1))[0] if span.width else 0.0
            middles = np.zeros(1) if span.places is None else across(span.places)
            for middle, (high, low), color in zip(middles, ends, span.colors, strict=True):
                at, wide = (middle - half, 2.0 * half) if span.width else (0.0, width)
                size = f'width="{wide:.1f}" height="{low - high:.1f}" fill="{color}" fill-opacity="{span.alpha:g}"'
                yield f'<rect x="{at:.1f}" y="{high:.1f}" {size}/>'

    def _ticks(self, across: Scale, down: Scale, width: float, height: float) -> Iterable[str]:
        (x0, x1), (y0, y1) = self.ranges()
        size = self.x.label_size
        for place, text in self.x.ticks(x0, x1, 0.6 * width, 2):
            x = width * (place - x0) / (x1 - x0)
            yield f'<path class="g" d="M{x:.1f} 0V{height:.1f}"/>' if self.x.grid else ""
            yield written(x, height + size + 3.0, text, size, "middle", "t") if self.x.labelled else ""
        for place, text in self.y.ticks(y0, y1, height):
            y = height * (y1 - place) / (y1 - y0)
            yield f'<path class="g" d="M0 {y:.1f}H{width:.1f}"/>' if self.y.grid else ""
            yield written(-4.0, y + 0.36 * size, text, size, "end", "t") if self.y.labelled else ""

    def _words(self, across: Scale, down: Scale, width: float, height: float) -> Iterable[str]:
        yield written(0.0, -6.0, self.title, self.title_size, kind="b") if self.title else ""
        if self.x.name:
            yield written(0.5 * width, height + self.below - 3.0, self.x.name, TEXT_SIZE, "middle")
        if self.y.name:
            turned = f"rotate(-90) translate({-0.5 * height:.1f} {-self.room(height) + 9.0:.1f})"
            yield f'<g transform="{turned}">{written(0.0, 0.0, self.y.name, TEXT_SIZE, "middle")}</g>'
        for x, y, text, style in self.texts:
            shares, size = style.get("transform") == self.transAxes, style.get("size", TEXT_SIZE)
            left = width * x if shares else float(across(np.array(x)))
            top = height * (1.0 - y) if shares else float(down(np.array(y)))
            lower, kind = 0.8 * size if style.get("va") == "top" else 0.0, "b" if style.get("weight") else ""
            yield written(left, top + lower, text, size, "end" if style.get("ha") == "right" else "start", kind)
        if self.inner_legend:
            for k, mark in enumerate(self.get_legend_handles_labels()[0]):
                yield written(width - 4.0, 12.0 + LINE * k, f"• {mark.label}", TICK_SIZE, "end")


@dataclass
class Sheet:
    """Figure of panels in rows and columns."""

    width: float
    height: float
    panels: list[list[Panel]] = field(default_factory=list)
    marks: Sequence[Mark] = ()
    legend_columns: int = 1
    name_below: str = ""
    even: bool = field(init=False)

    def subplots(
        self, rows: int = 1, columns: int = 1, *, squeeze: bool = True, sharex: bool = False, **settings: Any
    ) -> Any:
        """Add panels; one, or an array of them."""
        self.even = "gridspec_kw" in settings
        self.panels = [[Panel() for _ in range(columns)] for _ in range(rows)]
        for row in self.panels[:-1] if sharex else ():
            for panel in row:
                panel.x.labelled = False
        found = np.array(self.panels, dtype=object)
        return found if not squeeze else found[0, 0] if found.size == 1 else found.squeeze()

    def legend(self, handles: Sequence[Mark] = (), labels: Sequence[str] = (), *, loc: str = "", ncols: int) -> None:
        """Show labels above the panels."""
        self.marks = handles or self.panels[0][0].get_legend_handles_labels()[0]
        self.legend_columns = ncols

    def supxlabel(self, name: str, **_: Any) -> None:
        """Name the horizontal axes of all panels."""
        self.name_below = name

    def svg(self) -> str:
        """Figure as SVG."""
        wide, high = POINTS * self.width, POINTS * self.height
        self.legend_columns = self._fitting_columns(wide)
        parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide:.1f} {high:.1f}"><style>{STYLE}</style>']
        rows = -(-len(self.marks) // self.legend_columns)
        parts += self._legend(rows, wide)
        parts += self._panels(LINE * rows + 4.0, wide, high - (LINE if self.name_below else 0.0))
        if self.name_below:
            parts.append(written(0.5 * wide, high - 4.0, self.name_below, TEXT_SIZE, "middle"))
        return "\n".join([*filter(None, parts), "</svg>"])

    def _fitting_columns(self, wide: float) -> int:
        """Columns of the legend, as many as there is room for."""
        return max(1, min(self.legend_columns, int(wide / _legend_width(self.marks))))

    def _legend(self, rows: int, wide: float) -> Iterable[str]:
        left = 6.0
        for first in range(0, len(self.marks), rows or 1):
            column = self.marks[first : first + rows]
            for k, mark in enumerate(column):
                y = 9.0 + LINE * k
                yield f'<path d="M{left:.1f} {y - 3.0:.1f}h18" {mark.attributes}/>'
                yield written(left + 23.0, y, mark.label, TICK_SIZE)
            left += _legend_width(column)

    def _panels(self, top: float, wide: float, bottom: float) -> Iterable[str]:
        share = (bottom - top) / max(len(self.panels), 1)
        rooms = [max(row[k].room(0.7 * share) for row in self.panels) for k in range(len(self.panels[0]))]
        rooms = [max(rooms)] * len(rooms) if self.even else rooms
        gap = 10.0
        width = (wide - sum(rooms) - gap * len(rooms)) / len(rooms)
        above = 18.0 if any(panel.title for row in self.panels for panel in row) else 4.0
        belows = [max(panel.below for panel in row) for row in self.panels]
        height = (bottom - top - sum(belows) - above * len(belows)) / len(belows)
        for row, below in zip(self.panels, belows, strict=True):
            left = 0.0
            for panel, room in zip(row, rooms, strict=True):
                left += room
                if panel.visible:
                    yield panel.svg(left, top + above, width, height)
                left += width + gap
            top += above + height + below


def _legend_width(marks: Iterable[Mark]) -> float:
    """Width of a column of a legend."""
    return 38.0 + LETTER * TICK_SIZE * max((len(mark.label) for mark in marks), default=0)
