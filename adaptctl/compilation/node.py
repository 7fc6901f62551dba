"""Symbolic scalars."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn, TypeAlias

import numpy as np

from adaptctl.compilation.graph import (
    Expression,
    Op,
    absolute,
    add,
    cosine,
    divide,
    maximum,
    minimum,
    multiply,
    negate,
    sine,
    subtract,
    unary,
    untraceable,
)
from adaptctl.scalars.scalar import arc_tangent, exponential, hyperbolic_tangent, logarithm


class _Traced(Expression):
    __slots__ = ()
    __hash__ = Expression.__hash__

    def __eq__(self, other: object) -> bool:
        raise untraceable("a traced value cannot be tested for equality; use < or <=, and where")

    def __bool__(self) -> bool:
        raise untraceable(
            "a traced value cannot be branched on (`if`, `while`, `and`, `or`, `min`, `max`); use where, minimum or "
            "maximum"
        )

    def __float__(self) -> float:
        raise untraceable(
            "a traced value cannot become a float; use sin, exp, sqrt, ... of adaptctl.scalars or numpy instead of math"
        )

    def __index__(self) -> int:
        raise untraceable("a traced value cannot be an index or a count; use where to select")

    __int__ = __index__

    def __array__(self, *_args: Any, **_options: Any) -> NoReturn:
        raise untraceable("a traced value cannot be put into an array; use Column, Vec or Mat")

    def __array_function__(self, function: Any, _types: Any, args: Any, options: Any) -> Any:
        if function is not np.where or len(args) != 3 or options:
            raise untraceable(f"numpy.{function.__name__} cannot be traced, only {_TRACEABLE}")
        yes, no = lift(args[1]), lift(args[2])
        return NotImplemented if yes is None or no is None else _select(args[0], yes, no)


class Truth(_Traced):
    """Outcome of a comparison of symbolic scalars."""

    __slots__ = ()


def _operator(rule: Callable[[Any, Any], Any], *, reflected: bool = False) -> Callable[[Node, Any], Any]:
    def operator(self: Node, other: Any) -> Any:
        operand = other if type(other) is Node else lift(other)
        if operand is None:
            return NotImplemented
        return rule(operand, self) if reflected else rule(self, operand)

    return operator


def _comparison(op: Op) -> Callable[[Any, Any], Truth]:
    def compare(x: Any, y: Any) -> Truth:
        graph = x.graph if isinstance(x, Node) else y.graph
        return graph.make(Truth, op, x, y)

    return compare


_less, _less_equal = _comparison(Op.LESS), _comparison(Op.LESS_EQUAL)


class Node(_Traced):
    """Symbolic scalar of a traced function."""

    __slots__ = ()

    __add__, __radd__ = _operator(add), _operator(add, reflected=True)
    __sub__, __rsub__ = _operator(subtract), _operator(subtract, reflected=True)
    __mul__, __rmul__ = _operator(multiply), _operator(multiply, reflected=True)
    __truediv__, __rtruediv__ = _operator(divide), _operator(divide, reflected=True)
    __lt__, __gt__ = _operator(_less), _operator(_less, reflected=True)
    __le__, __ge__ = _operator(_less_equal), _operator(_less_equal, reflected=True)

    def __pow__(self, _exponent: object) -> NoReturn:
        raise untraceable("a traced value cannot be raised to a power; multiply, or use sqrt")

    def __neg__(self) -> Any:
        return negate(self)

    def __abs__(self) -> Any:
        return absolute(self)

    def with_sine(self, sine: Value, cosine: Value) -> Node:
        """This angle, with known sine and cosine."""
        self.graph.sines[self] = sine, cosine
        return self

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        if any(isinstance(x, np.ndarray) and x.ndim for x in inputs):
            raise untraceable(
                "a traced value cannot be combined with an array; convert the array to Column, Vec or Mat"
            )
        operands = [lift(x) for x in inputs]
        if any(x is None for x in operands) or method != "__call__" or options:
            return NotImplemented
        rule = _RULES.get(ufunc)
        if rule is None:
            raise untraceable(f"numpy.{ufunc.__name__} cannot be traced, only {_TRACEABLE}")
        return rule(*operands)


Value: TypeAlias = Node | float
"""Scalar under trace: a node or a known float."""
_NUMBERS = (float, int, np.floating, np.integer)  # a union, written where it is asked for, is made at each call


def lift(x: Any) -> Value | None:
    """Scalar of a traced function made of `x`."""
    if isinstance(x, Node):
        return x
    if isinstance(x, _NUMBERS) or (isinstance(x, np.ndarray) and x.ndim == 0):
        return float(x) + 0.0  # -0.0 becomes 0.0
    return None


def _select(condition: Any, yes: Value, no: Value) -> Value:
    if isinstance(condition, bool | np.bool_):
        return yes if condition else no
    if not isinstance(condition, Truth):
        raise untraceable(f"where: expected a comparison such as x < y, got {condition!r}")
    if yes is no or (isinstance(yes, float) and isinstance(no, float) and yes == no):
        return yes
    return condition.graph.make(Node, Op.SELECT, condition, yes, no)


_RULES: dict[np.ufunc, Callable[..., Any]] = {
    np.add: add,
    np.subtract: subtract,
    np.multiply: multiply,
    np.divide: divide,
    np.negative: negate,
    np.sin: sine,
    np.cos: cosine,
    np.sqrt: unary(Op.SQRT),
    np.exp: exponential,
    np.log: logarithm,
    np.tanh: hyperbolic_tangent,
    np.arctan2: arc_tangent,
    np.rint: unary(Op.ROUND),
    np.absolute: absolute,
    np.minimum: minimum,
    np.maximum: maximum,
    np.less: _less,
    np.less_equal: _less_equal,
    np.greater: lambda x, y: _less(y, x),
    np.greater_equal: lambda x, y: _less_equal(y, x),
}
_TRACEABLE = ", ".join(sorted(ufunc.__name__ for ufunc in _RULES)) + " and where"
