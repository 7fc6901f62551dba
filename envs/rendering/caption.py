"""Words over a picture."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from adaptctl.recording.drawing import INK, Color

POINT = 100.0 / 72.0
"""Pixels a typographic point."""


class Caption:
    """Text overlay for images of one size: the arm's `name` and a legend of what the colours mean in the upper left
    corner, the time in the upper right. `colors` maps each text of the legend to its `Color` (sRGB); `width` and
    `height` are those of the images, in pixels. Nothing is checked."""

    def __init__(self, name: str, colors: Mapping[str, Color], width: int, height: int) -> None:
        figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100.0)
        figure.patch.set_alpha(0.0)
        self._canvas = FigureCanvasAgg(figure)
        size = 0.026 * height / POINT
        margin, line = 0.035 * height / width, 0.052
        top = 1.0 - 0.035
        figure.text(margin, top, name, size=1.25 * size, weight="bold", color=INK.hex, va="top")
        self._time = figure.text(
            1.0 - margin, top, "", size=1.25 * size, color=INK.hex, va="top", ha="right", family="monospace"
        )
        for i, (meaning, color) in enumerate(colors.items()):
            y = top - line * (i + 1.3)
            figure.text(margin, y, "●", size=size, color=color.hex, va="top")
            figure.text(margin + 0.03, y, meaning, size=size, color=INK.hex, va="top")

    def over(self, picture: NDArray[np.uint8], time: float) -> NDArray[np.uint8]:
        """Copy of the image `picture` (height, width, 3), RGB, uint8, with the text overlay on it: name, legend and the
        `time`, s, with two decimals. Raises `ValueError` for a picture of another size."""
        self._time.set_text(f"{time:.2f} s")
        self._canvas.draw()  # type: ignore[no-untyped-call]
        words = np.asarray(self._canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        opacity = words[..., 3:] / 255.0
        return np.rint(picture + opacity * (words[..., :3] - picture.astype(np.float64))).astype(np.uint8)
