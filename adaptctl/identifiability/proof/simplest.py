"""The rational numbers and quarter turns that floats stand for."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import NamedTuple

MEANT = 1e-11
"""rad, and of the mechanism's length: what is nearer than this to zero or to a right angle is meant to be it. A file
that says 1.57079632679 misses a right angle by 5e-12."""

_DIGITS = 10**12
"""Two lengths or angles are taken for the same number when they agree to about so many parts of one."""


class Turn(NamedTuple):
    """An angle: quarter turns and the tangent of half of what is left, which is at most 45 degrees."""

    quarters: int
    half_tangent: Fraction

    @property
    def cosine_and_sine(self) -> tuple[Fraction, Fraction]:
        """Both, rational, on the unit circle exactly."""
        square = self.half_tangent**2
        c, s = (1 - square) / (1 + square), 2 * self.half_tangent / (1 + square)
        return ((c, s), (-s, c), (-c, -s), (s, -c))[self.quarters]


def simplest_rational(x: float, size: float = 1.0) -> Fraction:
    """The fraction of least denominator within 1e-12 of a size about x: 1/3 for 0.333333333333, 0 for 1e-13.

    Floats that were computed in two ways from the same decimals so become the same number again. By continued
    fractions (Knuth 1998, The Art of Computer Programming 2, section 4.5.3, exercise 39).
    """
    unit = Fraction(10) ** math.floor(math.log10(size)) if size > 0.0 else Fraction(1)
    middle = round(Fraction(x) / unit * 1000 * _DIGITS)
    if abs(middle) <= 1000 * _DIGITS * MEANT:
        return Fraction(0)
    n, d = _simplest(abs(middle) - 1000, abs(middle) + 1000, 1000 * _DIGITS)
    return (n if middle > 0 else -n) * Fraction(1, d) * unit


def turn(angle: float) -> Turn:
    """The angle (rad) that a float stands for."""
    quarters = round(angle / (math.pi / 2))
    rest = angle - quarters * (math.pi / 2)
    near = Fraction(0) if abs(rest) <= MEANT else simplest_rational(math.tan(0.5 * rest))
    return Turn(quarters % 4, near)


def _simplest(low: int, high: int, over: int) -> tuple[int, int]:
    """Numerator and denominator of the simplest fraction between low/over and high/over, both positive."""
    a, b, c, d = low, over, high, over
    before, last = (0, 1), (1, 0)
    while True:
        whole = -(-a // b)
        if whole * d <= c:
            return whole * last[0] + before[0], whole * last[1] + before[1]
        whole -= 1
        before, last = last, (whole * last[0] + before[0], whole * last[1] + before[1])
        a, b, c, d = d, c - whole * d, b, a - whole * b
