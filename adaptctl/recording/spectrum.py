"""Spectrum of the energy matrix: singular values against the threshold in their gap."""

from __future__ import annotations

import numpy as np
import rerun as rr

from adaptctl.arrays import Array
from adaptctl.identifiability import EssentialSpace
from adaptctl.recording.palette import MUTED, run_color
from adaptctl.recording.scene import entity

SMALLEST = 1e-18
"""Values below this share of the largest are drawn as this: they are round-off, or zero."""


def shares(space: EssentialSpace) -> Array:
    """Singular values (n,) over the largest one, at least SMALLEST."""
    values = np.asarray(space.singular_values)
    return np.maximum(values / values[0], SMALLEST)


def threshold(space: EssentialSpace) -> float:
    """Geometric mean of the singular values on either side of the gap, over the largest."""
    values = shares(space)
    beyond = values[space.rank] if space.rank < len(values) else SMALLEST
    return float(np.sqrt(values[space.rank - 1] * beyond))


def decades(space: EssentialSpace) -> Array:
    """Powers of ten (n,) by which every singular value lies above the threshold, negative below it."""
    return np.log10(shares(space) / threshold(space))


def log_spectrum(recording: rr.RecordingStream, path: str, space: EssentialSpace) -> None:
    """Draw `decades` as bars below `path`: essential ones blue, the null space's grey."""
    height, rank = decades(space), space.rank
    parts = (("essential", slice(0, rank), run_color(0)), ("null space", slice(rank, len(height)), MUTED))
    for name, part, color in parts:
        starts = np.arange(len(height))[part] + 0.5
        if len(starts):
            bars = rr.BarChart(height[part], abscissa=starts, color=color)
            recording.log(f"{path}/{entity(name)}", bars, static=True)
