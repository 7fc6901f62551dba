"""LLVM IR for a traced routine: straight-line code over numbers side by side.

Every routine is a function of pointers, one to each argument and one to each part of its result. `contract` lets
multiplications and additions fuse; no other liberty is given, since general fast-math breaks the range reduction of
sine and cosine.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice

from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.layout import numbered
from adaptctl.compilation.routine import Routine, trace
from adaptctl.compilation.sine import FARTHEST, reduced

_ARITHMETIC = {Op.ADD: "fadd", Op.SUBTRACT: "fsub", Op.MULTIPLY: "fmul", Op.DIVIDE: "fdiv"}
_COMPARISONS = {Op.LESS: "olt", Op.LESS_EQUAL: "ole"}
_INTRINSICS = {Op.SQRT: "sqrt", Op.ABSOLUTE: "fabs", Op.MINIMUM: "minimum", Op.MAXIMUM: "maximum"}
_ANGLES = {Op.SIN: 0, Op.COS: 1}
_WIDE = (2, 4, 8)
"""Numbers of arguments whose sines are computed at once, where numbers are not side by side anyway."""


def program(routine: Routine, lanes: Lanes) -> tuple[str, str]:
    """The IR of a routine and of all it calls, and the name of the routine in it."""
    symbols = _symbols(routine)
    functions = [_function(r, symbols, lanes, "noinline") for r in symbols]
    if any(x.op in _ANGLES for r in symbols for x in r.body):
        functions.append(_sincos(lanes))
    widths = {wide for r in symbols for _, wide in _turned_together(r, lanes)}
    functions += [_sincos(wide, f".{wide.count}") for wide in sorted(widths, key=lambda wide: wide.count)]
    return "\n".join(functions), symbols[routine]


def _symbols(routine: Routine) -> dict[Routine, str]:
    """Names for the routine and all it calls, at any depth."""
    found: dict[Routine, str] = {}
    pending = [routine]
    while pending:
        r = pending.pop()
        if r not in found:
            found[r] = f"{re.sub('[^A-Za-z0-9_]', '_', r.name)}.{len(found)}"
            pending += r.calls
    return found


def _function(routine: Routine, symbols: Mapping[Routine, str], lanes: Lanes, inlining: str) -> str:
    inputs = [f"ptr noalias readonly %in{part}" for part in range(len(routine.inputs))]
    outputs = [f"ptr noalias %out{part}" for part in range(len(routine.layout.sizes))]
    body = _Body(symbols, lanes)
    wanted: dict[int, list[tuple[int, int]]] = {}
    for place, value in zip(numbered(routine.layout.sizes), routine.outputs, strict=True):
        if isinstance(value, Expression):
            wanted.setdefault(value.index, []).append(place)
        else:
            body.store(f"%out{place[0]}", place[1], value)
    for angles, wide in _turned_together(routine, lanes):
        body.turn(angles, wide)
    for expression in routine.body:
        body.compute(expression)
        for part, k in wanted.get(expression.index, ()):  # at once: registers are few
            body.store(f"%out{part}", k, expression)
    head = f"define internal void @{symbols[routine]}({', '.join(inputs + outputs)}) {inlining} {lanes.attributes} {{"
    return "\n".join([head, *body.memory, *body.lines, "ret void\n}"])


def _turned_together(routine: Routine, lanes: Lanes) -> list[tuple[list[Expression], Lanes]]:
    """Groups of arguments whose sines are computed at once, and in how many lanes: where one number is worked on at a
    time, an angle alone leaves most of a register empty."""
    asked = [x.operands[0] for x in routine.body if x.op in _ANGLES]
    angles = list(dict.fromkeys(x for x in asked if isinstance(x, Expression) and x.op is Op.INPUT))
    if lanes.count > 1 or len(angles) < 2:
        return []
    groups = [angles[k : k + _WIDE[-1]] for k in range(0, len(angles), _WIDE[-1])]
    return [(group, Lanes(next(wide for wide in _WIDE if wide >= len(group)))) for group in groups]


class _Body:
    """The instructions of one function: `memory` for the calls it makes is set aside first."""

    def __init__(self, symbols: Mapping[Routine, str], lanes: Lanes) -> None:
        self.memory: list[str] = []
        self.lines: list[str] = []
        self._symbols, self._lanes = symbols, lanes
        self._loaded: set[str] = set()

    def compute(self, expression: Expression) -> None:
        """One expression into its register; what is in memory is loaded where it is first used."""
        if expression.op is Op.CALL:
            self._call(f"%x{expression.index}", expression.detail, expression.operands)
        elif _place(expression) is None:
            self._evaluate(f"%x{expression.index}", expression.op, [self._operand(y) for y in expression.operands])

    def turn(self, angles: Sequence[Expression], wide: Lanes) -> None:
        """Sines and cosines of several angles, side by side for once."""
        value, several = wide.value, "zeroinitializer"
        for k, angle in enumerate(angles):
            self._add(
                f"%x{angle.index}.beside = insertelement {value} {several}, double {self._operand(angle)}, i32 {k}"
            )
            several = f"%x{angle.index}.beside"
        pairs = f"{several}.sincos"
        self._add(f"{pairs} = call {{{value}, {value}}} @sincos.{wide.count}({value} {several})")
        for part, name in enumerate(("sin", "cos")):
            self._add(f"{pairs}.{name} = extractvalue {{{value}, {value}}} {pairs}, {part}")
        for k, angle in enumerate(angles):
            x, pair = f"%x{angle.index}", "{double, double}"
            for part, name in enumerate(("sin", "cos")):
                self._add(f"{x}.{name} = extractelement {value} {pairs}.{name}, i32 {k}")
                before = f"{x}.half" if part else "undef"
                self._add(
                    f"{x}.{'sincos' if part else 'half'} = insertvalue {pair} {before}, double {x}.{name}, {part}"
                )
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
        elif op in _ANGLES:
            self._add(f"{x} = extractvalue {{{value}, {value}}} {self._sincos(operands[0])}, {_ANGLES[op]}")
        else:  # `nsz`: of two zeros, either may be the smaller
            arguments = ", ".join(f"{value} {y}" for y in operands)
            self._add(f"{x} = call nsz {value} @llvm.{_INTRINSICS[op]}.{self._lanes.suffix}({arguments})")

    def store(self, pointer: str, k: int, value: Expression | float) -> None:
        """A number into the k-th place after a pointer."""
        name, kind = f"{pointer}.{k}", self._lanes.value
        self._add(f"{name} = getelementptr {kind}, ptr {pointer}, i64 {k}")
        self._add(f"store {kind} {self._operand(value)}, ptr {name}, align 8")

    def _add(self, line: str) -> None:
        self.lines.append(line)

    def _operand(self, x: Expression | float) -> str:
        if not isinstance(x, Expression):
            return self._lanes.constant(x)
        name, place = f"%x{x.index}", _place(x)
        if place is not None and name not in self._loaded:
            self._loaded.add(name)
            self._add(f"{name}.at = getelementptr {self._lanes.value}, ptr {place[0]}, i64 {place[1]}")
            self._add(f"{name} = load {self._lanes.value}, ptr {name}.at, align 8")
        return name

    def _call(self, x: str, routine: Routine, operands: Iterable[Expression | float]) -> None:
        rest = iter(operands)
        groups = [list(islice(rest, size)) for size in routine.inputs]
        pointers = [self._gathered(f"{x}.in{part}", group) for part, group in enumerate(groups)]
        for part, size in enumerate(routine.layout.sizes):
            pointers.append(self._reserve(f"{x}.out{part}", size))
        self._add(f"call void @{self._symbols[routine]}({', '.join(f'ptr {pointer}' for pointer in pointers)})")

    def _gathered(self, name: str, group: Sequence[Expression | float]) -> str:
        """A pointer to these numbers side by side: where they already are so, or a copy."""
        places = [_place(x) if isinstance(x, Expression) else None for x in group]
        if places and places[0] and places == [(places[0][0], places[0][1] + k) for k in range(len(places))]:
            self._add(f"{name} = getelementptr {self._lanes.value}, ptr {places[0][0]}, i64 {places[0][1]}")
            return name
        self._reserve(name, len(group))
        for k, x in enumerate(group):
            self.store(name, k, x)
        return name

    def _reserve(self, name: str, size: int) -> str:
        self.memory.append(f"{name} = alloca [{size} x {self._lanes.value}], align {self._lanes.alignment}")
        return name

    def _sincos(self, angle: str) -> str:
        """The pair of an angle's sine and cosine, computed once."""
        pair = f"{{{self._lanes.value}, {self._lanes.value}}}"
        name = f"{angle}.sincos"
        if name not in self._loaded:
            self._loaded.add(name)
            self._add(f"{name} = call {pair} @sincos({self._lanes.value} {angle})")
        return name


def _place(x: Expression) -> tuple[str, int] | None:
    """Where an expression is in memory already, as a pointer and a number of places after it."""
    if x.op is Op.INPUT:
        return f"%in{x.detail[0]}", x.detail[1]
    if x.op is Op.RESULT:
        return f"%x{x.operands[0].index}.out{x.detail[0]}", x.detail[1]
    return None


def _sincos(lanes: Lanes, tag: str = "") -> str:
    """The functions that compute sines and cosines, their names ending in a tag."""
    near = trace(lambda x: reduced(x[0]), {"x": 1})
    whole = {"zero": 0, "one": 1, "second": 62, "last": 63, "sign": -(2**63)}
    numbers = {name: lanes.whole(k) for name, k in whole.items()}
    text = lanes.filled("sincos", farthest=lanes.constant(FARTHEST), tag=tag, **numbers)
    return f"{_function(near, {near: f'sincos.near{tag}'}, lanes, 'alwaysinline')}\n{text}"
