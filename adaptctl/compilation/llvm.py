"""LLVM IR of a traced routine."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from functools import cache, lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from adaptctl.compilation.function_body import FunctionBody
from adaptctl.compilation.graph import INPUT, RESULT, Expression, Op
from adaptctl.compilation.landing import NOWHERE, Landings, landings
from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.routine import NONE, Invariants, Routine, trace
from adaptctl.compilation.sine import MAX_SINE_STEP, sine_for

if TYPE_CHECKING:
    from adaptctl.compilation.recorded_loops import LoopRoutine

PROLOGUE_SUFFIX = ".before"
"""suffix of the name of a step's prologue"""


class Program(NamedTuple):
    """
    LLVM IR of a routine with its calls, and its function's name.

    `pieces` is a module beside it, for code that is made quickly: of a routine for few steps, or of one in pieces that
    calls loops on matrices, which take most of its time.
    """

    text: str
    symbol: str
    pieces: str = ""
    quick: bool = False

    def entered_by(self, function: str) -> tuple[str, str]:
        """Both modules, with a function that calls this in the first one that is not empty."""
        return (f"{self.text}\n{function}", self.pieces) if self.text else ("", f"{self.pieces}\n{function}")


def program(
    routine: Routine,
    lanes: Lanes,
    same: Invariants = NONE,
    uniform: Container[int] = (),
    apart: Mapping[Any, str] = MappingProxyType({}),
    quick: bool = False,
) -> Program:
    """Program of a routine; routines `apart` have another module. Code in one lane can be for few steps (`quick`)."""
    symbols = _symbols(routine) | dict(apart)
    declared = _declared(apart)
    called = {r: _called(r, symbols, lanes) for r in symbols if r is not routine and r not in apart}
    functions, landed, symbol = [*called.values(), *declared], landings(routine).places, symbols[routine]
    if same.stored:
        before = same.before(routine)
        symbols[before] = f"{symbol}{PROLOGUE_SUFFIX}"
        functions.append(_function(before, pieces(before.body), symbols, lanes))
    parts = pieces(same.left(routine) if same.stored else routine.body, {**same.places, **landed})
    own = _function(routine, parts, symbols, lanes, same, uniform)
    straight = all(isinstance(r, Routine) for r in symbols)
    whole = len(parts) == 1 or straight
    if whole and not quick:
        return Program(_with_sines([*functions, own], lanes), symbol)
    from adaptctl.compilation.fusing import fused  # few programs are made quickly

    if quick and straight:
        return Program("", symbol, _with_sines([fused(text) for text in (*functions, own)], lanes), quick)
    own = fused(own) if whole else own
    declared += _declared({r: symbols[r] for r in called})
    functions = [text.replace("define internal void", "define void") for text in functions]
    functions.append(f"declare void @{symbol}({', '.join(_pointers(routine, same))})")
    own = own.replace(f"define internal void @{symbol}(", f"define void @{symbol}(")
    return Program(_with_sines(functions, lanes), symbol, _with_sines([*declared, own], lanes), whole)


def _with_sines(functions: Sequence[str], lanes: Lanes) -> str:
    text = "\n".join(functions)
    return f"{text}\n{_sines(text, lanes)}"


MIN_APART = 250
"""Expressions of a routine from which it has a module of its own, compiled once for all that call it."""


def worth_a_module(routine: Routine) -> list[Routine]:
    """Long routines that a routine calls, and that call none but such; what is called first."""
    found: dict[Routine, None] = {}
    for r in dict.fromkeys(routine.subroutines):
        if isinstance(r, Routine):
            found |= dict.fromkeys(worth_a_module(r))
            if len(r.body) >= MIN_APART and found.keys() >= set(r.subroutines):
                found[r] = None
    return list(found)


@lru_cache(maxsize=8)  # of equations of motion, which each law on a plant calls
def module_of(routine: Routine, lanes: Lanes, target: str) -> tuple[str, str]:
    """LLVM IR of a module of one routine, and its function's name, which tells its content and the `target`."""
    apart = {r: module_of(r, lanes, target)[1] for r in worth_a_module(routine)}
    text = _called(routine, {routine: _NAME, **apart}, lanes).replace("define internal void", "define void")
    text = "\n".join([*_declared(apart), text, _sines(text, lanes)])
    symbol = f"{_NAME}.{hashlib.sha256((target + text).encode()).hexdigest()[:32]}"
    return text.replace(f"@{_NAME}(", f"@{symbol}("), symbol


def _declared(symbols: Mapping[Routine, str]) -> list[str]:
    return [f"declare void @{symbol}({', '.join(_pointers(r, NONE))})" for r, symbol in symbols.items()]


_NAME = "shared"


def _called(routine: Routine | LoopRoutine, symbols: Mapping[Any, str], lanes: Lanes) -> str:
    if not isinstance(routine, Routine):
        from adaptctl.compilation.loop_llvm import loop_function  # few laws have matrices

        return loop_function(routine, symbols[routine], lanes)
    return _function(routine, pieces(routine.body, landings(routine).places), symbols, lanes)


def _symbols(routine: Routine) -> dict[Routine, str]:
    found: dict[Routine, str] = {}
    pending = [routine]
    while pending:
        r = pending.pop()
        if r not in found:
            found[r] = f"of_{re.sub('[^A-Za-z0-9_]', '_', r.name)}.{len(found)}"  # a digit may not come first
            pending += r.subroutines
    return found


def _function(
    routine: Routine,
    parts: Sequence[Piece],
    symbols: Mapping[Routine, str],
    lanes: Lanes,
    same: Invariants = NONE,
    uniform: Container[int] = (),
) -> str:
    symbol, landed = symbols[routine], landings(routine)
    if len(parts) == 1:
        return _piece(routine, parts[0], symbol, symbols, lanes, same, uniform, landed)
    inner = {f"{symbol}.piece{k}": part for k, part in enumerate(parts)}
    functions = [
        _piece(routine, part, name, symbols, lanes, same, uniform, landed, shared=True) for name, part in inner.items()
    ]
    passed = 1 + max((place for part in parts for place in part.kept.values()), default=0)
    pointers = [*_pointers(routine, same), "ptr %passed"]
    head = f"define internal void @{symbol}({', '.join(pointers[:-1])}) noinline {lanes.attributes} {{"
    body = FunctionBody((), symbols, lanes, {})
    body.constants(routine.layout, routine.outputs)  # not in the pieces, each of which would write them all
    memory = f"%passed = alloca [{passed} x {lanes.value}], align {lanes.alignment}"
    calls = [f"call void @{name}({', '.join(pointers)})" for name in inner]
    return "\n".join([*functions, head, memory, *body.lines, *calls, "ret void\n}"])


def _piece(
    routine: Routine,
    piece: Piece,
    symbol: str,
    symbols: Mapping[Routine, str],
    lanes: Lanes,
    same: Invariants = NONE,
    uniform: Container[int] = (),
    landed: Landings = NOWHERE,
    *,
    shared: bool = False,
    inlining: str = "noinline",
) -> str:
    body = FunctionBody(piece.expressions, symbols, lanes, piece.found, same, uniform, landed, _passed_sines(routine))
    if not shared:
        body.constants(routine.layout, routine.outputs)
    for expression in piece.expressions:
        body.compute(expression)
        if expression.index in piece.kept:
            body.store("%passed", piece.kept[expression.index], expression)
        for part, k in routine.stored.get(expression.index, ()):  # at once: registers are few
            if landed.places.get(expression.index) != (part, k):
                body.store(f"%out{part}", k, expression)
    pointers = [*_pointers(routine, same, " noalias"), *(["ptr noalias %passed"] if shared else [])]
    head = f"define internal void @{symbol}({', '.join(pointers)}) {inlining} {lanes.attributes} {{"
    return "\n".join([head, *body.lines, "ret void\n}"])


def _passed_sines(routine: Routine) -> tuple[Mapping[Expression, int], str]:
    """Angles whose sine and cosine are an argument, and where the sine is; the argument's name."""
    last, used = len(routine.inputs) - 1, routine.used_inputs
    places = {k: 2 * i for i, k in enumerate(routine.sines) if {(last, 2 * i), (last, 2 * i + 1)} <= used}
    return {x: places[x.index] for x in routine.body if x.index in places}, f"%in{last}"


def _pointers(routine: Routine, same: Invariants, promise: str = "") -> list[str]:
    read = f"{promise} readonly" if promise else ""
    inputs = [f"ptr{read} %in{part}" for part in range(len(routine.inputs))]
    outputs = [f"ptr{promise} %out{part}" for part in range(len(routine.layout.sizes))]
    return inputs + outputs + ([f"ptr{read} %same"] if same.stored else [])


def _sines(text: str, lanes: Lanes) -> str:
    called = set(_SINES.findall(text))
    counts = {int(name.rpartition(".")[2]) for name in called if name[-1].isdecimal()}
    if not counts:
        return ""
    limits = {"farthest": lanes.constant(sine_for(lanes.precision).farthest), "longest": lanes.constant(MAX_SINE_STEP)}
    near = [_near_sines(Lanes(count, lanes.precision)) for count in sorted(counts | {lanes.count})]
    whole = "\n".join([*near, lanes.filled("sincos_reduction", tag=f".{lanes.count}", **limits)])
    kept = list[str]()
    for function in reversed(_FUNCTION.findall(whole)):  # each calls those before it
        name, *others = _SINES.findall(function)
        if name in called:
            kept.insert(0, function)
            called.update(others)
    return "\n".join(kept)


_SINES, _FUNCTION = re.compile(r"@(sines\.[\w.]+)\("), re.compile(r"^define.*?^}$", re.DOTALL | re.MULTILINE)


@cache
def _near_sines(lanes: Lanes) -> str:
    sine, tag, last = sine_for(lanes.precision), f".{lanes.count}", 8 * lanes.size - 1
    near = trace(lambda x: sine.reduced(x[0]), {"x": 1})
    step = trace(lambda x: sine.turned(*x), {"x": 3})
    numbers = {"zero": 0, "one": 1, "second": last - 1, "last": last, "sign": -(2**last)}
    inlined = {f"sines.reduced{tag}": near, f"sines.step{tag}": step}
    parts = [_piece(r, Piece(r.body, {}, {}), name, {}, lanes, inlining="alwaysinline") for name, r in inlined.items()]
    return "\n".join([*parts, lanes.filled("sines", tag=tag, **{name: lanes.whole(k) for name, k in numbers.items()})])


MAX_WHOLE_EXPRESSIONS = 6000
"""Expressions in a routine that is left whole, without those that are in memory before."""

PIECE_EXPRESSIONS = 1500
"""Expressions in a piece of a longer one, about."""

_NOT_PASSED = frozenset((INPUT, Op.CALL, Op.LESS, Op.LESS_EQUAL))


class Piece(NamedTuple):
    """Part of a long routine, compiled as a function."""

    expressions: Sequence[Expression]
    kept: dict[int, int]
    found: dict[int, int]


def pieces(body: Sequence[Expression], given: Container[int] = ()) -> list[Piece]:
    """Parts of a routine's expressions, in order."""
    whole, *others = _parts(body)
    if not others:
        return [Piece(whole, {}, {})]
    parts = [_with_truths(part) for part in (whole, *others)]
    homes = {x.index: k for k, part in reversed(list(enumerate(parts))) for x in part}
    used = [_operands(part, given) for part in parts]
    needed = [{i for i in indices if homes[i] < k} for k, indices in enumerate(used)]
    places = _places(homes, needed)
    made = []
    for k, part in enumerate(parts):
        kept = {x.index: places[x.index] for x in part if x.index in places and homes[x.index] == k}
        made.append(Piece(part, kept, {i: places[i] for i in needed[k]}))
    return made


def _parts(body: Sequence[Expression]) -> Iterator[Sequence[Expression]]:
    computed = sum(x.op not in (INPUT, RESULT) for x in body)
    first, length = 0, max(len(body), 1) if computed <= MAX_WHOLE_EXPRESSIONS else PIECE_EXPRESSIONS
    while first == 0 or first < len(body):
        last = first + length
        while last < len(body) and body[last].op is RESULT:
            last += 1
        yield body[first:last]
        first = last


def _with_truths(part: Sequence[Expression]) -> Sequence[Expression]:
    elsewhere = {x.operands[0] for x in part if x.op is Op.SELECT}.difference(part)
    return sorted((*part, *elsewhere), key=lambda x: x.index) if elsewhere else part


def _operands(part: Iterable[Expression], given: Container[int]) -> set[int]:
    """Indices of what a part uses and is not given."""
    used = {y for x in part if x.index not in given for y in x.operands if type(y) is not float}
    return {y.index for y in used if y.op not in _NOT_PASSED and y.index not in given}


def _places(homes: dict[int, int], needed: Sequence[set[int]]) -> dict[int, int]:
    last = {i: k for k, wanted in enumerate(needed) for i in sorted(wanted)}
    places: dict[int, int] = {}
    free: list[int] = []
    count = 0
    for k in range(len(needed)):
        free += [places[i] for i, end in last.items() if end == k - 1]
        for i in (i for i in last if homes[i] == k):
            if not free:
                free, count = [count], count + 1
            places[i] = free.pop()
    return places
