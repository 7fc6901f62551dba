"""Arithmetic on expressions and floats, simplified where a law allows it.

The laws are those of real numbers: `0 * x`, `0 / x` and `x - x` are 0 and the sign of a zero is not kept, so a
NaN or an infinity in such an `x` is lost. Nothing is reassociated, so no rounding error changes; through all
other operations NaN passes as it does in NumPy. At least one operand is an expression.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from adaptctl.compilation.graph import Expression, Op


def add(x: Any, y: Any) -> Any:
    """The sum `x + y` of expressions (symbolic scalars of one graph) and floats, at least one an expression: a new or
    earlier expression. It is the other operand where one is the float 0, and 0.0 where one is the other's negation; in
    place of x + (-z), the difference x - z is made. Raises `TraceError` for expressions of two graphs."""
    if _is(x, 0.0) or _is(y, 0.0):
        return y if _is(x, 0.0) else x
    if _does(y, Op.NEGATE):
        return subtract(x, y.operands[0])
    if _does(x, Op.NEGATE):
        return subtract(y, x.operands[0])
    return _make(Op.ADD, *_ordered(x, y))


def subtract(x: Any, y: Any) -> Any:
    """The difference `x - y` of expressions (symbolic scalars of one graph) and floats, at least one an expression: a
    new or earlier expression; 0.0 where both are the same, also for NaN and infinity; `x` or `-y` where the other is
    the float 0. In place of x - (-z) and x - c, with a float c, the sums x + z and x + (-c) are made. Raises
    `TraceError` for expressions of two graphs."""
    if x is y:
        return 0.0
    if _is(x, 0.0):
        return negate(y)
    if isinstance(y, float):
        return add(x, -y)
    if _does(y, Op.NEGATE):
        return add(x, y.operands[0])
    return _make(Op.SUBTRACT, x, y)


def negate(x: Any) -> Any:
    """The expression `-x` of an expression `x` (a symbolic scalar). No negation is added where `x` is a difference a -
    b, a negation -z or a multiple c z by a float c: it is b - a, z or (-c) z then. Nothing is raised."""
    if _does(x, Op.NEGATE):
        return x.operands[0]
    if _does(x, Op.SUBTRACT):
        return subtract(*reversed(x.operands))
    if _does(x, Op.MULTIPLY) and isinstance(x.operands[0], float):
        return multiply(-x.operands[0], x.operands[1])
    return _make(Op.NEGATE, x)


def multiply(x: Any, y: Any) -> Any:
    """The product `x * y` of expressions (symbolic scalars of one graph) and floats, at least one an expression: a new
    or earlier expression. It is the float 0.0 where one is 0, also times NaN and infinity, and the other one or its
    negation where one is 1 or -1; in place of x (-z), -(x z) is made, or (-c) z where x is a float c. Raises
    `TraceError` for expressions of two graphs."""
    x, y = _ordered(x, y)
    if isinstance(x, float) and abs(x) in (0.0, 1.0):
        return 0.0 if x == 0.0 else y if x > 0.0 else negate(y)
    if _does(y, Op.NEGATE):
        return multiply(-x, y.operands[0]) if isinstance(x, float) else negate(multiply(x, y.operands[0]))
    if _does(x, Op.NEGATE):
        return negate(multiply(x.operands[0], y))
    return _make(Op.MULTIPLY, x, y)


def divide(x: Any, y: Any) -> Any:
    """The quotient `x / y` of expressions (symbolic scalars of one graph) and floats, at least one an expression: a new
    or earlier expression. It is the float 0.0 where `x` is 0, also by 0 and NaN, and `x` or its negation where `y` is 1
    or -1; in place of (-z)/y, -(z/y) is made, or z/(-c) where y is a float c, and likewise where `y` is negated. Raises
    `TraceError` for expressions of two graphs."""
    if _is(x, 0.0):
        return 0.0
    if _is(y, 1.0) or _is(y, -1.0):
        return x if y > 0.0 else negate(x)
    if _does(x, Op.NEGATE):
        return divide(x.operands[0], -y) if isinstance(y, float) else negate(divide(x.operands[0], y))
    if _does(y, Op.NEGATE):
        return divide(-x, y.operands[0]) if isinstance(x, float) else negate(divide(x, y.operands[0]))
    return _make(Op.DIVIDE, x, y)


def absolute(x: Any) -> Any:
    """The absolute value `|x|` of an expression `x` (a symbolic scalar), as an expression; `x` itself where it is an
    absolute value. Of a negation -z it is that of z. Nothing is raised."""
    if _does(x, Op.NEGATE):
        return absolute(x.operands[0])
    return x if _does(x, Op.ABSOLUTE) else _make(Op.ABSOLUTE, x)


def minimum(x: Any, y: Any) -> Any:
    """The smaller of `x` and `y`, expressions (symbolic scalars of one graph) or floats, at least one an expression: an
    expression, which computes NaN where either is NaN; `x` where both are the same. Raises `TraceError` for expressions
    of two graphs."""
    return x if x is y else _make(Op.MINIMUM, *_ordered(x, y))


def maximum(x: Any, y: Any) -> Any:
    """The larger of `x` and `y`, expressions (symbolic scalars of one graph) or floats, at least one an expression: an
    expression, which computes NaN where either is NaN; `x` where both are the same. Raises `TraceError` for expressions
    of two graphs."""
    return x if x is y else _make(Op.MAXIMUM, *_ordered(x, y))


def elementary(op: Op) -> Callable[[Any], Any]:
    """A function that makes of an expression (a symbolic scalar) that of one operation `op` on it, an `Op` with one
    operand, such as the square root or rounding; it is never simplified. Nothing is checked."""
    return lambda x: _make(op, x)


def sine(x: Any) -> Any:
    """The sine of `x`, an expression (a symbolic scalar) in rad: an expression, or what has been noted as its sine in
    its graph, which may be a float. Nothing is raised."""
    known = x.graph.known_sine(x)
    return known[0] if known else _make(Op.SIN, x)


def cosine(x: Any) -> Any:
    """The cosine of `x`, an expression (a symbolic scalar) in rad: an expression, or what has been noted as its cosine
    in its graph, which may be a float. Nothing is raised."""
    known = x.graph.known_sine(x)
    return known[1] if known else _make(Op.COS, x)


def _make(op: Op, *operands: Any) -> Any:
    traced = operands[0] if isinstance(operands[0], Expression) else operands[1]
    return traced.graph.make(type(traced), op, *operands)


def _is(x: Any, constant: float) -> bool:
    return isinstance(x, float) and x == constant


def _does(x: Any, op: Op) -> bool:
    return isinstance(x, Expression) and x.op is op


def _ordered(x: Any, y: Any) -> tuple[Any, Any]:
    """One order for what commutes, constants first, so that `x + y` and `y + x` are one expression."""
    return (x, y) if _rank(x) <= _rank(y) else (y, x)


def _rank(x: Any) -> int:
    return x.index if isinstance(x, Expression) else -1
