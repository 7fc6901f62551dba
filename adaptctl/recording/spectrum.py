"""The energy matrix's singular values against the threshold that tells them apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array

if TYPE_CHECKING:
    from adaptctl.identifiability import EssentialSpace

SMALLEST = 1e-18
"""Values below this share of the largest are drawn as this: they are round-off, or zero."""


def shares(space: EssentialSpace) -> Array:
    """Singular values over the largest."""
    values = np.asarray(space.singular_values)
    return np.maximum(values / values[0], SMALLEST)


def threshold(space: EssentialSpace) -> float:
    """The middle of the gap, in powers of ten, as a share of the largest singular value."""
    values = shares(space)
    beyond = values[space.rank] if space.rank < len(values) else SMALLEST
    return float(np.sqrt(values[space.rank - 1] * beyond))


def decades(space: EssentialSpace) -> Array:
    """How many powers of ten every singular value lies above the threshold."""
    return np.log10(shares(space) / threshold(space))
