"""Sine and cosine in SIMD lanes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.lanes import Instructions, Lanes, Precision
from adaptctl.scalars.scalar import polynomial


class Sine(NamedTuple):
    """Constants of sine and cosine in one precision."""

    farthest: float
    """rad; up to here `reduced` holds"""
    shift: float
    """added to a number, rounds it to a whole number"""
    quarter: tuple[float, float, float]
    """parts of pi/2, the first two short enough for exact multiples"""
    sine: tuple[float, ...]
    """(sin r - r) / r^3 in powers of r^2"""
    cosine: tuple[float, ...]
    """(cos r - 1 + r^2/2) / r^4 in powers of r^2"""

    def reduced(self, x: Any) -> tuple[Any, Any, Any]:
        """Sine and cosine of r, and k + `shift`, for an angle k pi/2 + r."""
        first, second, third = self.quarter
        shifted = x * (2.0 / math.pi) + self.shift
        k = shifted - self.shift
        r = ((x - k * first) - k * second) - k * third
        z = r * r
        return r + r * z * polynomial(self.sine, z), (1.0 - 0.5 * z) + z * z * polynomial(self.cosine, z), shifted

    def turned(self, sine: Any, cosine: Any, step: Any) -> tuple[Any, Any]:
        """Sine and cosine at a `step` from a known angle."""
        z = step * step
        of_step = step + step * z * polynomial(self.sine[:STEP_COEFFICIENTS], z)
        less = z * (0.5 - z * polynomial(self.cosine[:STEP_COEFFICIENTS], z))  # 1 less the step's cosine
        return sine + (cosine * of_step - sine * less), cosine - (sine * of_step + cosine * less)


MAX_SINE_STEP = 2.0**-4
"""rad of a short step"""

STEP_COEFFICIENTS = 3
"""polynomial coefficients for a short step; the next are below 5e-17"""


DOUBLE = Sine(
    2.0**20,
    1.5 * 2.0**52,
    (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
    (
        -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
        2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
    ),
    (
        4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
        -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
    ),
)  # fmt: skip
"""fdlibm's polynomials; pi/2 to 150 bits, 33 in each of its first two parts"""

SINGLE = Sine(
    2.0**13,
    1.5 * 2.0**23,
    (1.5703125, 4.837512969970703125e-4, 7.54978995489188216e-8),
    (-1.6666654611e-1, 8.3321608736e-3, -1.9515295891e-4),
    (4.166664568298827e-2, -1.388731625493765e-3, 2.443315711809948e-5),
)
"""Cephes' polynomials and parts of pi/2"""


def sine_for(precision: Precision) -> Sine:
    """Constants for a `precision`."""
    return DOUBLE if precision == "double" else SINGLE


ANGLES = {Op.SIN: 0, Op.COS: 1}
"""operations on angles, and their index in (sine, cosine)"""

_WIDE = (2, 4, 8)
"""Angles computed at once if numbers have one lane."""


class SinesAtOnce:
    """Sines and cosines of groups of angles as LLVM instructions."""

    def __init__(self, text: Instructions, known: Mapping[Expression, int], pointer: str) -> None:
        self._text = text
        self._pairs = {x: (pointer, first) for x, first in known.items()}
        self._size = {pointer: 2 + max(known.values(), default=0)}

    def place(self, x: Expression) -> tuple[str, int] | None:
        """Memory index of a computed sine or cosine."""
        found = self._pairs.get(x.operands[0]) if x.op in ANGLES else None
        return None if found is None else (found[0], found[1] + ANGLES[x.op])

    def turn(
        self, angles: Sequence[Expression], operand: Callable[[Any], str], has: Callable[[Expression], bool]
    ) -> None:
        """Append instructions of sines and cosines not yet computed, of values that have names."""
        most, group = _WIDE[-1] if self._text.lanes.count == 1 else len(angles), list[_Turn]()
        for x in (x for x in angles if x not in self._pairs):
            turn = self._turn(x, has)
            if group and (len(group) == most or turn.memory != group[0].memory):
                self._write(group, operand)
                group, turn = [], self._turn(x, has)  # of what was written, it may be a step from one
            group.append(turn)
        if group:
            self._write(group, operand)

    def _turn(self, angle: Expression, has: Callable[[Expression], bool]) -> _Turn:
        for known, step in (angle.operands, angle.operands[::-1]) if angle.op is Op.ADD else ():
            if known in self._pairs and _short(step) and has(step):
                return _Turn(angle, step, self._pairs[known])
        return _Turn(angle)

    def _write(self, turns: Sequence[_Turn], operand: Callable[[Any], str]) -> None:
        text, pairs = self._text, f"%sines{turns[0].angle.index}"
        text.reserve(pairs, 2 * len(turns))
        angles, steps = (
            [operand(x.angle) for x in turns],
            [operand(x.step) for x in turns if x.step is not None],
        )
        group = _Group(pairs, steps or angles, [x.known for x in turns if x.known is not None])
        several = text.lanes.count == 1 and len(turns) > 1
        far = self._in_one_register(group) if several else self._one_by_one(group)
        self._correct(pairs, [angles, steps] if steps else [angles], *far)
        self._size[pairs] = 2 * len(turns)
        self._pairs |= {x.angle: (pairs, 2 * k) for k, x in enumerate(turns)}

    def _one_by_one(self, group: _Group) -> tuple[str, Lanes]:
        text, lanes, any_far = self._text, self._text.lanes, ""
        for k, x in enumerate(group.numbers):
            name = f"{group.pairs}.of{k}"
            given = [text.load(pointer, first + i) for pointer, first in group.known[k : k + 1] for i in (0, 1)]
            for part, value in enumerate(self._computed(name, [x, *given], lanes)):
                text.store(group.pairs, 2 * k + part, value)
            any_far = self._beyond(name, x, lanes, bool(given), any_far)
        return any_far, lanes

    def _in_one_register(self, group: _Group) -> tuple[str, Lanes]:
        text, name, n = self._text, group.pairs, len(group.numbers)
        wide = Lanes(next(w for w in _WIDE if w >= n), text.lanes.precision)
        together = "zeroinitializer"
        for k, x in enumerate(group.numbers):
            text.add(f"{name}.x{k} = insertelement {wide.value} {together}, {wide.scalar} {x}, i32 {k}")
            together = f"{name}.x{k}"
        sine, cosine = self._computed(name, [together, *self._taken(group, wide)], wide)
        both, places = f"<{2 * n} x {wide.scalar}>", (k + part * wide.count for k in range(n) for part in (0, 1))
        text.add(f"{name}.both = shufflevector {wide.value} {sine}, {wide.value} {cosine}, {_mask(places)}")
        text.add(f"store {both} {name}.both, ptr {name}, align {wide.size}")
        return self._beyond(name, together, wide, bool(group.known)), wide

    def _taken(self, group: _Group, wide: Lanes) -> list[str]:
        if not group.known:
            return []
        pointer, size = group.known[0][0], self._size[group.known[0][0]]
        kind, all_known, idle = f"<{size} x {wide.scalar}>", f"{group.pairs}.known", wide.count - len(group.known)
        self._text.add(f"{all_known} = load {kind}, ptr {pointer}, align {wide.size}")
        for i in (0, 1):
            mask = _mask([*(first + i for _, first in group.known), *[size] * idle])
            self._text.add(f"{all_known}{i} = shufflevector {kind} {all_known}, {kind} zeroinitializer, {mask}")
        return [f"{all_known}0", f"{all_known}1"]

    def _computed(self, name: str, given: Sequence[str], lanes: Lanes) -> list[str]:
        both, function = f"{{{lanes.value}, {lanes.value}}}", "turned" if len(given) > 1 else "near"
        arguments = ", ".join(f"{lanes.value} {x}" for x in given)
        self._text.add(f"{name}.sines = call {both} @sines.{function}.{lanes.count}({arguments})")
        for part, which in enumerate(("sine", "cosine")):
            self._text.add(f"{name}.{which} = extractvalue {both} {name}.sines, {part}")
        return [f"{name}.sine", f"{name}.cosine"]

    def _beyond(self, name: str, x: str, lanes: Lanes, stepped: bool, before: str = "") -> str:
        limit = lanes.constant(MAX_SINE_STEP if stepped else sine_for(lanes.precision).farthest)
        called = f"call {lanes.condition} @sines.beyond.{lanes.count}({lanes.value} {x}, {lanes.value} {limit})"
        self._text.add(f"{name}.far = {called}")
        if before:
            self._text.add(f"{name}.any = or {lanes.condition} {before}, {name}.far")
        return f"{name}.any" if before else f"{name}.far"

    def _correct(self, pairs: str, columns: Sequence[Sequence[str]], far: str, wide: Lanes) -> None:
        text, n, bits = self._text, len(columns[0]), f"i{wide.count}"
        text.add(f"{pairs}.bits = bitcast {wide.condition} {far} to {bits}")
        text.add(f"{pairs}.branch = icmp ne {bits} {pairs}.bits, 0")
        label = pairs[1:]
        text.add(f"br i1 {pairs}.branch, label %{label}.correct, label %{label}.done")
        text.add(f"{label}.correct:")
        memory = [text.reserve(f"{pairs}.given{i}", n) for i in range(len(columns))]
        for pointer, column in zip(memory, columns, strict=True):
            for k, x in enumerate(column):
                text.store(pointer, k, x)
        arguments = ", ".join(f"ptr {pointer}" for pointer in (*memory, pairs))
        text.add(f"call void @sines.{'anew' if len(columns) > 1 else 'far'}({arguments}, i64 {n})")
        text.add(f"br label %{label}.done")
        text.add(f"{label}.done:")


class _Turn(NamedTuple):
    angle: Expression
    step: Any = None
    known: Any = None

    @property
    def memory(self) -> str | None:
        return self.known[0] if self.known else None


class _Group(NamedTuple):
    pairs: str
    numbers: Sequence[str]
    known: Sequence[tuple[str, int]]


def asked_at_once(expressions: Sequence[Expression]) -> dict[int, list[Expression]]:
    """Groups of angles that can be computed together."""
    asked = [x.operands[0] for x in expressions if x.op in ANGLES]
    given = [x for x in dict.fromkeys(asked) if x.op is Op.INPUT]
    groups = {expressions[0].index: given} if given else {}
    first: Expression | None = None
    for x in expressions:
        if x.op not in ANGLES:
            first = None
            continue
        if first is None or x.operands[0].index >= first.index:  # the sine of a sine comes later
            first = x
        groups.setdefault(first.index, []).append(x.operands[0])
    return {index: list(dict.fromkeys(angles)) for index, angles in groups.items()}


def _short(x: Any) -> bool:
    return (
        isinstance(x, Expression)
        and x.op is Op.MULTIPLY
        and isinstance(x.operands[0], float)
        and abs(x.operands[0]) <= MAX_SINE_STEP
    )


def _mask(places: Iterable[int]) -> str:
    numbers = [f"i32 {k}" for k in places]
    return f"<{len(numbers)} x i32> <{', '.join(numbers)}>"
