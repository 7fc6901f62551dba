"""C of recorded loops."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from adaptctl.codegen.c_function import INFIX, CNumber
from adaptctl.compilation.graph import Op
from adaptctl.compilation.loops import PARTS, Matrix, Position, sum_of_halves
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


class CLoops:
    """Writer of the C statements of recorded loops."""

    def __init__(self, prefix: str, number: CNumber, routine: LoopRoutine) -> None:
        self.lines: list[str] = []
        self._real, self._number, self._routine = f"{prefix}_real", number, routine
        self._uses = Counter(used for step in _all(routine.steps) for used in _used(step))
        self._texts: dict[Value, str] = {}
        self._waiting: dict[Value, str] = {}
        self._margin, self._names, self._column = "", 0, ""
        for memory in routine.scratches:
            self._add(f"{self._real} {memory.name}[{c_size(memory)}] = {{{number.text(0.0)}}};")
        for local in routine.locals:
            self._add(f"{self._real} x{local.number}{f'[{PARTS}]' if local.is_sum else ''};")
        self._write(routine.steps)

    @property
    def numbers(self) -> int:
        """Numbers on the stack, about."""
        return sum(map(c_size, self._routine.scratches)) + PARTS * len(self._routine.locals)

    def _write(self, steps: Sequence[Step]) -> None:
        for step in steps:
            if isinstance(step, Computed | Read):
                self._evaluate(step)
            elif isinstance(step, Assign):
                self._assign(step)
            else:
                self._loop(step)

    def _loop(self, loop: CountedLoop) -> None:
        self._settle()
        i = f"i{loop.counter}"
        start, stop = _position(loop.start), _position(loop.stop)
        self._add(f"for (int {i} = {start}; {i} < {stop}; {i}++) {{")
        self._column = i if loop.wide else self._column
        outer, self._margin = self._margin, self._margin + "    "
        self._write(loop.steps)
        self._margin = outer
        self._add("}")

    def _evaluate(self, value: Computed | Read) -> None:
        text = self._text(value)
        if self._uses[value] == 1:
            self._waiting[value] = text
        else:
            self._name(value, text)

    def _text(self, value: Computed | Read) -> str:
        if isinstance(value, Read):
            return _read(value.source)
        operands = [self._operand(y) for y in value.operands]
        if value.op is Op.SELECT:
            return f"({operands[0]} ? {operands[1]} : {operands[2]})"
        return f"({f' {INFIX[value.op]} '.join(operands)})"

    def _operand(self, x: Operand) -> str:
        if isinstance(x, float):
            return self._number.text(x)
        return self._waiting.pop(x, None) or self._texts[x]

    def _assign(self, step: Assign) -> None:
        value, target = self._operand(step.value), step.target
        self._settle()
        value = value[1:-1] if value.startswith("(") and isinstance(step.value, Value) else value
        if isinstance(target, ArrayEntry):
            self._add(f"{_place(target)} = {value};")
        elif not target.is_sum:
            self._add(f"x{target.number} = {value};")
        elif step.adds:
            part = f"x{target.number}[{self._column} % {PARTS}]"
            self._add(f"{part} = {part} + {value};")
        else:
            self._add(f"for (int n = 0; n < {PARTS}; n++) {{")
            self._add(f"    x{target.number}[n] = {value};")
            self._add("}")

    def _settle(self) -> None:
        """Name what was read before memory changes."""
        for value, text in list(self._waiting.items()):
            self._name(value, text)
        self._waiting.clear()

    def _name(self, value: Value, text: str) -> None:
        self._names += 1
        self._texts[value] = f"v{self._names}"
        is_truth = isinstance(value, Computed) and value.op is Op.LESS
        kind = "int" if is_truth else self._real
        self._add(f"const {kind} v{self._names} = {text};")

    def _add(self, line: str) -> None:
        self.lines.append(self._margin + line)


def c_size(memory: Memory) -> int:
    """Numbers of a scratch array in C, where rows have no gaps."""
    shape = memory.shape
    return shape.rows * shape.columns if isinstance(shape, Matrix) else shape.size


def _all(steps: Sequence[Step]) -> Iterator[Computed | Read | Assign]:
    for step in steps:
        if isinstance(step, CountedLoop):
            yield from _all(step.steps)
        else:
            yield step


def _used(step: Computed | Read | Assign) -> list[Value]:
    operands = step.operands if isinstance(step, Computed) else (step.value,) if isinstance(step, Assign) else ()
    return [x for x in operands if isinstance(x, Value)]


def _read(source: ArrayEntry | Local) -> str:
    if isinstance(source, ArrayEntry):
        return _place(source)
    x = f"x{source.number}"
    if not source.is_sum:
        return x
    return str(sum_of_halves([f"{x}[{k}]" for k in range(PARTS)], "({} + {})".format))


def _place(entry: ArrayEntry) -> str:
    return f"{entry.memory.name}[{_offset(entry)}]"


def _offset(entry: ArrayEntry) -> str:
    column, row, shape = _position(entry.column), _position(entry.row), entry.memory.shape
    if entry.row == 0:
        return column
    if isinstance(shape, Matrix):
        pitch = shape.columns if entry.memory.kind == "scratch" else shape.pitch
        return f"{pitch} * {_factor(row)} + {column}"
    return f"{_factor(row)} * ({2 * shape.k - 1} - {_factor(row)}) / 2 + {column}"


def _factor(text: str) -> str:
    return text if text.isalnum() else f"({text})"


def _position(position: Position) -> str:
    if isinstance(position, int):
        return str(position)
    terms = [f"i{c}" if factor == 1 else f"{factor} * i{c}" for c, factor in position.factors if factor > 0]
    less = [f"i{c}" if factor == -1 else f"{-factor} * i{c}" for c, factor in position.factors if factor < 0]
    if position.constant > 0 or not terms:
        terms.append(str(position.constant))
    if position.constant < 0:
        less.append(str(-position.constant))
    return " - ".join([" + ".join(terms), *less])
