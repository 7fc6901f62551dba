"""Noise of measured positions in the accelerations that they give."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identification.filtered_dynamics import MOTION_CUTOFF, SmoothMotion, position_spectrum
from adaptctl.identification.log_checks import LEAST_JUMP
from adaptctl.identification.preparation import whole_ends

# Share of noise in the squares of a joint's accelerations, by which inertias come out too small, that is too much.
MAX_NOISE_SHARE = 0.005


def noise_share(motions: Sequence[SmoothMotion], cutoff: float) -> Array:
    """
    Shares (r,) of the squares of accelerations below a cut-off (Hz) that are noise of positions, the flat part.

    A joint that stands still has nothing else, which says nothing of the others: its share is 0.
    """
    parts = np.zeros((2, motions[0].position.shape[1]))
    for log in (motion.log for motion in motions):
        frequency, power = position_spectrum(log)
        noise = np.median(power[frequency > 0.5 * min(frequency[-1], 2.0 * MOTION_CUTOFF)], axis=0)
        weight = len(log.time) * np.where(frequency <= cutoff, frequency, 0.0)[:, None] ** 4
        parts += [(weight * noise).sum(axis=0), (weight * power).sum(axis=0)]
    least, most = whole_ends([motion.log.position for motion in motions])
    moved = (most - least >= LEAST_JUMP) & (parts[1] > 0.0)
    return np.divide(parts[0], parts[1], out=np.zeros(parts.shape[1]), where=moved)


def clean_cutoffs(motions: Sequence[SmoothMotion], cutoffs: Iterable[float]) -> list[float]:
    """Cut-offs (Hz) below which noise of positions is little, and the least in any case."""
    least, *others = sorted(cutoffs)
    return [least, *(c for c in others if noise_share(motions, c).max() <= MAX_NOISE_SHARE)]
