"""LLVM IR of recorded loops: independent columns side by side in vectors, sums in their stated parts."""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.compilation.function_body import ARITHMETIC
from adaptctl.compilation.graph import Op
from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.loops import PARTS, Matrix, Position
from adaptctl.compilation.recorded_loops import (
    ArrayEntry,
    Assign,
    Computed,
    CountedLoop,
    Local,
    LoopRoutine,
    Memory,
    Operand,
    Read,
    Step,
    Value,
)

BLOCK = 32
"""Numbers held by the variables of a loop over columns, while there are so many columns."""

REST = 4
"""Numbers computed at once after these."""


def loop_function(routine: LoopRoutine, symbol: str, lanes: Lanes) -> str:
    """LLVM function of recorded loops."""
    body = LoopBody(lanes)
    for memory in routine.scratches:
        body.reserve(memory)
    body.write(routine.steps)
    inputs = [f"ptr noalias readonly %in{k}" for k in range(len(routine.shapes[0]))]
    outputs = [f"ptr noalias %out{k}" for k in range(len(routine.shapes[1]))]
    head = f"define internal void @{symbol}({', '.join(inputs + outputs)}) noinline {lanes.attributes} {{"
    return "\n".join([head, *body.memory, *body.lines, "ret void\n}"])


class LoopBody:
    """Body of one function of loops as LLVM instructions."""

    def __init__(self, lanes: Lanes) -> None:
        self.memory: list[str] = []
        self.lines: list[str] = []
        self._lanes, self._names, self._width = lanes, 0, 1
        self._values: dict[Value, str] = {}
        self._locals: dict[Local, str] = {}

    def reserve(self, memory: Memory) -> None:
        """Append the instructions that set aside an array of zeros."""
        size = memory.shape.size
        self.memory.append(f"%{memory.name} = alloca [{size} x {self._lanes.value}], align 64")
        bytes_ = size * self._lanes.alignment
        self._add(f"call void @llvm.memset.p0.i64(ptr align 64 %{memory.name}, i8 0, i64 {bytes_}, i1 false)")

    def write(self, steps: Sequence[Step]) -> None:
        """Append the instructions of steps."""
        for step in steps:
            if isinstance(step, Read):
                self._values[step] = self._read(step.source)
            elif isinstance(step, Computed):
                self._values[step] = self._computed(step)
            elif isinstance(step, Assign):
                self._assign(step)
            elif step.wide:
                self._columns(step)
            else:
                self._loop(step, self._position(step.start), self._position(step.stop), 1)

    def _columns(self, loop: CountedLoop) -> None:
        first, last = self._position(loop.start), self._position(loop.stop)
        if loop.sums:
            self._loop(loop, *self._rounded(first, last, PARTS), PARTS)
            return
        rest = max(REST // self._lanes.count, 1)
        block = max(self._block(loop.variables), rest) if loop.variables else rest
        if loop.is_padded:
            first, last = self._rounded(first, last, rest)
        else:
            block, rest = rest, 1
        ends = self._new(f"sub i64 {last}, {block - 1}")
        after = self._loop(loop, first, ends, block)
        if block > rest:
            self._loop(loop, after, last, rest)

    def _block(self, variables: int) -> int:
        """Columns at once: a power of two, so that a multiple of it is one of less."""
        return 1 << max(BLOCK // (self._lanes.count * variables), 1).bit_length() - 1

    def _rounded(self, first: str, last: str, n: int) -> tuple[str, str]:
        up = self._new(f"add i64 {last}, {n - 1}")
        return self._new(f"and i64 {first}, {-n}"), self._new(f"and i64 {up}, {-n}")

    def _loop(self, loop: CountedLoop, first: str, last: str, width: int) -> str:
        """Loop in steps of `width`; where it ended."""
        label, counter = self._name("loop")[1:], f"%counter{loop.counter}"
        self._declare(counter, "i64")
        self._add(f"store i64 {first}, ptr {counter}")
        self._add(f"br label %{label}")
        self._add(f"{label}:")
        at = self._new(f"load i64, ptr {counter}")
        more = self._new(f"icmp slt i64 {at}, {last}")
        self._add(f"br i1 {more}, label %{label}.body, label %{label}.end")
        self._add(f"{label}.body:")
        outer, self._width = self._width, width if loop.wide else self._width
        self.write(loop.steps)
        self._width = outer
        self._add(f"store i64 {self._new(f'add nsw i64 {at}, {width}')}, ptr {counter}")
        self._add(f"br label %{label}")
        self._add(f"{label}.end:")
        return at

    def _read(self, source: ArrayEntry | Local) -> str:
        if isinstance(source, ArrayEntry):
            kind = self._type(wide=source.wide)
            return self._new(f"load {kind}, ptr {self._address(source)}, align {self._lanes.size}")
        if source.is_sum:
            return self._total(source)
        return self._new(f"load {self._type(wide=source.wide)}, ptr {self._locals[source]}")

    def _total(self, local: Local) -> str:
        """Sum of halves of halves of the parts."""
        n = PARTS * self._lanes.count
        x = self._new(f"load {self._vector(n)}, ptr {self._locals[local]}")
        while n > self._lanes.count:
            n, kind = n // 2, self._vector(n)
            halves = [self._picked(kind, x, range(start, start + n)) for start in (0, n)]
            x = self._new(f"fadd contract {self._vector(n)} {halves[0]}, {halves[1]}")
        return x

    def _assign(self, step: Assign) -> None:
        target = step.target
        if isinstance(target, ArrayEntry):
            kind, value = self._type(wide=target.wide), self._operand(step.value, wide=target.wide)
            self._add(f"store {kind} {value}, ptr {self._address(target)}, align {self._lanes.size}")
            return
        width = self._width
        if target.is_sum:
            self._width = PARTS
        kind, value = self._type(wide=target.wide), self._operand(step.value, wide=target.wide)
        where = self._locals[target] = f"%local{target.number}.{self._width if target.wide else 1}"
        self._declare(where, kind)
        if step.adds:
            value = self._new(f"fadd contract {kind} {self._new(f'load {kind}, ptr {where}')}, {value}")
        self._add(f"store {kind} {value}, ptr {where}")
        self._width = width

    def _computed(self, value: Computed) -> str:
        kind, operands = self._type(wide=value.wide), [self._operand(x, wide=value.wide) for x in value.operands]
        if value.op is Op.LESS:
            return self._new(f"fcmp olt {kind} {operands[0]}, {operands[1]}")
        if value.op is Op.SELECT:
            condition = kind.replace(self._lanes.scalar, "i1")
            return self._new(f"select {condition} {operands[0]}, {kind} {operands[1]}, {kind} {operands[2]}")
        return self._new(f"{ARITHMETIC[value.op]} contract {kind} {operands[0]}, {operands[1]}")

    def _operand(self, x: Operand, *, wide: bool) -> str:
        if isinstance(x, float):
            kind, one = self._type(wide=wide), Lanes(1, self._lanes.precision).constant(x)
            return f"splat ({self._lanes.scalar} {one})" if kind != self._lanes.scalar else one
        name = self._values[x]
        if x.wide or not wide:
            return name
        truth = isinstance(x, Computed) and x.op is Op.LESS
        return self._spread(name, self._lanes.value.replace(self._lanes.scalar, "i1") if truth else self._lanes.value)

    def _spread(self, name: str, value: str) -> str:
        """One number or truth value beside itself, once for each column."""
        count = self._lanes.count
        if self._width == 1:
            return name
        if count == 1:
            value, name = f"<1 x {value}>", self._new(f"insertelement <1 x {value}> poison, {value} {name}, i32 0")
        return self._picked(value, name, [lane for _ in range(self._width) for lane in range(count)])

    def _picked(self, kind: str, x: str, places: range | list[int]) -> str:
        if len(places) == 1:
            return self._new(f"extractelement {kind} {x}, i32 {places[0]}")
        mask = ", ".join(f"i32 {k}" for k in places)
        return self._new(f"shufflevector {kind} {x}, {kind} poison, <{len(places)} x i32> <{mask}>")

    def _address(self, entry: ArrayEntry) -> str:
        start, kind = f"%{entry.memory.name}", self._lanes.value
        if entry.row != 0:
            start = self._new(f"getelementptr inbounds {kind}, ptr {start}, i64 {self._row(entry)}")
        return self._new(f"getelementptr inbounds {kind}, ptr {start}, i64 {self._position(entry.column)}")

    def _row(self, entry: ArrayEntry) -> str:
        row, shape = self._position(entry.row), entry.memory.shape
        if isinstance(shape, Matrix):
            return self._new(f"mul nsw i64 {row}, {shape.pitch}")
        left = self._new(f"sub nsw i64 {2 * shape.k - 1}, {row}")
        return self._new(f"lshr i64 {self._new(f'mul nsw i64 {row}, {left}')}, 1")

    def _position(self, position: Position) -> str:
        if isinstance(position, int):
            return str(position)
        total = str(position.constant)
        for counter, factor in position.factors:
            term = self._new(f"load i64, ptr %counter{counter}")
            term = term if factor == 1 else self._new(f"mul nsw i64 {term}, {factor}")
            total = term if total == "0" else self._new(f"add nsw i64 {term}, {total}")
        return total

    def _type(self, *, wide: bool) -> str:
        return self._vector(self._lanes.count * (self._width if wide else 1))

    def _vector(self, n: int) -> str:
        return self._lanes.scalar if n == 1 else f"<{n} x {self._lanes.scalar}>"

    def _declare(self, name: str, kind: str) -> None:
        line = f"{name} = alloca {kind}"
        if line not in self.memory:
            self.memory.append(line)

    def _name(self, what: str) -> str:
        self._names += 1
        return f"%{what}{self._names}"

    def _new(self, instruction: str) -> str:
        name = self._name("t")
        self._add(f"{name} = {instruction}")
        return name

    def _add(self, line: str) -> None:
        self.lines.append(line)
