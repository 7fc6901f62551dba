"""Exponential, logarithm, hyperbolic tangent and arc tangent, by arithmetic and comparisons alone.

So they can be traced, compiled and computed in lanes, where a processor has no such instructions. They are within a
few units in the last place of the exact values: the reductions are Cody and Waite's (1980), the polynomials fdlibm's
(exponential, logarithm) and those of Moshier's Cephes (tangents).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import Any

from adaptctl.scalars.scalar import absolute, clip, maximum, minimum, where

_SHIFT = 1.5 * 2.0**52
"""With this added, a number has no bits for less than 1, so that the sum is the nearest whole number's."""
_LN2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
"""ln 2 is their sum; the first has 33 bits."""
_HALVINGS = (512, 512, 256, 128, 64, 32, 16, 8, 4, 2, 1)
"""Powers of two of which some make any exponent of a double, subnormal ones included."""

_EXP = (
    1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05, -1.65339022054652515390e-06,
    4.13813679705723846039e-08,
)  # fmt: skip
_LOG = (
    6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01, 2.222219843214978396e-01,
    1.818357216161805012e-01, 1.531383769920937332e-01, 1.479819860511658591e-01,
)  # fmt: skip
_TANH = (-1.61468768441708447952e3, -9.92877231001918586564e1, -9.64399179425052238628e-1)
_TANH_BELOW = (4.84406305325125486048e3, 2.23548839060100448583e3, 1.12811678491632931402e2, 1.0)
_ATAN = (
    -6.485021904942025371773e1, -1.228866684490136173410e2, -7.500855792314704667340e1, -1.615753718733365076637e1,
    -8.750608600031904122785e-1,
)  # fmt: skip
_ATAN_BELOW = (
    1.945506571482613964425e2, 4.853903996359136964868e2, 4.328810604912902668951e2, 1.650270098316988542046e2,
    2.485846490142306297962e1, 1.0,
)  # fmt: skip


def exponential(x: Any) -> Any:
    """The exponential e^x of a scalar `x` without unit, by arithmetic and comparisons alone, so that it compiles to
    SIMD instructions. x is a float, an array (elementwise), a dual number or a node of an expression graph. The result
    is right to a few units in the last place: infinity where it exceeds the largest double, 0 below about -745, and NaN
    for NaN. Nothing is raised."""
    x = clip(x, -746.0, 710.0)
    k = (x * (1.0 / math.log(2.0)) + _SHIFT) - _SHIFT
    r = (x - k * _LN2[0]) - k * _LN2[1]
    rest = r - r * r * polynomial(_EXP, r * r)
    scaled, left = 1.0 + (r + r * rest / (2.0 - rest)), absolute(k)
    for bit in _HALVINGS:
        taken = left >= float(bit)
        scaled = scaled * where(taken, where(k >= 0.0, 2.0**bit, 2.0**-bit), 1.0)
        left = left - where(taken, float(bit), 0.0)
    return scaled


def logarithm(x: Any) -> Any:
    """The natural logarithm ln x of a scalar `x` without unit, by arithmetic and comparisons alone, so that it compiles
    to SIMD instructions. x is a float, an array (elementwise), a dual number or a node of an expression graph. The
    result is right to a few units in the last place: minus infinity at 0, infinity at infinity, and NaN for negative
    numbers and NaN. Nothing is raised."""
    m, k = x, 0.0 * x
    for bit in _HALVINGS:
        small, large = m < 2.0 ** (1 - bit), m >= 2.0**bit
        m = m * where(small, 2.0**bit, where(large, 2.0**-bit, 1.0))
        k = k + where(small, -float(bit), where(large, float(bit), 0.0))
    upper = m >= math.sqrt(2.0)
    f, k = m * where(upper, 0.5, 1.0) - 1.0, k + where(upper, 1.0, 0.0)
    s, half = f / (2.0 + f), 0.5 * f * f
    rest = s * (half + s * s * polynomial(_LOG, s * s))
    result = k * _LN2[0] - ((half - (rest + k * _LN2[1])) - f)
    return where(
        x > 0.0, where(x < math.inf, result, math.inf), where(x < 0.0, math.nan, where(x <= 0.0, -math.inf, x))
    )


def hyperbolic_tangent(x: Any) -> Any:
    """The hyperbolic tangent tanh x of a scalar `x` without unit, by arithmetic and comparisons alone, so that it
    compiles to SIMD instructions. x is a float, an array (elementwise), a dual number or a node of an expression graph.
    The result is right to a few units in the last place: a rational function of x for |x| below 0.625, and made of
    exponentials elsewhere; NaN for NaN. Nothing is raised."""
    near = clip(x, -0.625, 0.625)
    z = near * near
    close = near + near * z * (polynomial(_TANH, z) / polynomial(_TANH_BELOW, z))
    far = 1.0 - 2.0 / (exponential(2.0 * minimum(absolute(x), 30.0)) + 1.0)
    return where(absolute(x) < 0.625, close, where(x < 0.0, -far, far))


def arc_tangent(y: Any, x: Any) -> Any:
    """The angle of the point (x, y) from the x axis, in rad, from -pi to pi, by arithmetic and comparisons alone, so
    that it compiles to SIMD instructions. The coordinates `y` and `x`, in one unit, are each a float, an array
    (elementwise), a dual number or a node of an expression graph. The result is right to a few units in the last place:
    0 at the origin, and pi for negative x where y is 0 or -0. Nothing is raised."""
    high, low = maximum(absolute(x), absolute(y)), minimum(absolute(x), absolute(y))
    upper = low > math.tan(math.pi / 8.0) * high
    t = where(upper, low - high, low) / where(upper, low + high, where(high > 0.0, high, 1.0))
    z = t * t
    angle = where(upper, math.pi / 4.0, 0.0) + (t + t * z * (polynomial(_ATAN, z) / polynomial(_ATAN_BELOW, z)))
    angle = where(absolute(y) > absolute(x), math.pi / 2.0 - angle, angle)
    angle = where(x < 0.0, math.pi - angle, angle)
    return where(y < 0.0, -angle, angle)


def polynomial(coefficients: Sequence[float], z: Any) -> Any:
    """The polynomial c_0 + c_1 z + c_2 z^2 + ... of a scalar z (a float, an array, a dual number or a node of an
    expression graph) by Horner's scheme. `coefficients` has the numbers c_0, c_1, ..., from the zeroth power of z on.
    Raises `TypeError` where there are no coefficients."""
    return reduce(lambda higher, c: c + z * higher, reversed(coefficients))
