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
    sign -x. Kinds are a float, an array of samples, a dual number, a node of an expression graph."""

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
    """Sine of an angle in rad, over scalars of any kind. Raises `ValueError` for an infinite float; NaN in arrays."""
    return math.sin(x) if isinstance(x, float) else np.sin(x)


def cos(x: Any) -> Any:
    """Cosine of an angle in rad, over scalars of any kind. Raises `ValueError` for an infinite float; NaN in arrays."""
    return math.cos(x) if isinstance(x, float) else np.cos(x)


def sqrt(x: Any) -> Any:
    """Square root of a scalar of any kind. Raises `ValueError` for a negative float; NaN where an array is negative."""
    return math.sqrt(x) if isinstance(x, float) else np.sqrt(x)


def exp(x: Any) -> Any:
    """Exponential e^x of a scalar of any kind; infinity where it is larger than doubles go."""
    if isinstance(x, float):
        return math.exp(x) if not x > LARGEST_EXPONENT else math.inf
    return np.exp(x)


def log(x: Any) -> Any:
    """Natural logarithm of a scalar of any kind; minus infinity of zero, NaN of what is negative."""
    if isinstance(x, float):
        return math.log(x) if x > 0.0 else -math.inf if x == 0.0 else math.nan
    return np.log(x)


def tanh(x: Any) -> Any:
    """Hyperbolic tangent of a scalar of any kind."""
    return math.tanh(x) if isinstance(x, float) else np.tanh(x)


def atan2(y: Any, x: Any) -> Any:
    """Angle of the point (x, y) from the x axis, in rad, from -pi to pi, over scalars of any kind."""
    return math.atan2(y, x) if isinstance(x, float) and isinstance(y, float) else np.arctan2(y, x)


def nearest_whole(x: Any) -> Any:
    """The whole number that is nearest to a scalar of any kind; of two equally near, the even one."""
    return float(np.rint(x)) if isinstance(x, float) else np.rint(x)


def angle(sine: Any, cosine: Any, near: Any) -> Any:
    """Angle in rad with this `sine` and `cosine`: of all such, whole turns apart, the nearest to `near` (rad).

    The squares of sine and cosine add up to 1, which is not checked. In compiled equations the sine and cosine of the
    angle are then those given, and are not computed again.
    """
    least = atan2(sine, cosine)
    whole = least + 2.0 * math.pi * nearest_whole((near - least) * (0.5 / math.pi))
    return whole.with_sine(sine, cosine) if hasattr(whole, "with_sine") else whole


def absolute(x: Any) -> Any:
    """Magnitude |x| of a scalar of any kind."""
    return np.absolute(x)


def minimum(x: Any, y: Any) -> Any:
    """The smaller of two scalars of any kind, elementwise in arrays; NaN where either is NaN."""
    return np.minimum(x, y)


def maximum(x: Any, y: Any) -> Any:
    """The larger of two scalars of any kind, elementwise in arrays; NaN where either is NaN."""
    return np.maximum(x, y)


def where(condition: Condition, yes: Any, no: Any) -> Any:
    """The value `yes` where the `condition` holds, else `no`, elementwise in arrays, all of which broadcast: the only
    branch an equation may take. The condition is a comparison of scalars: a bool, an array of bools, or a node of an
    expression graph. Both values are computed."""
    if isinstance(condition, bool | np.bool_):
        return yes if condition else no
    return np.where(condition, yes, no)


def clip(x: Any, lower: Any, upper: Any) -> Any:
    """The scalar x clipped to [lower, upper], to the nearest value within, elementwise in arrays; `upper` where `lower`
    is above it, NaN where any is NaN."""
    return minimum(maximum(x, lower), upper)
