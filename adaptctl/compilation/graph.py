"""Expression graph with shared equal expressions (hash consing; Ershov 1958)."""

from __future__ import annotations

import linecache
import sys
from collections.abc import Callable, Iterable
from enum import StrEnum
from itertools import takewhile
from operator import attrgetter
from types import FrameType
from typing import Any, TypeVar

from adaptctl.errors import TraceError

_TRACER = "adaptctl.compilation.routine"
_OF_ANOTHER = "a value of another trace was used; pass it to the function as an argument"
_SCALARS = ("adaptctl.compilation.", "adaptctl.scalars.", "numpy.")


def untraceable(why: str) -> TraceError:
    """`TraceError` for an operation that cannot be traced."""
    from traceback import walk_stack  # here, since only errors need it

    traced = takewhile(lambda at: _module(at) != _TRACER, walk_stack(sys._getframe(1)))
    lines = [at for at in traced if not _module(at).startswith(_SCALARS)]
    if not lines:
        return TraceError(why)
    frame, line = next((at for at in lines if not _module(at).startswith("adaptctl.")), lines[0])
    file = frame.f_code.co_filename
    return TraceError(f"{why} ({file}:{line}: {linecache.getline(file, line).strip()})")


def _module(at: tuple[FrameType, int]) -> str:
    return str(at[0].f_globals.get("__name__", ""))


E = TypeVar("E", bound="Expression")


class Op(StrEnum):
    """
    Kind of operation in an expression graph.

    Examples
    --------
    >>> from adaptctl.compilation import Op
    >>> Op("+").name
    'ADD'
    """

    INPUT = "input"
    ADD = "+"
    SUBTRACT = "-"
    MULTIPLY = "*"
    DIVIDE = "/"
    NEGATE = "neg"
    SIN = "sin"
    COS = "cos"
    SQRT = "sqrt"
    ROUND = "round"
    ABSOLUTE = "abs"
    MINIMUM = "min"
    MAXIMUM = "max"
    LESS = "<"
    LESS_EQUAL = "<="
    SELECT = "select"
    CALL = "call"
    RESULT = "result"


# Asked for at each expression: an enumeration's attribute takes ten times as long as a name.
INPUT, ADD, MULTIPLY, NEGATE, CALL, RESULT = Op.INPUT, Op.ADD, Op.MULTIPLY, Op.NEGATE, Op.CALL, Op.RESULT


class Expression:
    """Node of an expression graph."""

    __slots__ = ("detail", "graph", "index", "op", "operands")

    def __init__(self, graph: Graph, index: int, op: Op, operands: tuple[Any, ...], detail: Any) -> None:
        self.graph, self.index, self.op, self.operands, self.detail = graph, index, op, operands, detail

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.index}: {self.op}>"


class Graph:
    """Expression graph of one trace."""

    def __init__(self, routines: dict[Any, Any] | None = None, passed: int | None = None) -> None:
        self._expressions: dict[Any, Expression] = {}
        self.routines = {} if routines is None else routines
        self.sines: dict[Expression, tuple[Any, Any]] = {}
        self.passed, self.turned = passed, list[Expression]()

    def make(self, kind: type[E], op: Op, *operands: Any, detail: Any = None) -> E:
        """Expression of an operation, shared with an equal one."""
        key = (op, operands, detail)
        found = self._expressions.get(key)
        if found is None:
            for x in operands:
                if type(x) is not float and x.graph is not self:
                    raise untraceable(_OF_ANOTHER)
            found = self._expressions[key] = kind(self, len(self._expressions), op, operands, detail)
        return found  # type: ignore[return-value]  # an operation has one kind

    def close(self) -> None:
        """Forget the expressions, when all are made: those that are used keep each other."""
        self._expressions.clear()
        self.sines.clear()

    def known_sine(self, angle: Expression) -> tuple[Any, Any] | None:
        """Known sine and cosine of an angle, else None."""
        if angle not in self.sines and self.passed is not None and self._is_argument(angle):
            first = 2 * len(self.turned)
            self.turned.append(angle)
            sine, cosine = (self.make(type(angle), INPUT, detail=(self.passed, first + k)) for k in (0, 1))
            self.sines[angle] = sine, cosine
        return self.sines.get(angle)

    def _is_argument(self, x: Expression) -> bool:
        return x.op is INPUT and x.detail[0] != self.passed

    def validate_own(self, values: Iterable[Any]) -> None:
        """Raise `TraceError` if a value is of another graph."""
        for x in values:
            if isinstance(x, Expression) and x.graph is not self:
                raise untraceable(_OF_ANOTHER)


def reachable(outputs: Iterable[Any]) -> list[Expression]:
    """Expressions that outputs need, operands before what uses them."""
    needed = {x for x in outputs if isinstance(x, Expression)}
    pending = list(needed)
    while pending:
        for x in pending.pop().operands:
            if type(x) is not float and x not in needed:
                needed.add(x)
                pending.append(x)
    return sorted(needed, key=attrgetter("index"))


def add(x: Any, y: Any) -> Any:
    """Sum `x + y`."""
    if type(y) is float:
        x, y = y, x
    if type(x) is float and x == 0.0:
        return y
    if y.op is NEGATE:
        return subtract(x, y.operands[0])
    if _does(x, NEGATE):
        return subtract(y, x.operands[0])
    x, y = _ordered(x, y)
    return y.graph.make(type(y), ADD, x, y)


def subtract(x: Any, y: Any) -> Any:
    """Difference `x - y`."""
    if x is y:
        return 0.0
    if _is(x, 0.0):
        return negate(y)
    if isinstance(y, float):
        return add(x, -y)
    if _does(y, NEGATE):
        return add(x, y.operands[0])
    return _make(Op.SUBTRACT, x, y)


def negate(x: Any) -> Any:
    """Expression `-x`."""
    if _does(x, NEGATE):
        return x.operands[0]
    if _does(x, Op.SUBTRACT):
        return subtract(*reversed(x.operands))
    if _does(x, MULTIPLY) and isinstance(x.operands[0], float):
        return multiply(-x.operands[0], x.operands[1])
    return _make(NEGATE, x)


def multiply(x: Any, y: Any) -> Any:
    """Product `x * y`."""
    x, y = _ordered(x, y)
    if type(x) is float:
        if abs(x) in (0.0, 1.0):
            return 0.0 if x == 0.0 else y if x > 0.0 else negate(y)
        return multiply(-x, y.operands[0]) if y.op is NEGATE else y.graph.make(type(y), MULTIPLY, x, y)
    if y.op is NEGATE:
        return negate(multiply(x, y.operands[0]))
    if x.op is NEGATE:
        return negate(multiply(x.operands[0], y))
    return x.graph.make(type(x), MULTIPLY, x, y)


def divide(x: Any, y: Any) -> Any:
    """Quotient `x / y`."""
    if _is(x, 0.0):
        return 0.0
    if _is(y, 1.0) or _is(y, -1.0):
        return x if y > 0.0 else negate(x)
    if _does(x, NEGATE):
        return divide(x.operands[0], -y) if isinstance(y, float) else negate(divide(x.operands[0], y))
    if _does(y, NEGATE):
        return divide(-x, y.operands[0]) if isinstance(x, float) else negate(divide(x, y.operands[0]))
    return _make(Op.DIVIDE, x, y)


def absolute(x: Any) -> Any:
    """Absolute value `|x|`, as an expression."""
    if _does(x, NEGATE):
        return absolute(x.operands[0])
    return x if _does(x, Op.ABSOLUTE) else _make(Op.ABSOLUTE, x)


def minimum(x: Any, y: Any) -> Any:
    """Smaller of `x` and `y`."""
    return x if x is y else _make(Op.MINIMUM, *_ordered(x, y))


def maximum(x: Any, y: Any) -> Any:
    """Larger of `x` and `y`."""
    return x if x is y else _make(Op.MAXIMUM, *_ordered(x, y))


def unary(op: Op) -> Callable[[Any], Any]:
    """Function for an operation with one operand."""
    return lambda x: _make(op, x)


def sine(x: Any) -> Any:
    """Sine of `x`."""
    known = x.graph.known_sine(x)
    return known[0] if known else _make(Op.SIN, x)


def cosine(x: Any) -> Any:
    """Cosine of `x`."""
    known = x.graph.known_sine(x)
    return known[1] if known else _make(Op.COS, x)


def _make(op: Op, *operands: Any) -> Any:
    traced = operands[1] if type(operands[0]) is float else operands[0]
    return traced.graph.make(type(traced), op, *operands)


def _is(x: Any, constant: float) -> bool:
    return type(x) is float and x == constant


def _does(x: Any, op: Op) -> bool:
    return type(x) is not float and x.op is op


def _ordered(x: Any, y: Any) -> tuple[Any, Any]:
    """Constants first, then what was made first."""
    if type(x) is float or (type(y) is not float and x.index <= y.index):
        return x, y
    return y, x
