"""Traced functions and calls of them that are not unrolled."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, chain, islice
from typing import Any, NamedTuple, TypeVar, cast

from adaptctl.arrays import whole_count
from adaptctl.caching import cached_property
from adaptctl.compilation.graph import CALL, INPUT, RESULT, Expression, Graph, Op, cosine, reachable, sine
from adaptctl.compilation.node import Node, Value, lift
from adaptctl.errors import TraceError
from adaptctl.scalars import Column

MAX_COMPILED_LINKS = 100
"""Links up to which equations are compiled: LLVM takes 6 s for a mass matrix."""

Shape = tuple[int, ...]


class Layout(NamedTuple):
    """Layout of a function's result or arguments."""

    container: type[tuple[Any, ...]] | None
    shapes: tuple[Shape, ...]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of scalars in the parts of this layout."""
        return tuple(math.prod(shape) for shape in self.shapes)

    @property
    def places(self) -> tuple[slice, ...]:
        """Slices of the layout's parts (scalar, vector or matrix), in order."""
        return tuple(slice(end - size, end) for size, end in zip(self.sizes, accumulate(self.sizes), strict=True))

    @property
    def contain(self) -> Callable[[Iterator[Any]], Any]:
        """Function that puts parts into the layout's tuple."""
        return next if self.container is None else getattr(self.container, "_make", tuple)

    def restored(self, scalars: Sequence[Any]) -> Any:
        """Value of this layout from its scalars."""
        parts = (scalars[place] for place in self.places)
        return self.contain(_restored(part, shape) for part, shape in zip(parts, self.shapes, strict=True))


def numbered(sizes: Iterable[int]) -> list[tuple[int, int]]:
    """Pairs (part, index within it) for parts of these sizes."""
    return [(part, k) for part, size in enumerate(sizes) for k in range(size)]


def flatten(value: Any) -> tuple[Layout, list[Any]]:
    """Layout of a value, and its scalars in order."""
    container = type(value) if isinstance(value, tuple) else None
    parts = [_flat(part) for part in (value if isinstance(value, tuple) else (value,))]
    return Layout(container, tuple(shape for shape, _ in parts)), [x for _, scalars in parts for x in scalars]


def _flat(part: Any) -> tuple[Shape, list[Any]]:
    if isinstance(part, Column):
        return (len(part),), list(part)
    rows = part if isinstance(part, list) and all(isinstance(row, Column) for row in part) else []
    if len({len(row) for row in rows}) == 1:
        return (len(rows), len(rows[0])), [x for row in rows for x in row]
    return (), [part]


def _restored(scalars: Sequence[Any], shape: Shape) -> Any:
    if not shape:
        return scalars[0]
    if len(shape) == 1:
        return Column(scalars)
    rest = iter(scalars)
    return [Column(islice(rest, shape[1])) for _ in range(shape[0])]


F = TypeVar("F", bound=Callable[..., Any])

_FLOPS = (Op.ADD, Op.SUBTRACT, Op.MULTIPLY, Op.DIVIDE, Op.NEGATE)
_FREE = frozenset((INPUT, CALL, RESULT))


class Operations(Counter[Op]):
    """
    Counts of scalar operations by kind, those of called subroutines included.

    Parameters
    ----------
    iterable : mapping or iterable of Op, optional
        Counts by operation, or operations to count. Default: no operations.
    **kwds : int
        Counts by name, as for any ``collections.Counter``.

    Examples
    --------
    >>> from adaptctl.compilation import trace
    >>> trace(lambda x: x @ x, {"x": 3}, name="square").operations.flops
    5
    """

    @property
    def flops(self) -> int:
        """Number of additions, subtractions, multiplications, divisions and negations."""
        return sum(self[op] for op in _FLOPS)


@dataclass(frozen=True, eq=False)
class Routine:
    """
    Traced function: a graph of the expressions that it computes, as `trace` returns it.

    Parameters
    ----------
    name : str
        Name in messages.
    inputs : tuple of int
        Lengths of the arguments.
    outputs : tuple
        Scalars of the result, each an expression or a constant float.
    layout : Layout
        Shapes of the result's parts and their container.
    sines : tuple of int, optional
        Indices, for a function called within a trace, of the scalars whose sines and cosines the caller computes.

    Examples
    --------
    >>> from adaptctl.compilation import trace
    >>> trace(lambda x: 2.0 * x, {"x": 3}, name="double").inputs
    (3,)
    """

    name: str
    inputs: tuple[int, ...]
    outputs: tuple[Value, ...]
    layout: Layout
    sines: tuple[int, ...] = ()

    @cached_property
    def body(self) -> list[Expression]:
        """Expressions that the outputs depend on, in order of evaluation (operands first)."""
        return reachable(self.outputs)

    @cached_property
    def stored(self) -> dict[int, list[tuple[int, int]]]:
        """Places of expressions among the results, as pairs (part, index within it), by the expression's index."""
        found: dict[int, list[tuple[int, int]]] = {}
        for place, value in zip(numbered(self.layout.sizes), self.outputs, strict=True):
            if isinstance(value, Expression):
                found.setdefault(value.index, []).append(place)
        return found

    @cached_property
    def used_inputs(self) -> frozenset[tuple[int, int]]:
        """Scalars of the arguments that the outputs depend on, as pairs (argument index, entry index)."""
        return frozenset(x.detail for x in self.body if x.op is INPUT)

    @property
    def subroutines(self) -> list[Routine]:
        """Subroutines that this routine calls, in order of the calls."""
        return [x.detail for x in self.body if x.op is CALL]

    @cached_property
    def operations(self) -> Operations:
        """Counts of scalar operations by kind, those of called subroutines included."""
        total = Operations(x.op for x in self.body if x.op not in _FREE)
        for routine in self.subroutines:
            total.update(routine.operations)
        return total


def trace(function: Callable[..., Any], arguments: Mapping[str, int], *, name: str = "") -> Routine:
    """
    Record a function as a graph of expressions.

    Parameters
    ----------
    function : callable
        Function of `Column` vectors by keyword, called once with symbolic scalars. It returns a scalar, a column, a
        list of columns, or a tuple or NamedTuple of these.
    arguments : mapping of str to int
        Lengths n of the arguments by name.
    name : str, optional
        Name of the routine; the function's own by default.

    Returns
    -------
    Routine
        The recorded expressions.

    Raises
    ------
    TraceError
        If the result is of another kind, or the function needs a number that is not known yet, as in an ``if``.
    InputError
        If a length is not a whole number of at least 0.

    Examples
    --------
    >>> from adaptctl.compilation import Op, trace
    >>> trace(lambda x: x[0] * x[1], {"x": 2}, name="product").operations[Op.MULTIPLY]
    1
    """
    called = name or _name(function)
    graph, sizes = Graph(), tuple(whole_count(n, f"{called}: length of {x!r}") for x, n in arguments.items())
    columns = dict(zip(arguments, map(Column, _inputs(graph, sizes)), strict=True))
    return _routine(called, graph, sizes, function(**columns))


def outlined(function: F) -> F:
    """
    Wrap a function so that all its calls share one native subroutine instead of repeating its code.

    Parameters
    ----------
    function : callable
        Function of scalars and columns by position. Its result is a scalar, a column, a list of columns of one length,
        or a tuple or NamedTuple of these.

    Returns
    -------
    callable
        Wrapper of the function, to be made once. Outside of tracing, it just calls the function.

    Notes
    -----
    Constants among the arguments are folded: there is one subroutine for each pattern of constants. The last eight are
    kept for other traces.

    Examples
    --------
    >>> from adaptctl.compilation import outlined, trace
    >>> square = outlined(lambda x: x * x)
    >>> len(trace(lambda x: square(x[0]) + square(x[1]), {"x": 2}, name="sum").subroutines)
    2
    """

    kept: dict[Any, Routine] = {}

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        layout, scalars = flatten(arguments)
        values = [lift(x) for x in scalars]
        nodes = [x for x in values if isinstance(x, Node)]
        if not nodes or any(x is None for x in values):
            return function(*arguments)
        routine = _shared(function, layout, values, nodes[0].graph, kept)
        return routine.layout.restored(_results(routine, nodes))

    return cast(F, call)


MAX_KEPT_ROUTINES = 8
"""Traces of an outlined function that it keeps."""


def _shared(
    function: Callable[..., Any], layout: Layout, values: Sequence[Any], graph: Graph, kept: dict[Any, Routine]
) -> Routine:
    pattern = layout, tuple(None if isinstance(x, Node) else x for x in values)
    key = function, *pattern
    if key not in graph.routines:
        if pattern not in kept:
            while len(kept) >= MAX_KEPT_ROUTINES:
                kept.pop(next(iter(kept)), None)
            kept[pattern] = _traced(function, layout, values, graph)
        graph.routines[key] = kept[pattern]
    return cast(Routine, graph.routines[key])


def _traced(function: Callable[..., Any], layout: Layout, values: Sequence[Any], graph: Graph) -> Routine:
    rest = iter(values)
    sizes = tuple(sum(isinstance(x, Node) for x in islice(rest, size)) for size in layout.sizes)
    inner = Graph(graph.routines, passed=len(sizes))
    nodes = chain.from_iterable(_inputs(inner, sizes))
    scalars = [next(nodes) if isinstance(x, Node) else x for x in values]
    made = _routine(_name(function), inner, sizes, function(*layout.restored(scalars)))
    places = tuple(x.index for x in inner.turned)  # the inputs were made first
    return replace(made, inputs=(*sizes, 2 * len(places)), sines=places) if places else made


def _results(routine: Routine, nodes: Sequence[Node]) -> list[Value]:
    graph, of = nodes[0].graph, (sine, cosine)
    pairs = [(f, nodes[place]) for place in routine.sines for f in of]
    passed = len(routine.inputs) - 1
    sines = [f(x) if (passed, k) in routine.used_inputs else 0.0 for k, (f, x) in enumerate(pairs)]
    call = graph.make(Expression, CALL, *nodes, *sines, detail=routine)
    return [
        graph.make(Node, RESULT, call, detail=place) if isinstance(output, Node) else output
        for place, output in zip(numbered(routine.layout.sizes), routine.outputs, strict=True)
    ]


def _routine(name: str, graph: Graph, inputs: tuple[int, ...], result: Any) -> Routine:
    layout, scalars = flatten(result)
    outputs = tuple(_output(name, x) for x in scalars)
    graph.validate_own(outputs)
    graph.close()
    return Routine(name, inputs, outputs, layout)


def _output(name: str, scalar: Any) -> Value:
    value = lift(scalar)
    if value is None:
        kind = type(scalar).__name__
        raise TraceError(f"{name}: expected a scalar, a Column or a tuple of these as result, got {kind}")
    return value


def _inputs(graph: Graph, sizes: Sequence[int]) -> list[list[Node]]:
    """Nodes of each argument."""
    parts = enumerate(sizes)
    return [[graph.make(Node, INPUT, detail=(part, k)) for k in range(size)] for part, size in parts]


def _name(function: Callable[..., Any]) -> str:
    return str(getattr(function, "__name__", "function"))


_IN_EACH_STEP = frozenset((CALL, RESULT, Op.LESS, Op.LESS_EQUAL))
"""Calls, and comparisons, which memory cannot hold."""


class Invariants(NamedTuple):
    """Loop invariants of a step's routine."""

    computed: frozenset[Expression]
    stored: list[Expression]
    places: dict[int, int]
    groups: dict[tuple[int, ...], int]

    @classmethod
    def of(cls, routine: Routine, held: Collection[int]) -> Invariants:
        """Loop invariants of a step with constant arguments `held`."""
        same = _same(routine.body, held)
        found = cls(frozenset(x for x in same if x.op is not INPUT), [], {}, {})
        later = [x for x in routine.body if x not in found.computed]
        calls = [group for x in later if x.op is CALL for group in arguments(x)]
        for group in calls:
            if found._any(group) and all(x in same for x in group):
                found._store_together(group)
        for values in (*calls, *(x.operands for x in later if x.op is not CALL), routine.outputs):
            for x in values:
                if type(x) is not float and x in found.computed and x.index not in found.places:
                    found._store((x,))
        return found

    def before(self, routine: Routine) -> Routine:
        """Routine of the loop invariants."""
        values: tuple[Any, ...] = tuple(self.stored)
        return Routine(f"{routine.name} before", routine.inputs, values, Layout(None, ((len(values),),)))

    def left(self, routine: Routine) -> list[Expression]:
        """Expressions of each step, operands first."""
        results = {x for x in routine.outputs if isinstance(x, Expression)}
        return [x for x in routine.body if x not in self.computed or x in results]

    def _any(self, values: Sequence[Any]) -> bool:
        return any(isinstance(x, Expression) and x in self.computed for x in values)

    def _store_together(self, group: Sequence[Expression]) -> None:
        key = tuple(x.index for x in group)
        first = self.places.get(key[0], -1)
        if any(self.places.get(i) != first + k for k, i in enumerate(key)) and key not in self.groups:
            self.groups[key] = len(self.stored)
            self._store(group)

    def _store(self, values: Sequence[Expression]) -> None:
        for x in values:
            if x in self.computed:
                self.places.setdefault(x.index, len(self.stored))
            self.stored.append(x)


NONE = Invariants(frozenset(), [], {}, {})


def arguments(call: Expression) -> Iterator[list[Any]]:
    """Iterator over the arguments of a call."""
    rest = iter(call.operands)
    return (list(islice(rest, size)) for size in call.detail.inputs)


def _same(body: Sequence[Expression], held: Collection[int]) -> set[Expression]:
    """Expressions that depend on arguments of these indices alone."""
    same: set[Expression] = set()
    for x in body:
        if x.op is INPUT:
            if x.detail[0] in held:
                same.add(x)
        elif x.op not in _IN_EACH_STEP:
            for y in x.operands:
                if type(y) is not float and y not in same:
                    break
            else:
                same.add(x)
    return same
