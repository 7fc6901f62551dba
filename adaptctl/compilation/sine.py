"""Sine and cosine of an angle at once; LLVM has none in lanes. `sines.ll` turns them by whole quarters."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from adaptctl.compilation.lanes import Precision
from adaptctl.scalars.elementary import polynomial


class Sine(NamedTuple):
    """Constants from which sine and cosine are computed with additions and multiplications alone, in one precision:
    within 2 ulp (units in the last place) in double, in single within 2 ulp of 1.

    `farthest`, rad, is the largest angle, in size, for which they serve; `shift` a number so large that a sum with it
    is rounded to a whole number; `quarter` three numbers whose sum is pi/2, the first two with so few bits that small
    multiples are exact; `sine` the coefficients of (sin r - r)/r^3 and `cosine` those of (cos r - 1 + r^2/2)/r^4 as
    polynomials in r^2, from the constant on, for an angle r within pi/4. Nothing is checked.
    """

    farthest: float
    """rad; up to here `reduced` holds"""
    shift: float
    """With this added, a number has no bits for less than 1, so that the sum is the nearest whole number's."""
    quarter: tuple[float, float, float]
    """pi/2 is their sum; the first two have so few bits that k times them is exact, fused or not."""
    sine: tuple[float, ...]
    """(sin r - r) / r^3 in powers of r^2"""
    cosine: tuple[float, ...]
    """(cos r - 1 + r^2/2) / r^4 in powers of r^2"""

    def reduced(self, x: Any) -> tuple[Any, Any, Any]:
        """Sine and cosine of r, and k + `shift`, for an angle `x` = k pi/2 + r, rad, with k whole and r from -pi/4 to
        pi/4: three scalars. `shift` is the constant of that name (1.5 * 2^52 in double precision, 1.5 * 2^23 in
        single), so large that a sum with it is rounded to a whole number: the last bits of k + `shift` are those of k,
        and tell sign and exchange of sine and cosine of `x` itself. `x`, a scalar of any kind (float, array or symbol),
        is at most the constant `farthest` in size (2^20 rad in double, 2^13 rad in single), which is not checked.

        r is found by subtracting k pi/2 in three parts (Cody and Waite 1980).
        """
        first, second, third = self.quarter
        shifted = x * (2.0 / math.pi) + self.shift
        k = shifted - self.shift
        r = ((x - k * first) - k * second) - k * third
        z = r * r
        return r + r * z * polynomial(self.sine, z), (1.0 - 0.5 * z) + z * z * polynomial(self.cosine, z), shifted

    def turned(self, sine: Any, cosine: Any, step: Any) -> tuple[Any, Any]:
        """Sine and cosine of an angle that is `step` larger than the one whose `sine` and `cosine` are given: two
        scalars of any kind (floats, arrays or symbols). `step`, rad, is at most 1/16 (STEP) in size, which is not
        checked."""
        z = step * step
        of_step = step + step * z * polynomial(self.sine[:TERMS], z)
        less = z * (0.5 - z * polynomial(self.cosine[:TERMS], z))  # 1 less the step's cosine
        return sine + (cosine * of_step - sine * less), cosine - (sine * of_step + cosine * less)


STEP = 2.0**-4
"""rad; a step in time seldom turns a joint farther"""

TERMS = 3
"""Coefficients that a step needs, of each polynomial: the next are below 5e-17 there."""


DOUBLE = Sine(
    2.0**20,
    1.5 * 2.0**52,
    (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
    (
        -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
        2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
    ),
    (
        4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
        -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
    ),
)  # fmt: skip
"""fdlibm's polynomials; pi/2 to 150 bits, 33 in each of its first two parts"""

SINGLE = Sine(
    2.0**13,
    1.5 * 2.0**23,
    (1.5703125, 4.837512969970703125e-4, 7.54978995489188216e-8),
    (-1.6666654611e-1, 8.3321608736e-3, -1.9515295891e-4),
    (4.166664568298827e-2, -1.388731625493765e-3, 2.443315711809948e-5),
)
"""Cephes' polynomials and parts of pi/2"""


def sine_for(precision: Precision) -> Sine:
    """The `Sine`, the constants for computing sine and cosine, of a `precision`: "double", or for anything else single
    precision. Nothing is raised."""
    return DOUBLE if precision == "double" else SINGLE
