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
    """Normalised singular values (P,) of a mechanism's matrix of energy differences between states (rows), by its P
    inertial parameters (columns): sigma_i/sigma_1, no unit, in descending order. Those below 1e-18, which are round-off
    or zero, are set to 1e-18. `space` is the mechanism's essential space (directions of the parameters that change
    energies), which has the singular values. Nothing is raised."""
    values = np.asarray(space.singular_values)
    return np.maximum(values / values[0], SMALLEST)


def threshold(space: EssentialSpace) -> float:
    """Threshold, no unit, between the normalised singular values of a mechanism's energy differences that count and
    those that are zero but for round-off: sqrt(s_k s_(k+1)). Here s_i = sigma_i/sigma_1 are the singular values over
    the largest, in descending order and at least 1e-18, and k is the number of independent inertial parameters; s_(k+1)
    is 1e-18 where all count. `space` is the mechanism's essential space (directions of the parameters that change
    energies), which has the singular values sigma_i. Nothing is raised."""
    values = shares(space)
    beyond = values[space.rank] if space.rank < len(values) else SMALLEST
    return float(np.sqrt(values[space.rank - 1] * beyond))


def decades(space: EssentialSpace) -> Array:
    """Powers of ten (P,), no unit, by which the singular values of a mechanism's matrix of energy differences between
    states (rows), by its P inertial parameters (columns), lie above a threshold in their gap: log10(s_i / sqrt(s_k
    s_(k+1))). Here s_i = sigma_i/sigma_1 are the singular values over the largest, in descending order and at least
    1e-18, and k is the number of independent parameters; s_(k+1) is 1e-18 where k = P. The first k are positive, the
    others negative. `space` is the mechanism's essential space (directions of the parameters that change energies),
    which has the singular values. Nothing is raised."""
    return np.log10(shares(space) / threshold(space))


def log_spectrum(recording: rr.RecordingStream, path: str, space: EssentialSpace) -> None:
    """Draw the singular values of a mechanism's energy differences as bars in a rerun recording, the same at all times.
    A bar's height, no unit, is the power of ten by which its singular value lies above a threshold: that between the
    first k, k being the number of independent inertial parameters, and the others, which are round-off. The first k
    bars, positive, are blue, as the entity `path`/essential; the others, negative, are grey, as `path`/null_space.
    `space` is the mechanism's essential space (directions of the parameters that change energies), which has the
    singular values. Nothing is raised."""
    height, rank = decades(space), space.rank
    parts = (("essential", slice(0, rank), run_color(0)), ("null space", slice(rank, len(height)), MUTED))
    for name, part, color in parts:
        starts = np.arange(len(height))[part] + 0.5
        if len(starts):
            bars = rr.BarChart(height[part], abscissa=starts, color=color)
            recording.log(f"{path}/{entity(name)}", bars, static=True)
