"""Curves, areas, texts and axes of figures as SVG."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array

TEXT_SIZE, TICK_SIZE, TITLE_SIZE = 9.0, 8.0, 9.5
CURVE_WIDTH, GRID_WIDTH = 1.5, 0.7
LETTER = 0.6
"""Width of a letter over its height, about."""
LINE = 14.0
"""Height of a line of text."""
COLUMNS_PER_POINT = 1.0
"""Columns in which a curve's least and largest sample are drawn."""
MARGIN = 0.05
"""Share of its values' range by which an axis is longer."""
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Mark(NamedTuple):
    """Curve, dots or area of a panel."""

    x: Array
    y: Array
    style: dict[str, Any]
    kind: str = "line"

    @property
    def label(self) -> str:
        """Text in a legend."""
        return str(self.style.get("label", ""))

    @property
    def attributes(self) -> str:
        """SVG attributes of the curve."""
        width, dash = self.style.get("linewidth", CURVE_WIDTH), self.style.get("linestyle", "-")
        dashes = "" if dash == "-" else f' stroke-dasharray="{" ".join(f"{width * x:g}" for x in dash[1])}"'
        return f'fill="none" stroke="{self.style["color"]}" stroke-width="{width:g}" stroke-linejoin="round"{dashes}'


class Words(NamedTuple):
    """Text in a panel, at its place in shares of the panel or in data."""

    x: float
    y: float
    text: str
    style: dict[str, Any]


class ShadedSpan(NamedTuple):
    """Horizontal band, or bars where it has widths."""

    low: Array
    high: Array
    colors: Sequence[str]
    alpha: float
    places: Array | None = None
    width: float = 0.0


@dataclass
class Axis:
    """Range and ticks of an axis."""

    low: float | None = None
    high: float | None = None
    log: bool = False
    name: str = ""
    labelled: bool = True
    label_size: float = TICK_SIZE
    most: int = 9
    grid: bool = True

    def limits(self, values: Iterable[Array]) -> tuple[float, float]:
        """Least and greatest value, logarithms on a logarithmic axis."""
        parts = [self.scaled(part) for part in values]
        joined = np.concatenate([part[np.isfinite(part)] for part in parts] or [np.empty(0)])
        least, most = (float(joined.min()), float(joined.max())) if len(joined) else (0.0, 1.0)
        room = MARGIN * (most - least) or MARGIN * abs(most) or 1.0
        low, high = (None if end is None else float(self.scaled(np.array(end))) for end in (self.low, self.high))
        return least - room if low is None else low, most + room if high is None else high

    def scaled(self, values: Array) -> Array:
        """Values, or their logarithms; NaN where they have none."""
        if not self.log:
            return np.asarray(values, dtype=np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(np.asarray(values) > 0.0, np.log10(values), np.nan)

    def ticks(self, low: float, high: float, length: float, least: int = 4) -> list[tuple[float, str]]:
        """Places and texts of ticks."""
        most = max(least, min(self.most, int(length / (2.5 * self.label_size))))
        step = max(1.0, math.ceil((high - low) / most)) if self.log else nice(high - low, most)
        places = [step * k for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]
        return [(place, power(place) if self.log else plain(place)) for place in places]


def nice(length: float, most: int) -> float:
    """Least round step that divides a length into at most that many parts."""
    least = length / most
    decade = 10.0 ** math.floor(math.log10(least))
    return next(decade * digit for digit in (1.0, 2.0, 2.5, 5.0, 10.0) if decade * digit >= least * (1.0 - 1e-9))


def plain(value: float) -> str:
    """Text of a number."""
    mantissa, _, exponent = f"{value:.6g}".partition("e")
    return (mantissa + (f"e{int(exponent)}" if exponent else "")).replace("-", "−")


def power(exponent: float) -> str:
    """Text of a power of ten."""
    return f"10{f'{exponent:.0f}'.translate(SUPERSCRIPTS)}"


def written(x: float, y: float, text: str, size: float, anchor: str = "start", kind: str = "") -> str:
    """SVG of a text."""
    style = f' class="{kind}"' if kind else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" text-anchor="{anchor}"{style}>{escape(text)}</text>'


def thinned(x: Array, y: Array, width: float) -> tuple[Array, Array]:
    """Curve by the least and largest of each of many columns of samples."""
    columns = int(COLUMNS_PER_POINT * width)
    if len(x) <= 4 * columns:
        return x, y
    rows = len(x) // columns
    end, known = rows * (len(x) // rows), np.isfinite(y)
    low, high = (np.where(known, y, other)[:end].reshape(-1, rows) for other in (np.inf, -np.inf))
    both = np.sort(np.stack((low.argmin(axis=1), high.argmax(axis=1)), axis=1), axis=1)
    chosen = (both + rows * np.arange(len(low))[:, None]).ravel()
    chosen = np.unique(np.concatenate((chosen, np.flatnonzero(~known), [0, len(x) - 1])))
    return x[chosen], y[chosen]


Scale = Callable[[Array], Array]


def drawn(mark: Mark, across: Scale, down: Scale, width: float, height: float) -> str:
    """SVG of a curve, dots or an area."""
    if mark.kind == "level":
        y, _ = down(mark.y)
        return f'<path d="M0 {y:.1f}H{width:.1f}" {mark.attributes}/>'
    places, heights = across(mark.x), down(mark.y)
    if mark.kind == "dots":
        return _dots(places, heights, mark.style)
    path = _path(*thinned(places, heights, width))
    if mark.kind == "line":
        return f'<path d="{path}" {mark.attributes}/>'
    ends = f"V{height:.1f}H{places[0]:.1f}Z" if path else ""
    return f'<path d="{path}{ends}" fill="{mark.style["color"]}" fill-opacity="{mark.style["alpha"]:g}"/>'


def _dots(x: Array, y: Array, style: dict[str, Any]) -> str:
    known = _known(x, y)
    there = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x[known], y[known], strict=True))
    width = 0.6 * style.get("markersize", 6.0)
    return f'<path d="{there}" stroke="{style["color"]}" stroke-width="{width:g}" stroke-linecap="round"/>'


def _path(x: Array, y: Array) -> str:
    """SVG path of a curve, interrupted where it is not finite."""
    known = _known(x, y)
    breaks = [0, *(np.flatnonzero(np.diff(known)) + 1), len(x)]
    points = np.column_stack((x, y))
    return "".join(_points(points[a:b]) for a, b in pairwise(breaks) if b > a and known[a])


def _points(points: Array) -> str:
    """SVG of a curve through points (n, 2), formatted at once, which takes two thirds of the time."""
    return "M" + " ".join(["%.1f %.1f"] * len(points)) % tuple(points.ravel().tolist())


def _known(x: Array, y: Array) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite((x, y)).all(axis=0))
