"""A graph of expressions in which equal expressions are one object (hash consing; Ershov 1958)."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import Any, TypeVar, cast

from adaptctl.compilation.refusal import untraceable

E = TypeVar("E", bound="Expression")


class Op(StrEnum):
    """Kinds of operation of an `Expression` (a node in the graph of a traced function), each the text of its symbol or
    name. They are an input, + - * / and neg, sin and cos (rad), sqrt, round (to the nearest whole number, halves to the
    even one), abs, min, max, the comparisons < and <=, select (one of two values by a comparison), the call of a
    routine and a result of that call."""

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
    """Node of an expression graph, which records what a function computes of symbolic scalars; made by `Graph.make`,
    which checks it.

    It is the operation `op`, an `Op`, on `operands`, a tuple of earlier expressions of the same `graph` and of
    constants, plain floats. `index` is its number in the graph, from 0. `detail` has what operands cannot say: of an
    input, the indices, from 0, of the argument and of the scalar in it; of a call, the `Routine` (traced function) that
    is called; of a result, the indices of the part of the call's result and of the scalar in it; None for all others.
    """

    __slots__ = ("detail", "graph", "index", "op", "operands")

    def __init__(self, graph: Graph, index: int, op: Op, operands: tuple[Any, ...], detail: Any) -> None:
        self.graph, self.index, self.op, self.operands, self.detail = graph, index, op, operands, detail

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.index}: {self.op}>"


class Graph:
    """Expression graph of one trace, one run of a function on symbolic scalars, in which equal expressions are one
    object. The indices of operands are below those of what uses them, so that expressions can be computed in the order
    of their indices. Nothing is checked at construction.

    `routines` maps what has been called in the trace (a function, its arguments' layout and constants) to its traced
    `Routine`; the graph of a called function is given its caller's; None, the default, stands for an empty one. The
    attribute `sines` maps angles, expressions in rad, to the sine and cosine that are known of them. `passed`, None by
    default, is for the graph of a called function: the index, from 0, of the extra argument in which its caller passes
    sines and cosines, in pairs; the attribute `turned` lists the angles, inputs of the graph, whose sines and cosines
    these are, in the same order.
    """

    def __init__(self, routines: dict[Any, Any] | None = None, passed: int | None = None) -> None:
        self._expressions: dict[Any, Expression] = {}
        self.routines = {} if routines is None else routines
        self.sines: dict[Expression, tuple[Any, Any]] = {}
        self.passed, self.turned = passed, list[Expression]()

    def make(self, kind: type[E], op: Op, *operands: Any, detail: Any = None) -> E:
        """The one expression of this graph with the operation `op`, these `operands` (expressions and floats) and this
        `detail` (what operands cannot say, None by default): an earlier one where there is one, else a new one of the
        class `kind`. Raises `TraceError` where an operand is of another graph."""
        key = (op, operands, detail)
        found = self._expressions.get(key)
        if found is None:
            self.require_own(operands)
            found = self._expressions[key] = kind(self, len(self._expressions), op, operands, detail)
        return cast(E, found)

    def known_sine(self, angle: Expression) -> tuple[Any, Any] | None:
        """Sine and cosine, two expressions or floats, of `angle`, an expression of this graph in rad, where they are
        known; None where they are to be computed. For an unknown one that is an input of a called function (whose graph
        has `passed`) two inputs are added to the graph, its sine and cosine, which the caller will pass. Nothing is
        checked."""
        if angle not in self.sines and self.passed is not None and self._is_argument(angle):
            first = 2 * len(self.turned)
            self.turned.append(angle)
            sine, cosine = (self.make(type(angle), Op.INPUT, detail=(self.passed, first + k)) for k in (0, 1))
            self.sines[angle] = sine, cosine
        return self.sines.get(angle)

    def _is_argument(self, x: Expression) -> bool:
        """True for an input of a called function that is no sine which its caller passes."""
        return x.op is Op.INPUT and x.detail[0] != self.passed

    def require_own(self, values: Iterable[Any]) -> None:
        """Raise `TraceError` where one of the `values` is an expression of another graph: a value of another trace (run
        of a function on symbolic scalars), or of another called function. Floats and all else pass."""
        for x in values:
            if isinstance(x, Expression) and x.graph is not self:
                raise untraceable("a value of another trace was used: pass it to the function as an argument")


def reachable(outputs: Iterable[Any]) -> list[Expression]:
    """The expressions that `outputs` need, these among them, in a list in which operands come before what uses them.
    The outputs are of one graph; constants among them (floats) are passed over. Nothing is checked."""
    needed: set[Expression] = set()
    pending = [x for x in outputs if isinstance(x, Expression)]
    while pending:
        expression = pending.pop()
        if expression not in needed:
            needed.add(expression)
            pending += [x for x in expression.operands if isinstance(x, Expression)]
    return sorted(needed, key=lambda expression: expression.index)
