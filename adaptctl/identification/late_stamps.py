"""Stamps that are those of a late clock, beside samples that are even in time."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.logs.on_disk import each_column

# Squares of positions' third differences as samples follow each other, over those at their stamps, below which these
# are wrong; and samples that are compared.
MAX_ROUGHNESS, COMPARED = 0.1, 2**17


def are_even(position: Array, stamps: Array, even: Array) -> bool:
    """True if most positions (n, r) are far smoother at even times (n,) than at their stamps (n,)."""
    here = slice(COMPARED)
    moved = [own for own in each_column(position[here]) if np.ptp(own) > 0.0]
    pairs = [np.array([own, np.interp(even[here], stamps[here], own)]) for own in moved]
    ratios = [np.square(np.diff(both, 3)).sum(axis=1) for both in pairs]
    return bool(ratios) and float(np.median([own / (other or 1.0) for own, other in ratios])) < MAX_ROUGHNESS
