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
    """Singular values (P,) of the energies of a mechanism's P inertial parameters, each over the largest one, no unit,
    in falling order; those below 1e-18 are set to that, being round-off or zero."""
    values = np.asarray(space.singular_values)
    return np.maximum(values / values[0], SMALLEST)


def threshold(space: EssentialSpace) -> float:
    """Threshold between singular values of the energies that count and those that are zero but for round-off, as a
    share of the largest, no unit: the geometric mean of the last that counts and the first that does not (1e-18 where
    all count)."""
    values = shares(space)
    beyond = values[space.rank] if space.rank < len(values) else SMALLEST
    return float(np.sqrt(values[space.rank - 1] * beyond))


def decades(space: EssentialSpace) -> Array:
    """Powers of ten (P,), no unit, by which the singular values of the energies of a mechanism's P inertial parameters
    lie above the threshold between those that count and round-off; negative below it."""
    return np.log10(shares(space) / threshold(space))


def log_spectrum(recording: rr.RecordingStream, path: str, space: EssentialSpace) -> None:
    """Draw the singular values of the energies of a mechanism's inertial parameters in a rerun recording, the same at
    all times: bars as high as the powers of ten by which they lie above the threshold between those that count and
    round-off. The bars that count are blue, as the entity `path`/essential, the others, negative, grey, as
    `path`/null_space."""
    height, rank = decades(space), space.rank
    parts = (("essential", slice(0, rank), run_color(0)), ("null space", slice(rank, len(height)), MUTED))
    for name, part, color in parts:
        starts = np.arange(len(height))[part] + 0.5
        if len(starts):
            bars = rr.BarChart(height[part], abscissa=starts, color=color)
            recording.log(f"{path}/{entity(name)}", bars, static=True)
