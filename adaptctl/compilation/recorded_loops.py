"""Operations on matrices as recorded loops, which native code and C are written from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from adaptctl.caching import cached_property
from adaptctl.compilation.graph import Op
from adaptctl.compilation.loops import (
    PARTS,
    Index,
    Matrix,
    Position,
    Shape,
    place,
)
from adaptctl.compilation.routine import Layout, Operations, Routine, numbered


@dataclass(frozen=True)
class Memory:
    """Array in memory: "in", "out" or "scratch", and its number among these."""

    kind: str
    number: int
    shape: Shape

    @property
    def name(self) -> str:
        """Name in code."""
        return f"{self.kind}{self.number}"


@dataclass(frozen=True)
class ArrayEntry:
    """ArrayEntry of an array; with `wide` the columns that a step takes at once."""

    memory: Memory
    row: Position
    column: Position
    wide: bool


Operand: TypeAlias = "Value | float"


@dataclass(frozen=True, eq=False)
class Value:
    """Number, or with `wide` the numbers of the columns that are taken at once."""

    wide: bool


@dataclass(frozen=True, eq=False)
class Computed(Value):
    """Result of arithmetic."""

    op: Op
    operands: tuple[Operand, ...]


@dataclass(frozen=True, eq=False)
class Read(Value):
    """Value of an entry, a variable or a sum."""

    source: ArrayEntry | Local


@dataclass(frozen=True, eq=False)
class Local:
    """Variable, or sum in `PARTS` parts."""

    number: int
    wide: bool
    is_sum: bool = False


@dataclass(frozen=True)
class Assign:
    """Assignment to an entry or a variable, addition to a sum; a sum's first is its zero."""

    target: ArrayEntry | Local
    value: Operand
    adds: bool = False


@dataclass(frozen=True)
class CountedLoop:
    """Steps for each number of a range; with `wide` it is columns, some of which are taken at once."""

    counter: int
    start: Position
    stop: Position
    wide: bool
    steps: list[Step] = field(default_factory=list)

    @property
    def entries(self) -> Iterator[ArrayEntry]:
        """Entries that are read or assigned here, at these columns."""
        for step in self.steps:
            if isinstance(step, CountedLoop):
                yield from step.entries
            found = step.source if isinstance(step, Read) else step.target if isinstance(step, Assign) else None
            if isinstance(found, ArrayEntry) and found.wide:
                yield found

    @cached_property
    def is_padded(self) -> bool:
        """True where columns may be taken beside those asked for."""
        return all(entry.memory.kind == "scratch" for entry in self.entries)

    @property
    def variables(self) -> int:
        """Variables that belong to these columns."""
        targets = [step.target for step in self.steps if isinstance(step, Assign)]
        return len({target for target in targets if isinstance(target, Local)})

    @cached_property
    def sums(self) -> bool:
        """True where a sum grows by these columns."""
        return any(isinstance(step, Assign) and step.adds for step in self.steps)


Step: TypeAlias = Computed | Read | Assign | CountedLoop


@dataclass(frozen=True)
class Columns:
    """Columns that a step takes at once."""

    first: Index


class Term:
    """Value under recording."""

    def __init__(self, recorder: Recorder, value: Value) -> None:
        self.recorder, self.value = recorder, value

    def __add__(self, other: Any) -> Term:
        return self.recorder.compute(Op.ADD, self, other)

    def __radd__(self, other: Any) -> Term:
        return self.recorder.compute(Op.ADD, other, self)

    def __sub__(self, other: Any) -> Term:
        return self.recorder.compute(Op.SUBTRACT, self, other)

    def __rsub__(self, other: Any) -> Term:
        return self.recorder.compute(Op.SUBTRACT, other, self)

    def __mul__(self, other: Any) -> Term:
        return self.recorder.compute(Op.MULTIPLY, self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Term:
        return self.recorder.compute(Op.DIVIDE, self, other)

    def __rtruediv__(self, other: Any) -> Term:
        return self.recorder.compute(Op.DIVIDE, other, self)


@dataclass
class RecordedArray:
    """Array under recording."""

    recorder: Recorder
    memory: Memory

    def __getitem__(self, key: Any) -> Term:
        entry = self._entry(key)
        return self.recorder.read(entry, wide=entry.wide)

    def __setitem__(self, key: Any, value: Any) -> None:
        self.recorder.assign(self._entry(key), value)

    def _entry(self, key: Any) -> ArrayEntry:
        row, column = place(key)
        wide = isinstance(column, Columns)
        return ArrayEntry(self.memory, row, column.first if wide else column, wide)


class RecordedVariable:
    """Variable under recording."""

    def __init__(self, recorder: Recorder, local: Local) -> None:
        self.recorder, self.local = recorder, local

    @property
    def value(self) -> Term:
        """Present value."""
        return self.recorder.read(self.local, wide=self.local.wide)

    @value.setter
    def value(self, value: Any) -> None:
        self.recorder.assign(self.local, value)


class RecordedSum:
    """Sum under recording."""

    def __init__(self, recorder: Recorder, local: Local) -> None:
        self.recorder, self.local = recorder, local

    def add(self, _column: Columns, term: Any) -> None:
        """Add the terms of columns."""
        self.recorder.assign(self.local, term, adds=True)

    @property
    def value(self) -> Term:
        """Sum of all terms."""
        return self.recorder.read(self.local, wide=False)


class Recorder:
    """Interpreter that records the steps of an operation."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.scratches: list[Memory] = []
        self.locals: list[Local] = []
        self._counters = 0
        self._wide = False

    def range(self, start: Position, stop: Position | None = None) -> Iterator[Index]:
        """Position in a new loop, once."""
        first, last = (0, start) if stop is None else (start, stop)
        yield from self._loop(first, last, wide=False)

    def columns(self, start: Position, stop: Position) -> Iterator[Columns]:
        """Columns of a new loop, once."""
        self._wide = True
        for counter in self._loop(start, stop, wide=True):
            yield Columns(counter)
        self._wide = False

    def scratch(self, rows: int, columns: int = 0) -> RecordedArray:
        """New array, whose rows begin at multiples of `PARTS`."""
        n, lines = (columns, rows) if columns else (rows, 1)
        self.scratches.append(Memory("scratch", len(self.scratches), Matrix(lines, n, -(-n // PARTS) * PARTS)))
        return RecordedArray(self, self.scratches[-1])

    def variable(self, value: Any) -> RecordedVariable:
        """New variable."""
        made = RecordedVariable(self, self._local(wide=self._wide))
        made.value = value
        return made

    def sum(self) -> RecordedSum:
        """New sum, zero."""
        local = self._local(wide=True, is_sum=True)
        self.assign(local, 0.0)
        return RecordedSum(self, local)

    def where_less(self, x: Any, y: Any, yes: Any, no: Any) -> Term:
        """`yes` where x < y, else `no`."""
        return self.compute(Op.SELECT, self.compute(Op.LESS, x, y), yes, no)

    def compute(self, op: Op, *terms: Any) -> Term:
        """Record arithmetic."""
        operands = tuple(map(_operand, terms))
        return self._value(Computed(any(isinstance(x, Value) and x.wide for x in operands), op, operands))

    def read(self, source: ArrayEntry | Local, *, wide: bool) -> Term:
        """Record that an entry, a variable or a sum is read."""
        return self._value(Read(wide, source))

    def assign(self, target: ArrayEntry | Local, value: Any, *, adds: bool = False) -> None:
        """Record an assignment."""
        self.steps.append(Assign(target, _operand(value), adds))

    def _loop(self, start: Position, stop: Position, *, wide: bool) -> Iterator[Index]:
        loop = CountedLoop(self._counters, start, stop, wide)
        self._counters += 1
        self.steps.append(loop)
        outer, self.steps = self.steps, loop.steps
        yield Index(((loop.counter, 1),))
        self.steps = outer

    def _local(self, *, wide: bool, is_sum: bool = False) -> Local:
        self.locals.append(Local(len(self.locals), wide, is_sum))
        return self.locals[-1]

    def _value(self, value: Computed | Read) -> Term:
        self.steps.append(value)
        return Term(self, value)


def _operand(x: Any) -> Operand:
    return x.value if isinstance(x, Term) else float(x)


@dataclass(frozen=True, eq=False)
class LoopRoutine:
    """Operation on matrices that a traced function calls as it calls a `Routine`."""

    name: str
    shapes: tuple[tuple[Shape, ...], tuple[Shape, ...]]
    steps: Sequence[Step]
    scratches: Sequence[Memory]
    locals: Sequence[Local]
    straight: Callable[[], Routine]

    subroutines: tuple[Routine, ...] = ()
    sines: tuple[int, ...] = ()

    @property
    def inputs(self) -> tuple[int, ...]:
        """Lengths of the arguments."""
        return tuple(shape.size for shape in self.shapes[0])

    @cached_property
    def layout(self) -> Layout:
        """Layout of the results, which are columns."""
        return Layout(tuple, tuple((shape.size,) for shape in self.shapes[1]))

    @cached_property
    def used_inputs(self) -> frozenset[tuple[int, int]]:
        """Scalars of the arguments that are read: all."""
        return frozenset(numbered(self.inputs))

    @cached_property
    def operations(self) -> Operations:
        """Scalar operations of one evaluation by kind."""
        return Operations(_counts(self.steps, {}))


def value_at(position: Position, counters: Mapping[int, int]) -> int:
    """Number that a position is, at these counters of loops."""
    if isinstance(position, int):
        return position
    return position.constant + sum(factor * counters[counter] for counter, factor in position.factors)


def _counts(steps: Sequence[Step], counters: Mapping[int, int]) -> Operations:
    total = Operations()
    for step in steps:
        if isinstance(step, CountedLoop):
            total.update(_loop_counts(step, counters))
        elif isinstance(step, Computed):
            total[step.op] += 1
        elif isinstance(step, Assign) and step.adds:
            total[Op.ADD] += 1
        elif isinstance(step, Read) and isinstance(step.source, Local) and step.source.is_sum:
            total[Op.ADD] += PARTS - 1
    return total


def _loop_counts(loop: CountedLoop, counters: Mapping[int, int]) -> Operations:
    numbers = range(value_at(loop.start, counters), value_at(loop.stop, counters))
    if not _steered_by(loop.steps, loop.counter):
        once = _counts(loop.steps, counters) if numbers else Operations()
        return Operations({op: n * len(numbers) for op, n in once.items()})
    total = Operations()
    for number in numbers:
        total.update(_counts(loop.steps, {**counters, loop.counter: number}))
    return total


def _steered_by(steps: Sequence[Step], counter: int) -> bool:
    loops = [step for step in steps if isinstance(step, CountedLoop)]
    bounds = [bound for loop in loops for bound in (loop.start, loop.stop) if isinstance(bound, Index)]
    return any(counter == c for bound in bounds for c, _ in bound.factors) or any(
        _steered_by(loop.steps, counter) for loop in loops
    )
