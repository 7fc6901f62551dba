"""Operations of equations over scalars of any kind."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import Any, Protocol, TypeAlias

import numpy as np


class Scalar(Protocol):
    """
    Scalar of any kind: float, array of samples, dual number or symbolic scalar.

    Notes
    -----
    All kinds support +, -, *, / with numbers on either side.

    Examples
    --------
    >>> from adaptctl.scalars import Dual
    >>> (2.0 * Dual(3.0, 1.0)).slope
    2.0
    """

    def __add__(self, other: Any, /) -> Any: ...
    def __radd__(self, other: Any, /) -> Any: ...
    def __sub__(self, other: Any, /) -> Any: ...
    def __rsub__(self, other: Any, /) -> Any: ...
    def __mul__(self, other: Any, /) -> Any: ...
    def __rmul__(self, other: Any, /) -> Any: ...
    def __truediv__(self, other: Any, /) -> Any: ...
    def __rtruediv__(self, other: Any, /) -> Any: ...
    def __neg__(self) -> Any: ...


MAX_EXPONENT = 709.782712893384
"""ln of the largest double"""

Condition: TypeAlias = Any
"""comparison of scalars; only `where` may branch on it"""


def sin(x: Any) -> Any:
    """
    Compute the sine.

    Parameters
    ----------
    x : float, array, Dual or symbolic scalar
        Angle in rad.

    Returns
    -------
    float, array, Dual or symbolic scalar
        The sine, elementwise in arrays.

    Raises
    ------
    ValueError
        If a float is infinite; arrays give NaN there.

    Examples
    --------
    >>> from adaptctl.scalars import sin
    >>> float(sin(0.0))
    0.0
    """
    return math.sin(x) if isinstance(x, float) else np.sin(x)


def cos(x: Any) -> Any:
    """
    Compute the cosine.

    Parameters
    ----------
    x : float, array, Dual or symbolic scalar
        Angle in rad.

    Returns
    -------
    float, array, Dual or symbolic scalar
        The cosine, elementwise in arrays.

    Raises
    ------
    ValueError
        If a float is infinite; arrays give NaN there.

    Examples
    --------
    >>> from adaptctl.scalars import cos
    >>> float(cos(0.0))
    1.0
    """
    return math.cos(x) if isinstance(x, float) else np.cos(x)


def sqrt(x: Any) -> Any:
    """
    Compute the square root.

    Parameters
    ----------
    x : float, array, Dual or symbolic scalar
        Scalar of at least 0, in any unit.

    Returns
    -------
    float, array, Dual or symbolic scalar
        Root, elementwise, in the root of the unit of x; NaN of negative entries of arrays.

    Raises
    ------
    ValueError
        If a float is negative.
    ZeroDivisionError
        If a dual number has the value 0.0, where there is no derivative.

    Examples
    --------
    >>> from adaptctl.scalars import sqrt
    >>> float(sqrt(4.0))
    2.0
    """
    return math.sqrt(x) if isinstance(x, float) else np.sqrt(x)


def exp(x: Any) -> Any:
    """
    Compute the exponential.

    Parameters
    ----------
    x : float, array, Dual or symbolic scalar
        Scalar without unit.

    Returns
    -------
    float, array, Dual or symbolic scalar
        The power e^x; infinity where it exceeds the largest double.

    Examples
    --------
    >>> from adaptctl.scalars import exp
    >>> exp(0.0)
    1.0
    """
    if isinstance(x, float):
        return math.exp(x) if not x > MAX_EXPONENT else math.inf
    return np.exp(x)


def log(x: Any) -> Any:
    """
    Compute the natural logarithm.

    Parameters
    ----------
    x : float, array, Dual or symbolic scalar
        Scalar without unit.

    Returns
    -------
    float, array, Dual or symbolic scalar
        The logarithm; minus infinity of 0, NaN of negative numbers.

    Raises
    ------
    ZeroDivisionError
        If a dual number has the value 0.0, where there is no derivative.

    Examples
    --------
    >>> from adaptctl.scalars import log
    >>> float(log(1.0))
    0.0
    """
    if isinstance(x, float):
        return math.log(x) if x > 0.0 else -math.inf if x == 0.0 else math.nan
    return np.log(x)


def tanh(x: Any) -> Any:
    """
    Compute the hyperbolic tangent.

    Parameters
    ----------
    x : float, array, Dual or symbolic scalar
        Scalar without unit.

    Returns
    -------
    float, array, Dual or symbolic scalar
        The hyperbolic tangent, elementwise in arrays.

    Examples
    --------
    >>> from adaptctl.scalars import tanh
    >>> float(tanh(0.0))
    0.0
    """
    return math.tanh(x) if isinstance(x, float) else np.tanh(x)


def atan2(y: Any, x: Any) -> Any:
    """
    Compute the angle of the point (x, y) from the x axis.

    Parameters
    ----------
    y, x : float, array, Dual or symbolic scalar
        Coordinates in one unit.

    Returns
    -------
    float, array, Dual or symbolic scalar
        Angle in rad from -pi to pi; 0 at the origin.

    Raises
    ------
    ZeroDivisionError
        If a dual number of floats is at the origin, where there is no derivative.

    Examples
    --------
    >>> from adaptctl.scalars import atan2
    >>> round(float(atan2(1.0, 0.0)), 3)
    1.571
    """
    return math.atan2(y, x) if isinstance(x, float) and isinstance(y, float) else np.arctan2(y, x)


def nearest_whole(x: Any) -> Any:
    """
    Round to the nearest integer, halves to even.

    Parameters
    ----------
    x : float, array, Dual or symbolic scalar
        Scalar to round, in any unit.

    Returns
    -------
    float, array, Dual or symbolic scalar
        Whole number as a scalar of the same kind, in the unit of x, elementwise in arrays.

    Examples
    --------
    >>> from adaptctl.scalars import nearest_whole
    >>> nearest_whole(2.5)
    2.0
    """
    return float(np.rint(x)) if isinstance(x, float) else np.rint(x)


def angle(sine: Any, cosine: Any, near: Any) -> Any:
    """
    Return the angle of a given sine and cosine that is nearest to another angle.

    Parameters
    ----------
    sine, cosine, near : float, array, Dual or symbolic scalar
        Sine and cosine without unit, whose squares add up to 1, and an angle in rad to be near to.

    Returns
    -------
    float, array, Dual or symbolic scalar
        Angle in rad. Compiled equations do not compute its sine and cosine again.

    Examples
    --------
    >>> from adaptctl.scalars import angle
    >>> round(float(angle(0.0, 1.0, near=6.0)), 3)
    6.283
    """
    least = atan2(sine, cosine)
    whole = least + 2.0 * math.pi * nearest_whole((near - least) * (0.5 / math.pi))
    return whole.with_sine(sine, cosine) if hasattr(whole, "with_sine") else whole


def absolute(x: Any) -> Any:
    """
    Compute the absolute value.

    Parameters
    ----------
    x : float, array, Dual or symbolic scalar
        Scalar in any unit.

    Returns
    -------
    float, array, Dual or symbolic scalar
        Magnitude |x| in the unit of x, elementwise in arrays.

    Examples
    --------
    >>> from adaptctl.scalars import absolute
    >>> float(absolute(-2.0))
    2.0
    """
    return np.absolute(x)


def minimum(x: Any, y: Any) -> Any:
    """
    Return the smaller of two scalars.

    Parameters
    ----------
    x, y : float, array, Dual or symbolic scalar
        Scalars in one unit.

    Returns
    -------
    float, array, Dual or symbolic scalar
        The smaller one, elementwise; NaN where either is NaN.

    Raises
    ------
    ValueError
        If arrays do not broadcast.

    Examples
    --------
    >>> from adaptctl.scalars import minimum
    >>> float(minimum(1.0, 2.0))
    1.0
    """
    return np.minimum(x, y)


def maximum(x: Any, y: Any) -> Any:
    """
    Return the larger of two scalars.

    Parameters
    ----------
    x, y : float, array, Dual or symbolic scalar
        Scalars in one unit.

    Returns
    -------
    float, array, Dual or symbolic scalar
        The larger one, elementwise; NaN where either is NaN.

    Raises
    ------
    ValueError
        If arrays do not broadcast.

    Examples
    --------
    >>> from adaptctl.scalars import maximum
    >>> float(maximum(1.0, 2.0))
    2.0
    """
    return np.maximum(x, y)


def where(condition: Condition, yes: Any, no: Any) -> Any:
    """
    Choose one of two values by a condition, in place of `if` in compiled equations.

    Parameters
    ----------
    condition : bool, array or symbolic comparison
        Comparison of scalars, such as ``x < 0.0``.
    yes, no : float, array, Dual or symbolic scalar
        Values in one unit, where the condition holds and where not. Both are computed in any case.

    Returns
    -------
    float, array, Dual or symbolic scalar
        The chosen value, elementwise in arrays.

    Raises
    ------
    ValueError
        If arrays do not broadcast.

    Examples
    --------
    >>> from adaptctl.scalars import where
    >>> where(p > 0.4, 1.0, 0.0).tolist()
    [0.0, 1.0]
    """
    if isinstance(condition, bool | np.bool_):
        return yes if condition else no
    return np.where(condition, yes, no)


def clip(x: Any, lower: Any, upper: Any) -> Any:
    """
    Limit a scalar to a range.

    Parameters
    ----------
    x : float, array, Dual or symbolic scalar
        Scalar to limit, in any unit.
    lower, upper : float, array, Dual or symbolic scalar
        Ends of the range, in the unit of x.

    Returns
    -------
    float, array, Dual or symbolic scalar
        Nearest value in the range, elementwise; `upper` where the range is empty, NaN where any of the three is NaN.

    Raises
    ------
    ValueError
        If arrays do not broadcast.

    Examples
    --------
    >>> from adaptctl.scalars import clip
    >>> float(clip(5.0, -1.0, 1.0))
    1.0
    """
    return minimum(maximum(x, lower), upper)


_SHIFT = 1.5 * 2.0**52
"""adding it rounds a number to the nearest integer"""
_LN2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
"""sum is ln 2; the first has 33 bits"""
_HALVINGS = (512, 512, 256, 128, 64, 32, 16, 8, 4, 2, 1)
"""powers of two that compose any double's exponent"""

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
    """Exponential by arithmetic and comparisons alone, for SIMD."""
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
    """Natural logarithm for SIMD."""
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
    """Hyperbolic tangent for SIMD."""
    near = clip(x, -0.625, 0.625)
    z = near * near
    close = near + near * z * (polynomial(_TANH, z) / polynomial(_TANH_BELOW, z))
    far = 1.0 - 2.0 / (exponential(2.0 * minimum(absolute(x), 30.0)) + 1.0)
    return where(absolute(x) < 0.625, close, where(x < 0.0, -far, far))


def arc_tangent(y: Any, x: Any) -> Any:
    """Angle of the point (x, y), for SIMD."""
    high, low = maximum(absolute(x), absolute(y)), minimum(absolute(x), absolute(y))
    upper = low > math.tan(math.pi / 8.0) * high
    t = where(upper, low - high, low) / where(upper, low + high, where(high > 0.0, high, 1.0))
    z = t * t
    angle = where(upper, math.pi / 4.0, 0.0) + (t + t * z * (polynomial(_ATAN, z) / polynomial(_ATAN_BELOW, z)))
    angle = where(absolute(y) > absolute(x), math.pi / 2.0 - angle, angle)
    angle = where(x < 0.0, math.pi - angle, angle)
    return where(y < 0.0, -angle, angle)


def polynomial(coefficients: Sequence[float], z: Any) -> Any:
    """Polynomial c_0 + c_1 z + ... by Horner's scheme."""
    return reduce(lambda higher, c: c + z * higher, reversed(coefficients))
