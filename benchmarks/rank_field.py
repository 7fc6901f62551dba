"""The prime field that the exact oracle reckons in."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

FIELD = 2**61 - 1


def residue(x: Fraction) -> int:
    """A fraction modulo the prime."""
    return x.numerator * pow(x.denominator, -1, FIELD) % FIELD


def circle(t: Any) -> tuple[Any, Any]:
    """Cosines and sines of half tangents."""
    over = np.array([pow(int(y), -1, FIELD) for y in (1 + t * t) % FIELD], dtype=object)
    return (1 - t * t) * over % FIELD, 2 * t * over % FIELD


def turned_on(one: Any, other: Any) -> tuple[Any, Any]:
    """Cosines and sines of the sum of two angles."""
    (a, b), (c, d) = one, other
    return (a * c - b * d) % FIELD, (a * d + b * c) % FIELD


def times(turn: Any, count: int) -> tuple[Any, Any]:
    """Cosines and sines of a whole multiple of an angle."""
    forth = turn if count >= 0 else (turn[0], -turn[1] % FIELD)
    out = (1 + 0 * turn[0], 0 * turn[0])
    for _ in range(abs(count)):
        out = turned_on(out, forth)
    return out
