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
    """Singular values (P,) of a mechanism's matrix of energy differences between states (rows), by its P inertial
    parameters (columns), each over the largest one, no unit, in falling order; those below 1e-18 are set to that, being
    round-off or zero. `space` is the mechanism's essential space, which has them."""
    values = np.asarray(space.singular_values)
    return np.maximum(values / values[0], SMALLEST)


def threshold(space: EssentialSpace) -> float:
    """Threshold, as a share of the largest, no unit, between those singular values of a mechanism's energy differences
    that count, as many as its inertial parameters are independent, and those that are zero but for round-off: the
    geometric mean of the last that counts and the first that does not, or of the last and 1e-18 where all count.
    `space` is the mechanism's essential space, which has the singular values."""
    values = shares(space)
    beyond = values[space.rank] if space.rank < len(values) else SMALLEST
    return float(np.sqrt(values[space.rank - 1] * beyond))


def decades(space: EssentialSpace) -> Array:
    """Powers of ten (P,), no unit, by which the singular values of a mechanism's matrix of energy differences between
    states (rows), by its P inertial parameters (columns) lie above the threshold between those that count, as many as
    parameters are independent, and round-off; negative below it. `space` is the mechanism's essential space, which has
    the singular values."""
    return np.log10(shares(space) / threshold(space))


def log_spectrum(recording: rr.RecordingStream, path: str, space: EssentialSpace) -> None:
    """Draw the singular values of a mechanism's energy differences, which its essential space `space` has, in a rerun
    recording, the same at all times: bars as high as the powers of ten by which they lie above the threshold between
    those that count, as many as inertial parameters are independent, and round-off. The bars that count are blue, as
    the entity `path`/essential, the others, negative, grey, as `path`/null_space."""
    height, rank = decades(space), space.rank
    parts = (("essential", slice(0, rank), run_color(0)), ("null space", slice(rank, len(height)), MUTED))
    for name, part, color in parts:
        starts = np.arange(len(height))[part] + 0.5
        if len(starts):
            bars = rr.BarChart(height[part], abscissa=starts, color=color)
            recording.log(f"{path}/{entity(name)}", bars, static=True)
