"""C functions of traced routines."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from adaptctl.codegen.c_function import CNumber, CStatements, Given, most_alive
from adaptctl.codegen.c_loops import CLoops
from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.landing import landings
from adaptctl.compilation.llvm import Piece, pieces
from adaptctl.compilation.recorded_loops import LoopRoutine
from adaptctl.compilation.routine import Routine, numbered

Numbered = tuple[int, int]
Before = Callable[[int, int], Numbered | None]
"""number of an argument that a result replaces, if any"""


class ConditionalStore:
    """Results that a condition may reset to earlier values."""

    def __init__(self, routine: Routine, piece: Piece, before: Before) -> None:
        uses = Counter(y for x in routine.body for y in x.operands if isinstance(y, Expression))
        uses.update(y for y in routine.outputs if isinstance(y, Expression))
        own = set(piece.expressions)
        self._choices: set[Expression] = set()
        self.conditions: dict[Expression, list[tuple[Numbered, Numbered]]] = {}
        for place, x in zip(numbered(routine.layout.sizes), routine.outputs, strict=True):
            given = before(*place)
            if isinstance(x, Expression) and x in own and uses[x] == 1 and given is not None and _puts_back(x, given):
                self._choices.add(x)
                self.conditions.setdefault(x.operands[0], []).append((place, given))
        left = [x for x in piece.expressions if x not in self._choices]
        self.piece = Piece(left, piece.kept, piece.found)

    def stored(self, x: Expression | float) -> Expression | float:
        """Value to store first, the new one of a choice."""
        if isinstance(x, Expression) and x in self._choices:
            kept: Expression | float = x.operands[2]
            return kept
        return x


def _puts_back(x: Expression, given: Numbered) -> bool:
    if x.op is not Op.SELECT:
        return False
    kept = x.operands[1]
    return isinstance(kept, Expression) and kept.op is Op.INPUT and tuple(kept.detail) == given


RETURN_ADDRESSES = 128
"""bytes of a call's frame besides numbers, about"""

Place = Callable[[int, int], str]
"""Text of where a result's number goes."""


def _nothing(_part: int, _k: int) -> None:
    """No replaced argument."""


@dataclass(frozen=True)
class Signature:
    """Signature of a C function, with texts of arguments and results."""

    name: str
    parameters: tuple[str, ...]
    given: Given
    place: Place
    before: Before = _nothing

    @property
    def arguments(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return tuple(re.findall(r"\w+$", text)[0] for text in self.parameters)


@dataclass(frozen=True)
class CSource:
    """Text of C functions, and approximate stack bytes."""

    text: str
    stack: int


class CProgram:
    """C functions of several routines, each written once."""

    def __init__(self, prefix: str, number: CNumber) -> None:
        self.prefix, self.number = prefix, number
        self.operations: set[Op] = set()
        self._symbols: dict[Routine, str] = {}
        self._stacks: dict[Routine, int] = {}

    def source(self, routine: Routine, signature: Signature) -> CSource:
        """C function of a routine with a signature."""
        texts = [self._called(inner) for inner in _callees(routine) if inner not in self._symbols]
        text, stack = self._functions(routine, signature)
        return CSource("\n".join([*texts, text]), stack)

    def on_arrays(self, routine: Routine, name: str, given: Sequence[str]) -> Signature:
        """Signature of a function that runs a routine on arrays."""
        real, restrict = f"{self.prefix}_real", f"{self.prefix.upper()}_RESTRICT"
        inputs = [f"const {real} *{restrict} {argument}" for argument in given]
        outputs = [f"{real} *{restrict} out{k}" for k in range(len(routine.layout.sizes))]
        return Signature(
            name, (*inputs, *outputs), lambda part, k: f"{given[part]}[{k}]", lambda part, k: f"out{part}[{k}]"
        )

    def _called(self, routine: Routine) -> str:
        name = re.sub(r"[^A-Za-z0-9_]", "_", routine.name).strip("_") or "part"
        self._symbols[routine] = f"{self.prefix}_{name}_{len(self._symbols)}"
        given = [f"in{k}" for k in range(len(routine.inputs))]
        signature = self.on_arrays(routine, self._symbols[routine], given)
        make = self._loops if isinstance(routine, LoopRoutine) else self._functions
        text, self._stacks[routine] = make(routine, signature)
        return text

    def _loops(self, routine: LoopRoutine, signature: Signature) -> tuple[str, int]:
        code = CLoops(self.prefix, self.number, routine)
        return _function(signature, code.lines, _names(code.lines)), code.numbers * self.number.size + RETURN_ADDRESSES

    def _functions(self, routine: Routine, signature: Signature) -> tuple[str, int]:
        """Functions of a routine and its pieces, and their stack."""
        self.operations |= {x.op for x in routine.body}
        parts = pieces(routine.body, landings(routine).places)
        if len(parts) == 1:
            return self._piece(routine, parts[0], signature)
        restrict = f"{self.prefix.upper()}_RESTRICT"
        shared = (*signature.parameters, f"{self.prefix}_real *{restrict} passed")
        inner = [
            Signature(f"{signature.name}_{k}", shared, signature.given, signature.place) for k in range(len(parts))
        ]
        made = [self._piece(routine, part, one) for part, one in zip(parts, inner, strict=True)]
        size = 1 + max((place for part in parts for place in part.kept.values()), default=0)
        calls = [f"{one.name}({', '.join(one.arguments)});" for one in inner]
        whole = _function(signature, [f"{self.prefix}_real passed[{size}];", *calls], set(signature.arguments))
        stack = max(stack for _, stack in made) + size * self.number.size + RETURN_ADDRESSES
        return "\n".join([*(text for text, _ in made), whole]), stack

    def _piece(self, routine: Routine, piece: Piece, signature: Signature) -> tuple[str, int]:
        places = {i: [f"passed[{place}]"] for i, place in piece.kept.items()}
        first = any(x is routine.body[0] for x in piece.expressions) if routine.body else True
        put_back = ConditionalStore(routine, piece, signature.before)
        own = set(put_back.piece.expressions)
        landed = landings(routine)
        code = CStatements(
            self.prefix, self.number, put_back.piece, self._symbols, signature.given, landed, signature.place
        )
        for (part, k), value in zip(numbered(routine.layout.sizes), routine.outputs, strict=True):
            stored, place = put_back.stored(value), signature.place(part, k)
            if isinstance(stored, Expression) and landed.places.get(stored.index) == (part, k):
                continue
            if isinstance(stored, Expression) and (stored is value or stored in own):
                places.setdefault(stored.index, []).append(place)
            elif first or stored is not value:
                code.store(place, stored)
        for x in put_back.piece.expressions:
            wanted = places.get(x.index, ())
            code.compute(x, named=bool(wanted) or x in put_back.conditions)
            for place in wanted:
                code.store(place, x)
        for condition, back in put_back.conditions.items():
            code.copy_where(condition, _runs(back, signature))
        used = _names(code.lines)
        alive = most_alive(put_back.piece.expressions, map(put_back.stored, routine.outputs)) + code.arrays
        called = max((self._stacks[x.detail] for x in piece.expressions if x.op is Op.CALL), default=0)
        return _function(signature, code.lines, used), alive * self.number.size + called + RETURN_ADDRESSES


def helpers(prefix: str, operations: set[Op]) -> str:
    """C functions of minimum and maximum, where used."""
    texts = []
    for op, sign in ((Op.MINIMUM, "<"), (Op.MAXIMUM, ">")):
        if op in operations:
            texts.append(
                f"/* The {'smaller' if op is Op.MINIMUM else 'larger'} of two numbers; NaN when either is. */\n"
                f"static {prefix}_real {prefix}_{op.value}({prefix}_real a, {prefix}_real b)\n"
                f"{{\n    return ((a {sign} b) || (a != a)) ? a : b;\n}}\n"
            )
    return "\n".join(texts)


def _names(lines: list[str]) -> set[str]:
    return set(re.findall(r"(?<![\w>.])[a-z]\w*", "\n".join(lines)))


def _function(signature: Signature, lines: list[str], used: set[str]) -> str:
    unused = [f"(void){name};" for name in signature.arguments if name not in used]
    body = "".join(f"    {line}\n" for line in (*unused, *lines))
    return f"static void {signature.name}({', '.join(signature.parameters)})\n{{\n{body}}}\n"


def _runs(back: list[tuple[tuple[int, int], tuple[int, int]]], signature: Signature) -> Iterator[tuple[str, str, int]]:
    """Contiguous copies: target, source and count."""
    for _, run in groupby(enumerate(back), lambda pair: (pair[1][0][0], pair[1][0][1] - pair[0])):
        pairs = [pair for _, pair in run]
        to, of = pairs[0]
        yield signature.place(*to), signature.given(*of), len(pairs)


def _callees(routine: Routine) -> list[Routine]:
    """All routines called at any depth, callees first."""
    found: dict[Routine, None] = {}

    def visit(outer: Routine) -> None:
        for inner in outer.subroutines:
            if inner not in found:
                visit(inner)
                found[inner] = None

    visit(routine)
    return list(found)
