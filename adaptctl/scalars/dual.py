"""Dual numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from adaptctl.scalars.scalar import (
    absolute,
    atan2,
    cos,
    exp,
    log,
    maximum,
    minimum,
    nearest_whole,
    sin,
    sqrt,
    tanh,
    where,
)


class Dual(np.lib.mixins.NDArrayOperatorsMixin):
    r"""
    Dual number: a value with its derivative along one direction.

    Parameters
    ----------
    value : float or array_like
        Value in any unit, or samples (...) of it.
    slope : float or array_like, default 0.0
        Derivative along the direction, in the value's unit per unit of the direction, of shape (...) or (). Zero is
        that of a constant.

    Raises
    ------
    TypeError
        If it is the condition of an ``if`` (use `where`) or goes into a NumPy function without a rule for it.
    ZeroDivisionError
        If floats have no derivative, as `sqrt` and `log` at 0; arrays give an infinite or NaN slope.

    Notes
    -----
    :math:`value + slope\,\epsilon` with :math:`\epsilon^2 = 0`. Comparisons use values alone.

    Examples
    --------
    >>> from adaptctl.scalars import Dual, sin
    >>> x = sin(Dual(0.0, 1.0))
    >>> float(x.value), float(x.slope)
    (0.0, 1.0)
    """

    __slots__ = ("slope", "value")

    def __init__(self, value: Any, slope: Any = 0.0) -> None:
        self.value, self.slope = value, slope

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        rule = _RULES.get(ufunc)
        if rule is None or method != "__call__" or options:
            return NotImplemented
        return rule(*(dual(x) for x in inputs))

    def __array_function__(self, function: Any, _types: Any, args: Any, options: Any) -> Any:
        if function is not np.where or options:
            return NotImplemented
        condition, yes, no = args[0], dual(args[1]), dual(args[2])
        return Dual(where(condition, yes.value, no.value), where(condition, yes.slope, no.slope))

    def __bool__(self) -> bool:
        raise TypeError("a dual number cannot steer an `if`: use adaptctl.scalars.where")


def dual(x: Any) -> Dual:
    """Dual number from a scalar."""
    return x if isinstance(x, Dual) else Dual(x)


def _operator(rule: Callable[[Dual, Dual], Dual], *, reflected: bool = False) -> Callable[[Dual, Any], Any]:
    """Operator without NumPy's search for who overrides a ufunc, which takes longer than the rule."""

    def operator(self: Dual, other: Any) -> Any:
        if not isinstance(other, Dual):
            if getattr(other, "__array_ufunc__", other) is None:  # a Vec or Column, which has its own rule
                return NotImplemented
            other = Dual(other)
        return rule(other, self) if reflected else rule(self, other)

    return operator


def _add(a: Dual, b: Dual) -> Dual:
    return Dual(a.value + b.value, a.slope + b.slope)


def _subtract(a: Dual, b: Dual) -> Dual:
    return Dual(a.value - b.value, a.slope - b.slope)


def _multiply(a: Dual, b: Dual) -> Dual:
    return Dual(a.value * b.value, a.slope * b.value + a.value * b.slope)


def _divide(a: Dual, b: Dual) -> Dual:
    quotient = a.value / b.value
    return Dual(quotient, (a.slope - quotient * b.slope) / b.value)


for _name, _rule in {"add": _add, "sub": _subtract, "mul": _multiply, "truediv": _divide}.items():
    setattr(Dual, f"__{_name}__", _operator(_rule))
    setattr(Dual, f"__r{_name}__", _operator(_rule, reflected=True))


def _sqrt(a: Dual) -> Dual:
    root = sqrt(a.value)
    return Dual(root, a.slope / (2.0 * root))


def _tanh(a: Dual) -> Dual:
    value = tanh(a.value)
    return Dual(value, (1.0 - value * value) * a.slope)


def _atan2(y: Dual, x: Dual) -> Dual:
    square = x.value * x.value + y.value * y.value
    return Dual(atan2(y.value, x.value), (x.value * y.slope - y.value * x.slope) / square)


def _minimum(a: Dual, b: Dual) -> Dual:
    return Dual(minimum(a.value, b.value), where(a.value <= b.value, a.slope, b.slope))


def _maximum(a: Dual, b: Dual) -> Dual:
    return Dual(maximum(a.value, b.value), where(a.value >= b.value, a.slope, b.slope))


_RULES: dict[np.ufunc, Callable[..., Any]] = {
    np.add: _add,
    np.subtract: _subtract,
    np.multiply: _multiply,
    np.divide: _divide,
    np.negative: lambda a: Dual(-a.value, -a.slope),
    np.sin: lambda a: Dual(sin(a.value), cos(a.value) * a.slope),
    np.cos: lambda a: Dual(cos(a.value), -sin(a.value) * a.slope),
    np.sqrt: _sqrt,
    np.exp: lambda a: Dual(exp(a.value), exp(a.value) * a.slope),
    np.log: lambda a: Dual(log(a.value), a.slope / a.value),
    np.tanh: _tanh,
    np.arctan2: _atan2,
    np.rint: lambda a: Dual(nearest_whole(a.value)),
    np.absolute: lambda a: Dual(absolute(a.value), where(a.value < 0.0, -a.slope, a.slope)),
    np.minimum: _minimum,
    np.maximum: _maximum,
    np.less: lambda a, b: a.value < b.value,
    np.less_equal: lambda a, b: a.value <= b.value,
    np.greater: lambda a, b: a.value > b.value,
    np.greater_equal: lambda a, b: a.value >= b.value,
}
