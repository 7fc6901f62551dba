"""Instructions of one native function."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from adaptctl.compilation.graph import CALL, INPUT, NEGATE, RESULT, Expression, Op
from adaptctl.compilation.landing import NOWHERE, Landings
from adaptctl.compilation.lanes import Instructions, Lanes
from adaptctl.compilation.routine import NONE, Invariants, Layout, Routine, arguments
from adaptctl.compilation.sine import SinesAtOnce, asked_at_once

ARITHMETIC = {Op.ADD: "fadd", Op.SUBTRACT: "fsub", Op.MULTIPLY: "fmul", Op.DIVIDE: "fdiv"}
_COMPARISONS = {Op.LESS: "olt", Op.LESS_EQUAL: "ole"}
_INTRINSICS = {Op.SQRT: "sqrt", Op.ROUND: "rint", Op.ABSOLUTE: "fabs", Op.MINIMUM: "minimum", Op.MAXIMUM: "maximum"}


RELOAD_DISTANCE = 40
"""Expressions without use of a value after which it is loaded again instead of kept in a register."""


MIN_CLEARED_ZEROS = 64
"""Zeros in a part of a result above which the part is cleared at once."""


class FunctionBody:
    """Body of one native function as LLVM instructions."""

    def __init__(
        self,
        expressions: Sequence[Expression],
        symbols: Mapping[Routine, str],
        lanes: Lanes,
        found: Mapping[int, int],
        same: Invariants = NONE,
        uniform: Container[int] = (),
        landed: Landings = NOWHERE,
        sines: tuple[Mapping[Expression, int], str] = (MappingProxyType({}), ""),
    ) -> None:
        self._uniform = uniform if lanes.count > 1 else ()
        self._text, self._lanes = Instructions(lanes), lanes
        self._symbols, self._found, self._same, self._landed = symbols, found, same, landed
        self._sines = SinesAtOnce(self._text, *sines)
        self._turns = asked_at_once([x for x in expressions if x.index not in found and x.index not in same.places])
        self._latest: dict[int, tuple[str, int]] = {}  # names, and how many expressions were written at the last use
        self._stored: dict[int, tuple[str, int]] = {}
        self._now = 0
        self._together: dict[tuple[Any, ...], str] = {}

    @property
    def lines(self) -> list[str]:
        """LLVM instructions of the body; those that set aside memory come first."""
        return [*self._text.memory, *self._text.lines]

    def compute(self, expression: Expression) -> None:
        """Append the instructions of an `expression`, after its operands'."""
        self._now += 1
        if expression.index in self._turns:
            self._sines.turn(self._turns[expression.index], self._operand, self._has)
        if expression.op is CALL:
            self._call(expression, expression.detail, arguments(expression))
        elif self._place(expression) is None:
            self._latest[expression.index] = self._evaluated(expression), self._now

    def store(self, pointer: str, k: int, value: Expression | float) -> None:
        """Append instructions that write a value into memory at index `k`."""
        self._text.store(pointer, k, self._operand(value))
        if isinstance(value, Expression):
            self._stored.setdefault(value.index, (pointer, k))

    def constants(self, layout: Layout, values: Sequence[Any]) -> None:
        """Append instructions that write the constants among a routine's results into memory."""
        for part, place in enumerate(layout.places):
            known = {k: x for k, x in enumerate(values[place]) if isinstance(x, float)}
            if sum(x == 0.0 for x in known.values()) > max(MIN_CLEARED_ZEROS, layout.sizes[part] // 2):
                self._text.clear(f"%out{part}", layout.sizes[part])
                known = {k: x for k, x in known.items() if x != 0.0}
            for k, x in known.items():
                self.store(f"%out{part}", k, x)

    def _evaluated(self, x: Expression) -> str:
        value, op, operands = self._lanes.value, x.op, [self._operand(y) for y in x.operands]
        if op in ARITHMETIC:
            return self._text.new(f"{ARITHMETIC[op]} contract {value} {', '.join(operands)}")
        if op is NEGATE:
            return self._text.new(f"fneg {value} {operands[0]}")
        if op is Op.SELECT:
            chosen, yes, no = operands
            return self._text.new(f"select {self._lanes.condition} {chosen}, {value} {yes}, {value} {no}")
        if op in _COMPARISONS:
            return self._text.new(f"fcmp {_COMPARISONS[op]} {value} {', '.join(operands)}")
        arguments = ", ".join(f"{value} {y}" for y in operands)  # `nsz`: of two zeros, either may be the smaller
        return self._text.new(f"call nsz {value} @llvm.{_INTRINSICS[op]}.{self._lanes.suffix}({arguments})")

    def _operand(self, x: Expression | float) -> str:
        """Name of a value."""
        if not isinstance(x, Expression):
            return self._lanes.constant(x)
        name, when = self._latest.get(x.index, ("", 0))
        if self._now - when > RELOAD_DISTANCE or not name:
            place = self._place(x) or self._stored.get(x.index)
            if place is not None:
                load = self._text.broadcast if self._is_uniform(x) else self._text.load
                name = load(*place)
            elif name and self._is_cheap(x):
                name = self._evaluated(x)
        self._latest[x.index] = name, self._now
        return name

    def _has(self, x: Expression) -> bool:
        return x.index in self._latest or self._place(x) is not None

    def _is_cheap(self, x: Expression) -> bool:
        homes = (not isinstance(y, Expression) or self._place(y) or y.index in self._stored for y in x.operands)
        return self._lanes.count > 1 and x.op in (Op.ADD, Op.SUBTRACT, Op.NEGATE) and all(homes)

    def _is_uniform(self, x: Expression) -> bool:
        return x.op is INPUT and x.detail[0] in self._uniform

    def _call(self, call: Expression, routine: Routine, groups: Iterable[Sequence[Expression | float]]) -> None:
        x, pointers = f"%x{call.index}", []
        for part, group in enumerate(groups):
            needed = [k for k in range(len(group)) if (part, k) in routine.used_inputs]
            pointers.append(self._gathered(f"{x}.in{part}", group, needed))
        for part, size in enumerate(routine.layout.sizes):
            pointers.append(self._result(call.index, part, size))
        self._text.add(f"call void @{self._symbols[routine]}({', '.join(f'ptr {pointer}' for pointer in pointers)})")

    def _result(self, call: int, part: int, size: int) -> str:
        name = f"%x{call}.out{part}"
        if (call, part) not in self._landed.calls:
            return self._text.reserve(name, size)
        into, first = self._landed.calls[call, part]
        self._text.add(f"{name} = getelementptr {self._lanes.value}, ptr %out{into}, i64 {first}")
        return name

    def _gathered(self, name: str, group: Sequence[Expression | float], needed: Sequence[int]) -> str:
        key = tuple(x.index if isinstance(x, Expression) else repr(x) for x in group), tuple(needed)
        if key not in self._together:
            first = self._side_by_side(key[0], group, needed)
            if first is None:
                self._text.reserve(name, len(group))
                for k in needed:
                    self.store(name, k, group[k])
            else:
                self._text.add(f"{name} = getelementptr {self._lanes.value}, ptr {first[0]}, i64 {first[1]}")
            self._together[key] = name
        return self._together[key]

    def _side_by_side(
        self, key: tuple[Any, ...], group: Sequence[Expression | float], needed: Sequence[int]
    ) -> tuple[str, int] | None:
        if key in self._same.groups:
            return "%same", self._same.groups[key]
        places = [self._place(x) if isinstance(x := group[k], Expression) else None for k in needed]
        if any(isinstance(x := group[k], Expression) and self._is_uniform(x) for k in needed):
            return None
        firsts = {place and (place[0], place[1] - k) for k, place in zip(needed, places, strict=True)}
        return firsts.pop() if len(firsts) == 1 else None

    def _place(self, x: Expression) -> tuple[str, int] | None:
        if x.index in self._found:
            return "%passed", self._found[x.index]
        if x.index in self._same.places:
            return "%same", self._same.places[x.index]
        if x.op is INPUT:
            return f"%in{x.detail[0]}", x.detail[1]
        if x.index in self._landed.places:
            part, k = self._landed.places[x.index]
            return f"%out{part}", k
        if x.op is RESULT:
            return f"%x{x.operands[0].index}.out{x.detail[0]}", x.detail[1]
        return self._sines.place(x)
