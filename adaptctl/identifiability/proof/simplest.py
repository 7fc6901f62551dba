"""The rational numbers and quarter turns that floats stand for."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import NamedTuple

_UNITS = 10**15
"""Parts of one in which floats are read."""


class Precision(NamedTuple):
    """The differences of floats that are taken as zero. `angle`, in rad, is how far from a multiple of a right angle an
    angle counts as one; lengths below `length` times the mechanism's characteristic length (the largest offset from
    joint to joint or to a link's frame) count as zero; numbers of size about one that differ by less than `number`
    count as the same. Nothing is checked."""

    angle: float
    """rad: angles nearer to a right one, or to zero, are meant to be it."""
    length: float
    """Lengths shorter than this, of the mechanism's, are meant to be zero."""
    number: float
    """Numbers about one that differ by less are meant to be the same."""


AS_GIVEN = Precision(1e-11, 1e-11, 1e-12)
"""Round-off. A file that says 1.57079632679 misses a right angle by 5e-12."""
AS_MEANT = Precision(1e-3, 1e-4, 1e-5)
"""What a person who rounds may have meant."""


class Turn(NamedTuple):
    """An angle as exact numbers: `quarters` times 90 degrees plus 2 atan(`half_tangent`), with `quarters` from 0 to 3
    and `half_tangent` a fraction, whose part of the angle is at most 45 degrees in size. Nothing is checked."""

    quarters: int
    half_tangent: Fraction

    @property
    def cosine_and_sine(self) -> tuple[Fraction, Fraction]:
        """The pair of the cosine and the sine of this angle, as fractions whose squares sum to exactly 1."""
        square = self.half_tangent**2
        c, s = (1 - square) / (1 + square), 2 * self.half_tangent / (1 + square)
        return ((c, s), (-s, c), (-c, -s), (s, -c))[self.quarters]


def simplest_rational(x: float, size: float = 1.0, precision: Precision = AS_GIVEN) -> Fraction:
    """The fraction of least denominator near a float `x`: 1/3 for 0.333333333333, 0 for 1e-13.

    `size`, positive and in the unit of x, is the typical size of such values (1 by default). x counts as zero where |x|
    is at most `precision.length` times `size`. Else, with u the power of ten at or below `size`, the result is u times
    the fraction of least denominator that differs from x/u by at most `precision.number`; `precision` is that of
    round-off by default. So floats that were computed in two ways from the same decimals become the same number again.
    By continued fractions (Knuth 1998, The Art of Computer Programming 2, section 4.5.3, exercise 39). Raises
    `ValueError` for NaN, `OverflowError` for infinity.
    """
    return Fraction(0) if abs(x) <= precision.length * size else _near(x, size, precision.number)


def _near(x: float, size: float, distance: float) -> Fraction:
    """The simplest fraction nearer to x, which is not zero, than a distance times a size."""
    unit = Fraction(10) ** math.floor(math.log10(size))
    middle, around = round(Fraction(abs(x)) / unit * _UNITS), round(distance * _UNITS)
    n, d = _simplest(max(middle - around, 1), middle + around, _UNITS)
    return (n if x > 0.0 else -n) * Fraction(1, d) * unit


def turn(angle: float, precision: Precision = AS_GIVEN) -> Turn:
    """An `angle` in rad as exact numbers, a `Turn`: quarter turns alone where it is within `precision.angle` of them
    (1e-11 rad by default), else also the simplest rational half tangent of the rest. Raises `ValueError` for NaN,
    `OverflowError` for infinity."""
    quarters = round(angle / (math.pi / 2))
    rest = angle - quarters * (math.pi / 2)
    small = abs(rest) <= precision.angle
    return Turn(quarters % 4, Fraction(0) if small else _near(math.tan(0.5 * rest), 1.0, precision.number))


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
