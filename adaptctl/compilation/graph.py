"""A graph of expressions in which equal expressions are one object (hash consing; Ershov 1958)."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import Any, TypeVar, cast

from adaptctl.compilation.refusal import untraceable

E = TypeVar("E", bound="Expression")


class Op(StrEnum):
    """Kinds of operation of an `Expression` (a node in the graph of a traced function), each the text of its symbol or
    name: an input, + - * / and neg, sin and cos (rad), sqrt, round (to the nearest whole number, halves to the even
    one), abs, min, max, the comparisons < and <=, select (one of two values by a comparison), the call of a routine and
    a result of that call."""

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


class Expression:
    """An expression: one operation on `operands`, earlier expressions of the same graph, or constants, which are plain
    floats.

    `detail` says what operands cannot: which input, which routine is called, which of its results is meant.
    """

    __slots__ = ("detail", "graph", "index", "op", "operands")

    def __init__(self, graph: Graph, index: int, op: Op, operands: tuple[Any, ...], detail: Any) -> None:
        self.graph, self.index, self.op, self.operands, self.detail = graph, index, op, operands, detail

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.index}: {self.op}>"


class Graph:
    """The expression graph of one trace. Operands come before what uses them, so the indices are a schedule.

    `routines` remembers the functions called; the graph of a called function shares its caller's. `sines` has the
    sines and cosines of angles that were made of them. Those of a called function's inputs are the caller's to compute,
    who may have them already: they are its argument of number `passed`, in pairs, of the inputs in `turned`.
    """

    def __init__(self, routines: dict[Any, Any] | None = None, passed: int | None = None) -> None:
        self._expressions: dict[Any, Expression] = {}
        self.routines = {} if routines is None else routines
        self.sines: dict[Expression, tuple[Any, Any]] = {}
        self.passed, self.turned = passed, list[Expression]()

    def make(self, kind: type[E], op: Op, *operands: Any, detail: Any = None) -> E:
        """The one expression with this operation, these operands and this detail."""
        key = (op, operands, detail)
        found = self._expressions.get(key)
        if found is None:
            self.require_own(operands)
            found = self._expressions[key] = kind(self, len(self._expressions), op, operands, detail)
        return cast(E, found)

    def known_sine(self, angle: Expression) -> tuple[Any, Any] | None:
        """Sine and cosine of an angle that are known or passed; None where they are to be computed."""
        if angle not in self.sines and self.passed is not None and angle.op is Op.INPUT:
            first = 2 * len(self.turned)
            self.turned.append(angle)
            sine, cosine = (self.make(type(angle), Op.INPUT, detail=(self.passed, first + k)) for k in (0, 1))
            self.sines[angle] = sine, cosine
        return self.sines.get(angle)

    def require_own(self, values: Iterable[Any]) -> None:
        """Raise `TraceError` when one of the values was traced elsewhere."""
        for x in values:
            if isinstance(x, Expression) and x.graph is not self:
                raise untraceable("a value of another trace was used: pass it to the function as an argument")


def reachable(outputs: Iterable[Any]) -> list[Expression]:
    """All expressions that the outputs need, operands first."""
    needed: set[Expression] = set()
    pending = [x for x in outputs if isinstance(x, Expression)]
    while pending:
        expression = pending.pop()
        if expression not in needed:
            needed.add(expression)
            pending += [x for x in expression.operands if isinstance(x, Expression)]
    return sorted(needed, key=lambda expression: expression.index)
