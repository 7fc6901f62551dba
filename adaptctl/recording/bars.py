"""The energy spectrum as bars, in a rerun recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from adaptctl.recording.palette import MUTED, run_color
from adaptctl.recording.scene import entity
from adaptctl.recording.spectrum import decades

if TYPE_CHECKING:
    from adaptctl.identifiability import EssentialSpace


def log_spectrum(recording: rr.RecordingStream, path: str, space: EssentialSpace) -> None:
    """How many powers of ten every singular value lies above the threshold, what counts in blue."""
    height, rank = decades(space), space.rank
    parts = (("essential", slice(0, rank), run_color(0)), ("null space", slice(rank, len(height)), MUTED))
    for name, part, color in parts:
        starts = np.arange(len(height))[part] + 0.5
        if len(starts):
            bars = rr.BarChart(height[part], abscissa=starts, color=color)
            recording.log(f"{path}/{entity(name)}", bars, static=True)
