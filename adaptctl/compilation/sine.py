"""Sine and cosine of an angle at once, from arithmetic that every kind of scalar has; LLVM has none in lanes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import Any

from adaptctl.scalars import absolute, where

FARTHEST = 2.0**20
"""rad; up to here `sine_and_cosine` holds."""

_QUARTER = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
"""pi/2 is their sum, to 150 bits."""

_SINE = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
"""(sin r - r) / r^3 in powers of r^2"""

_COSINE = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip
"""(cos r - 1 + r^2/2) / r^4 in powers of r^2"""


def sine_and_cosine(x: Any) -> tuple[Any, Any]:
    """Both within 2 ulp for |x| up to FARTHEST, in rad.

    x is k quarter turns and a rest r in [-pi/4, pi/4]. The quarter is subtracted in three parts; the first two
    have 33 bits, so that k times them is exact (Cody and Waite 1980). The polynomials are fdlibm's.
    """
    first, second, third = _QUARTER
    k = _nearest(x * (2.0 / math.pi))
    left = x - k * first
    rest = left - k * second
    r = rest + (((left - rest) - k * second) - k * third)
    z = r * r
    sine, cosine = r + r * z * _polynomial(_SINE, z), (1.0 - 0.5 * z) + z * z * _polynomial(_COSINE, z)
    return _turned(k, sine, cosine)


def _turned(k: Any, sine: Any, cosine: Any) -> tuple[Any, Any]:
    """Sine and cosine after k quarter turns.

    `odd` is 1 or -1 for an odd k, as k modulo 4, since ties round to an even number of half turns.
    """
    half = _nearest(0.5 * k)
    odd, sign = k - 2.0 * half, 1.0 - 2.0 * absolute(half - 2.0 * _nearest(0.5 * half))
    even = absolute(odd) < 0.5
    return where(even, sign * sine, odd * cosine), where(even, sign * cosine, -odd * sine)


def _nearest(x: Any) -> Any:
    """The nearest whole number, the even one of two: the sum has no bits for less."""
    return (x + 1.5 * 2.0**52) - 1.5 * 2.0**52


def _polynomial(coefficients: Sequence[float], z: Any) -> Any:
    return reduce(lambda higher, c: c + z * higher, reversed(coefficients))
