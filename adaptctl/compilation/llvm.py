"""LLVM IR for a traced routine: straight-line code over numbers side by side.

Every routine is a function of pointers, one to each argument and one to each part of its result. `contract` lets
multiplications and additions fuse; no other liberty is given, since general fast-math breaks the range reduction of
sine and cosine.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from adaptctl.compilation.function_body import ANGLES, FunctionBody
from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.invariants import NONE, Invariants
from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.layout import numbered
from adaptctl.compilation.pieces import Piece, pieces
from adaptctl.compilation.routine import Routine, trace
from adaptctl.compilation.sine import STEP, sine_for

_WIDE = (2, 4, 8)
"""Numbers of arguments whose sines are computed at once, where numbers are not side by side anyway."""


BEFORE = ".before"
"""After a step's name, the name of what runs before all steps."""


def program(routine: Routine, lanes: Lanes, same: Invariants = NONE) -> tuple[str, str]:
    """The LLVM IR (text) of a `routine`, a traced function, and of all that it calls, and the name of its function in
    it, which takes a pointer to each argument and to each part of the result. `lanes`, the `Lanes`, says how many
    numbers are computed at once by SIMD instructions and in what precision.

    `same`, for a step of a loop, are the `Invariants`, which do not change from step to step, none unless given: the
    function then takes a further pointer to memory that has them, and another function, its name followed by ".before",
    computes them. Nothing is checked.
    """
    symbols = _symbols(routine)
    parts = {r: pieces(r.body) for r in symbols}
    functions = [_function(r, parts[r], symbols, lanes) for r in symbols if r is not routine]
    if same.stored:
        before = same.before(routine)
        symbols[before], parts[before] = f"{symbols[routine]}{BEFORE}", pieces(before.body)
        functions.append(_function(before, parts[before], symbols, lanes))
        parts[routine] = pieces(same.left(routine), same.places)
    functions.append(_function(routine, parts[routine], symbols, lanes, same))
    if any(x.op in ANGLES for r in symbols for x in r.body):
        functions.append(_sincos(lanes))
    widths = {wide for r in symbols for piece in parts[r] for _, wide in _turned_together(piece, lanes)}
    functions += [_sincos(wide, f".{wide.count}") for wide in sorted(widths, key=lambda wide: wide.count)]
    return "\n".join(functions), symbols[routine]


def _symbols(routine: Routine) -> dict[Routine, str]:
    """Names for the routine and all it calls, at any depth."""
    found: dict[Routine, str] = {}
    pending = [routine]
    while pending:
        r = pending.pop()
        if r not in found:
            found[r] = f"of_{re.sub('[^A-Za-z0-9_]', '_', r.name)}.{len(found)}"  # a digit may not come first
            pending += r.calls
    return found


def _function(
    routine: Routine, parts: Sequence[Piece], symbols: Mapping[Routine, str], lanes: Lanes, same: Invariants = NONE
) -> str:
    """A routine's function; where it has several pieces, it calls one after the other."""
    symbol = symbols[routine]
    if len(parts) == 1:
        return _piece(routine, parts[0], symbol, symbols, lanes, same)
    inner = {f"{symbol}.piece{k}": part for k, part in enumerate(parts)}
    functions = [_piece(routine, part, name, symbols, lanes, same, shared=True) for name, part in inner.items()]
    passed = 1 + max((place for part in parts for place in part.kept.values()), default=0)
    pointers = [*_pointers(routine, same), "ptr %passed"]
    head = f"define internal void @{symbol}({', '.join(pointers[:-1])}) noinline {lanes.attributes} {{"
    memory = f"%passed = alloca [{passed} x {lanes.value}], align {lanes.alignment}"
    calls = [f"call void @{name}({', '.join(pointers)})" for name in inner]
    return "\n".join([*functions, head, memory, *calls, "ret void\n}"])


def _piece(
    routine: Routine,
    piece: Piece,
    symbol: str,
    symbols: Mapping[Routine, str],
    lanes: Lanes,
    same: Invariants = NONE,
    *,
    shared: bool = False,
    inlining: str = "noinline",
) -> str:
    """The function of a piece, which shares memory with others, or of a whole routine."""
    body = FunctionBody(symbols, lanes, piece.found, same)
    wanted: dict[int, list[tuple[str, int]]] = {i: [("%passed", place)] for i, place in piece.kept.items()}
    for (part, k), value in zip(numbered(routine.layout.sizes), routine.outputs, strict=True):
        if isinstance(value, Expression):
            wanted.setdefault(value.index, []).append((f"%out{part}", k))
        else:
            body.store(f"%out{part}", k, value)
    for angles, wide in _turned_together(piece, lanes):
        body.turn(angles, wide)
    for expression in piece.expressions:
        body.compute(expression)
        for pointer, k in wanted.get(expression.index, ()):  # at once: registers are few
            body.store(pointer, k, expression)
    pointers = [*_pointers(routine, same, " noalias"), *(["ptr noalias %passed"] if shared else [])]
    head = f"define internal void @{symbol}({', '.join(pointers)}) {inlining} {lanes.attributes} {{"
    return "\n".join([head, *body.memory, *body.lines, "ret void\n}"])


def _pointers(routine: Routine, same: Invariants, promise: str = "") -> list[str]:
    """The arguments of a routine's function, with what is promised of them."""
    read = f"{promise} readonly" if promise else ""
    inputs = [f"ptr{read} %in{part}" for part in range(len(routine.inputs))]
    outputs = [f"ptr{promise} %out{part}" for part in range(len(routine.layout.sizes))]
    return inputs + outputs + ([f"ptr{read} %same"] if same.stored else [])


def _turned_together(piece: Piece, lanes: Lanes) -> list[tuple[list[Expression], Lanes]]:
    """Groups of arguments whose sines are computed at once, and in how many lanes: where one number is worked on at a
    time, an angle alone leaves most of a register empty."""
    asked = [x.operands[0] for x in piece.expressions if x.op in ANGLES]
    angles = list(dict.fromkeys(x for x in asked if isinstance(x, Expression) and x.op is Op.INPUT))
    if lanes.count > 1 or len(angles) < 2:
        return []
    groups = [angles[k : k + _WIDE[-1]] for k in range(0, len(angles), _WIDE[-1])]
    return [(group, Lanes(next(wide for wide in _WIDE if wide >= len(group)), lanes.precision)) for group in groups]


def _sincos(lanes: Lanes, tag: str = "") -> str:
    """The functions that compute sines and cosines, their names ending in a tag."""
    sine, last = sine_for(lanes.precision), 8 * lanes.size - 1
    near = trace(lambda x: sine.reduced(x[0]), {"x": 1})
    step = trace(lambda x: sine.turned(*x), {"x": 3})
    whole = {"zero": 0, "one": 1, "second": last - 1, "last": last, "sign": -(2**last)}
    numbers = {name: lanes.whole(k) for name, k in whole.items()}
    limits = {"farthest": lanes.constant(sine.farthest), "longest": lanes.constant(STEP)}
    inlined = {f"sincos.near{tag}": near, f"sincos.step{tag}": step}
    parts = [_piece(r, Piece(r.body, {}, {}), name, {}, lanes, inlining="alwaysinline") for name, r in inlined.items()]
    return "\n".join([*parts, lanes.filled("sincos", tag=tag, **limits, **numbers)])
