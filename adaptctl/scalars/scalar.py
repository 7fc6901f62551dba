"""Scalars: the operations that equations may use, on numbers of any kind.

Equations are written once, over scalars: a float, a NumPy array of samples, a dual number, a node of an expression
graph. Elementary functions dispatch by NumPy's own protocols (NEP 13 and NEP 18), so a kind of scalar joins by
implementing ``__array_ufunc__`` and ``__array_function__``; nothing here knows the kinds.
"""

from __future__ import annotations

import math
from typing import Any, Protocol, TypeAlias

import numpy as np


class Scalar(Protocol):
    """Protocol of a scalar: the arithmetic that every kind supports, +, -, *, / with numbers on either side, and the
    sign -x. Kinds are a float, an array of samples, a dual number, a node of an expression graph. Nothing is
    checked."""

    def __add__(self, other: Any, /) -> Any: ...
    def __radd__(self, other: Any, /) -> Any: ...
    def __sub__(self, other: Any, /) -> Any: ...
    def __rsub__(self, other: Any, /) -> Any: ...
    def __mul__(self, other: Any, /) -> Any: ...
    def __rmul__(self, other: Any, /) -> Any: ...
    def __truediv__(self, other: Any, /) -> Any: ...
    def __rtruediv__(self, other: Any, /) -> Any: ...
    def __neg__(self) -> Any: ...


LARGEST_EXPONENT = 709.782712893384
"""ln of the largest double"""

Condition: TypeAlias = Any
"""The outcome of comparing scalars: a bool, an array of bools, a node. Only `where` may branch on it."""


def sin(x: Any) -> Any:
    """Sine of an angle `x` in rad (a float, an array, a dual number or a node of an expression graph). Raises
    `ValueError` for an infinite float; in arrays it is NaN there."""
    return math.sin(x) if isinstance(x, float) else np.sin(x)


def cos(x: Any) -> Any:
    """Cosine of an angle `x` in rad (a float, an array, a dual number or a node of an expression graph). Raises
    `ValueError` for an infinite float; in arrays it is NaN there."""
    return math.cos(x) if isinstance(x, float) else np.cos(x)


def sqrt(x: Any) -> Any:
    """Square root of a scalar `x`, in the root of its unit (a float, an array, a dual number or a node of an expression
    graph). Raises `ValueError` for a negative float, `ZeroDivisionError` for a dual number of value 0.0, which has no
    derivative; in arrays the root of negative numbers is NaN."""
    return math.sqrt(x) if isinstance(x, float) else np.sqrt(x)


def exp(x: Any) -> Any:
    """Exponential e^x of a scalar `x` without unit (a float, an array, a dual number or a node of an expression graph);
    infinity where it exceeds the largest double. Nothing is raised."""
    if isinstance(x, float):
        return math.exp(x) if not x > LARGEST_EXPONENT else math.inf
    return np.exp(x)


def log(x: Any) -> Any:
    """Natural logarithm of a scalar `x` without unit (a float, an array, a dual number or a node of an expression
    graph); minus infinity of zero, NaN of negative numbers. Raises `ZeroDivisionError` for a dual number of value 0.0,
    which has no derivative."""
    if isinstance(x, float):
        return math.log(x) if x > 0.0 else -math.inf if x == 0.0 else math.nan
    return np.log(x)


def tanh(x: Any) -> Any:
    """Hyperbolic tangent of a scalar `x` without unit (a float, an array, a dual number or a node of an expression
    graph). Nothing is raised."""
    return math.tanh(x) if isinstance(x, float) else np.tanh(x)


def atan2(y: Any, x: Any) -> Any:
    """Angle of the point (x, y) from the x axis, in rad, from -pi to pi, and 0 at the origin. The coordinates `y` and
    `x`, in one unit, are each a float, an array, a dual number or a node of an expression graph. A dual number of
    floats at the origin, having no derivative there, raises `ZeroDivisionError`."""
    return math.atan2(y, x) if isinstance(x, float) and isinstance(y, float) else np.arctan2(y, x)


def nearest_whole(x: Any) -> Any:
    """The whole number nearest to a scalar `x`, as a scalar of the same kind: a float, an array, a dual number or a
    node of an expression graph. Of two equally near it is the even one. Nothing is raised."""
    return float(np.rint(x)) if isinstance(x, float) else np.rint(x)


def angle(sine: Any, cosine: Any, near: Any) -> Any:
    """Angle in rad with the given `sine` and `cosine`: of all such angles, which are 2 pi apart, the nearest to `near`
    (rad). Each argument is a float, an array, a dual number or a node of an expression graph.

    The squares of sine and cosine add up to 1, which is not checked. In compiled equations the sine and cosine of the
    angle are then those given, and are not computed again.
    """
    least = atan2(sine, cosine)
    whole = least + 2.0 * math.pi * nearest_whole((near - least) * (0.5 / math.pi))
    return whole.with_sine(sine, cosine) if hasattr(whole, "with_sine") else whole


def absolute(x: Any) -> Any:
    """Magnitude |x| of a scalar `x` (a float, an array, a dual number or a node of an expression graph), in the unit of
    x, elementwise in arrays. Nothing is raised."""
    return np.absolute(x)


def minimum(x: Any, y: Any) -> Any:
    """The smaller of two scalars x and y in one unit, each a float, an array, a dual number or a node of an expression
    graph, elementwise in arrays; NaN where either is NaN. Raises `ValueError` for arrays that do not broadcast."""
    return np.minimum(x, y)


def maximum(x: Any, y: Any) -> Any:
    """The larger of two scalars x and y in one unit, each a float, an array, a dual number or a node of an expression
    graph, elementwise in arrays; NaN where either is NaN. Raises `ValueError` for arrays that do not broadcast."""
    return np.maximum(x, y)


def where(condition: Condition, yes: Any, no: Any) -> Any:
    """The value `yes` where the `condition` holds, else `no`, elementwise in arrays, all of which broadcast (else
    `ValueError` is raised). It is the only way for an equation over scalars to branch. The condition is a comparison of
    scalars: a bool, an array of bools, or a node of an expression graph. Both values are computed in any case."""
    if isinstance(condition, bool | np.bool_):
        return yes if condition else no
    return np.where(condition, yes, no)


def clip(x: Any, lower: Any, upper: Any) -> Any:
    """The scalar `x` limited to the range from `lower` to `upper`: the nearer end where it is outside, elementwise in
    arrays. It is `upper` where `lower` is above it, NaN where any of the three is NaN. All are in one unit, each a
    float, an array, a dual number or a node of an expression graph. Raises `ValueError` for arrays that do not
    broadcast."""
    return minimum(maximum(x, lower), upper)
