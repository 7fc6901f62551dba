"""The instructions of one native function: each expression in its register, or where it is in memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from typing import Any

from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.invariants import NONE, Invariants, arguments
from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.routine import Routine
from adaptctl.compilation.sine import STEP

ANGLES = {Op.SIN: 0, Op.COS: 1}
"""Operations on angles, and which of the pair of sine and cosine they ask for."""

_ARITHMETIC = {Op.ADD: "fadd", Op.SUBTRACT: "fsub", Op.MULTIPLY: "fmul", Op.DIVIDE: "fdiv"}
_COMPARISONS = {Op.LESS: "olt", Op.LESS_EQUAL: "ole"}
_INTRINSICS = {Op.SQRT: "sqrt", Op.ROUND: "rint", Op.ABSOLUTE: "fabs", Op.MINIMUM: "minimum", Op.MAXIMUM: "maximum"}


class FunctionBody:
    """Body of one native function, written as LLVM instructions, lines of text, expression by expression: `memory` has
    those that set aside memory for calls, which come first, and `lines` all others.

    Made of `symbols`, the functions' names by `Routine` (traced function), for calls; `lanes`, the `Lanes`, how many
    numbers are computed at once and in what precision; `found`, by index of expression, the places of values that
    earlier functions of the same routine left in memory at the pointer `%passed`; and `same`, the `Invariants`,
    expressions that are the same in all steps of a loop, which are in memory at `%same`, none unless given. A place is
    an index in values of all lanes; the expression of index i is in the register `%xi`. Nothing is checked.
    """

    def __init__(
        self, symbols: Mapping[Routine, str], lanes: Lanes, found: Mapping[int, int], same: Invariants = NONE
    ) -> None:
        self.memory: list[str] = []
        self.lines: list[str] = []
        self._symbols, self._lanes, self._found, self._same = symbols, lanes, found, same
        self._loaded: set[str] = set()
        self._together: dict[tuple[Any, ...], str] = {}

    def compute(self, expression: Expression) -> None:
        """Append the instructions that compute an `expression`, whose operands have been computed before. For one that
        is in memory already, such as an input, a call's result or an invariant, none are appended here: it is loaded
        where it is first used. Raises `KeyError` for a call of a routine without a name in `symbols`."""
        if expression.op is Op.CALL:
            self._call(f"%x{expression.index}", expression.detail, arguments(expression))
        elif self._place(expression) is not None:
            return
        elif expression.op in ANGLES:
            pair = f"{{{self._lanes.value}, {self._lanes.value}}}"
            turned = self._sincos(expression.operands[0])
            self._add(f"%x{expression.index} = extractvalue {pair} {turned}, {ANGLES[expression.op]}")
        else:
            self._evaluate(f"%x{expression.index}", expression.op, [self._operand(y) for y in expression.operands])

    def turn(self, angles: Sequence[Expression], wide: Lanes) -> None:
        """Append the instructions that compute sine and cosine of several `angles`, expressions in rad, in one call of
        a vector function; `wide` is its `Lanes`, 2, 4 or 8 and no fewer than angles. Sines and cosines that `compute`
        writes later are taken from these. It is for functions that otherwise work on one number at a time. Nothing is
        checked."""
        value, several = wide.value, "zeroinitializer"
        for k, angle in enumerate(angles):
            x, before = self._operand(angle), several
            several = f"{x}.beside"
            self._add(f"{several} = insertelement {value} {before}, {wide.scalar} {x}, i32 {k}")
        pairs = f"{several}.sincos"
        self._add(f"{pairs} = call {{{value}, {value}}} @sincos.{wide.count}({value} {several})")
        for part in ANGLES.values():
            self._add(f"{pairs}.{part} = extractvalue {{{value}, {value}}} {pairs}, {part}")
        for k, angle in enumerate(angles):
            x, pair = f"%x{angle.index}", f"{{{wide.scalar}, {wide.scalar}}}"
            for part, before, after in ((0, "undef", f"{x}.sine"), (1, f"{x}.sine", f"{x}.sincos")):
                self._add(f"{x}.{part} = extractelement {value} {pairs}.{part}, i32 {k}")
                self._add(f"{after} = insertvalue {pair} {before}, {wide.scalar} {x}.{part}, {part}")
            self._loaded.add(f"{x}.sincos")

    def _evaluate(self, x: str, op: Op, operands: Sequence[str]) -> None:
        value = self._lanes.value
        if op is Op.NEGATE:
            self._add(f"{x} = fneg {value} {operands[0]}")
        elif op is Op.SELECT:
            chosen, yes, no = operands
            self._add(f"{x} = select {self._lanes.condition} {chosen}, {value} {yes}, {value} {no}")
        elif op in _ARITHMETIC:
            self._add(f"{x} = {_ARITHMETIC[op]} contract {value} {', '.join(operands)}")
        elif op in _COMPARISONS:
            self._add(f"{x} = fcmp {_COMPARISONS[op]} {value} {', '.join(operands)}")
        else:  # `nsz`: of two zeros, either may be the smaller
            arguments = ", ".join(f"{value} {y}" for y in operands)
            self._add(f"{x} = call nsz {value} @llvm.{_INTRINSICS[op]}.{self._lanes.suffix}({arguments})")

    def store(self, pointer: str, k: int, value: Expression | float) -> None:
        """Append the instructions that write `value`, an expression that has been computed or a constant, into memory:
        into the place of index `k`, in values of all lanes, after the LLVM pointer of the name `pointer`, such as
        "%out0". Nothing is checked."""
        name, kind = f"{pointer}.{k}", self._lanes.value
        self._add(f"{name} = getelementptr {kind}, ptr {pointer}, i64 {k}")
        self._add(f"store {kind} {self._operand(value)}, ptr {name}, align {self._lanes.size}")

    def _add(self, line: str) -> None:
        self.lines.append(line)

    def _operand(self, x: Expression | float) -> str:
        if not isinstance(x, Expression):
            return self._lanes.constant(x)
        name, place = f"%x{x.index}", self._place(x)
        if place is not None and name not in self._loaded:
            self._loaded.add(name)
            self._add(f"{name}.at = getelementptr {self._lanes.value}, ptr {place[0]}, i64 {place[1]}")
            self._add(f"{name} = load {self._lanes.value}, ptr {name}.at, align {self._lanes.size}")
        return name

    def _call(self, x: str, routine: Routine, groups: Iterable[Sequence[Expression | float]]) -> None:
        pointers = [self._gathered(f"{x}.in{part}", group) for part, group in enumerate(groups)]
        for part, size in enumerate(routine.layout.sizes):
            pointers.append(self._reserve(f"{x}.out{part}", size))
        self._add(f"call void @{self._symbols[routine]}({', '.join(f'ptr {pointer}' for pointer in pointers)})")

    def _gathered(self, name: str, group: Sequence[Expression | float]) -> str:
        """A pointer to these numbers side by side: where they already are so, or a copy."""
        key = tuple(x.index if isinstance(x, Expression) else x for x in group)
        if key not in self._together:
            first = self._side_by_side(key, group)
            if first is None:
                self._reserve(name, len(group))
                for k, x in enumerate(group):
                    self.store(name, k, x)
            else:
                self._add(f"{name} = getelementptr {self._lanes.value}, ptr {first[0]}, i64 {first[1]}")
            self._together[key] = name
        return self._together[key]

    def _side_by_side(self, key: tuple[Any, ...], group: Sequence[Expression | float]) -> tuple[str, int] | None:
        """The place of the first of numbers that are in memory one after the other; None for others."""
        if key in self._same.groups:
            return "%same", self._same.groups[key]
        places = [self._place(x) if isinstance(x, Expression) else None for x in group]
        if places and places[0] and places == [(places[0][0], places[0][1] + k) for k in range(len(places))]:
            return places[0]
        return None

    def _reserve(self, name: str, size: int) -> str:
        self.memory.append(f"{name} = alloca [{size} x {self._lanes.value}], align {self._lanes.alignment}")
        return name

    def _sincos(self, angle: Expression) -> str:
        """The pair of an angle's sine and cosine, computed once: by a turn, where it is a step from a known one."""
        value, x = self._lanes.value, self._operand(angle)
        name, pair = f"{x}.sincos", f"{{{value}, {value}}}"
        if name not in self._loaded:
            self._loaded.add(name)
            step = self._step(angle)
            if step is None:
                self._add(f"{name} = call {pair} @sincos({value} {x})")
            else:
                known, farther = step
                self._add(f"{name} = call {pair} @sincos.turned({value} {x}, {value} {farther}, {pair} {known}.sincos)")
        return name

    def _step(self, angle: Expression) -> tuple[str, str] | None:
        """The angle of known sine from which another is a step in time, a velocity times a small number, and that
        step; None where there is none."""
        if angle.op is not Op.ADD or self._place(angle) is not None:
            return None
        for known, step in (angle.operands, angle.operands[::-1]):
            if _known(known, self._loaded) and _short(step):
                return self._operand(known), self._operand(step)
        return None

    def _place(self, x: Expression) -> tuple[str, int] | None:
        """The place of an expression that is in memory already: a pointer and a number of places after it. None for
        others."""
        if x.index in self._found:
            return "%passed", self._found[x.index]
        if x.index in self._same.places:
            return "%same", self._same.places[x.index]
        if x.op is Op.INPUT:
            return f"%in{x.detail[0]}", x.detail[1]
        if x.op is Op.RESULT:
            return f"%x{x.operands[0].index}.out{x.detail[0]}", x.detail[1]
        return None


def _known(angle: Any, loaded: Set[str]) -> bool:
    return isinstance(angle, Expression) and f"%x{angle.index}.sincos" in loaded


def _short(x: Any) -> bool:
    """True for a multiple of a number that is so small that it will hardly be a long turn."""
    return (
        isinstance(x, Expression)
        and x.op is Op.MULTIPLY
        and isinstance(x.operands[0], float)
        and abs(x.operands[0]) <= STEP
    )
