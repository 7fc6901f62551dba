"""Sine and cosine of an angle at once; LLVM has none in lanes. `sincos.ll` turns them by whole quarters."""

from __future__ import annotations

import math
from typing import Any

from adaptctl.scalars.elementary import polynomial

FARTHEST = 2.0**20
"""rad; up to here `reduced` holds."""

_SHIFT = 1.5 * 2.0**52
"""With this added, a number has no bits for less than 1, so that the sum is the nearest whole number's."""

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


def reduced(x: Any) -> tuple[Any, Any, Any]:
    """Sine and cosine, within 2 ulp, of the rest r of |x| up to FARTHEST (rad), x being k quarter turns and r; after
    them k + 1.5 * 2^52, whose last bits are those of the whole number k.

    r is in [-pi/4, pi/4]. The quarter is subtracted in three parts; the first two have 33 bits, so that k times them is
    exact, fused or not (Cody and Waite 1980). The polynomials are fdlibm's.
    """
    first, second, third = _QUARTER
    shifted = x * (2.0 / math.pi) + _SHIFT
    k = shifted - _SHIFT
    r = ((x - k * first) - k * second) - k * third
    z = r * r
    return r + r * z * polynomial(_SINE, z), (1.0 - 0.5 * z) + z * z * polynomial(_COSINE, z), shifted
