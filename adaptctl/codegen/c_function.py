"""C statements of expressions."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Literal, TypeAlias

from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.landing import NOWHERE, Landings
from adaptctl.compilation.lanes import Precision, single
from adaptctl.compilation.llvm import Piece
from adaptctl.compilation.routine import Routine, trace
from adaptctl.compilation.sine import Sine, sine_for

Kind: TypeAlias = Literal["double", "float"]


@dataclass(frozen=True)
class CNumber:
    """Kind of number in C code, double or float."""

    kind: Kind
    names: Mapping[float, str]

    @property
    def precision(self) -> Precision:
        """Precision of the numbers."""
        return "double" if self.kind == "double" else "single"

    @property
    def size(self) -> int:
        """Size in bytes, 8 or 4."""
        return 8 if self.kind == "double" else 4

    @property
    def suffix(self) -> str:
        """Suffix of constants and math.h functions, "f" for float."""
        return "" if self.kind == "double" else "f"

    def rounded(self, x: float) -> float:
        """`x` rounded to this kind and clipped to its range."""
        return x if self.kind == "double" else single(x)

    def constant(self, x: float) -> str:
        """C text of a constant, without a comment."""
        if math.isinf(x):
            huge = f"HUGE_VAL{self.suffix.upper()}"  # INFINITY is a float
            return huge if x == math.inf else f"(-{huge})"
        rounded = self.rounded(x)
        text = f"{repr(rounded) if rounded.is_integer() else rounded.hex()}{self.suffix}"
        return f"({text})" if text.startswith("-") else text

    def text(self, x: float) -> str:
        """C text of a constant."""
        name = self.names.get(abs(x))
        return f"{self.constant(x)} /* {name} */" if name else self.constant(x)


MAX_INLINE_LENGTH = 90
"""characters of an inlined expression"""

LIBRARY = {Op.SQRT: "sqrt", Op.ROUND: "rint", Op.ABSOLUTE: "fabs"}
INFIX = {Op.ADD: "+", Op.SUBTRACT: "-", Op.MULTIPLY: "*", Op.DIVIDE: "/", Op.LESS: "<", Op.LESS_EQUAL: "<="}
TRUTHS = (Op.LESS, Op.LESS_EQUAL)
ANGLES = {Op.SIN: "s", Op.COS: "c"}

Given = Callable[[int, int], str]
"""Text of an argument's number."""


def _no_place(_part: int, _k: int) -> str:
    """Results of calls go nowhere else."""
    return ""


class CStatements:
    """Writer of C statements."""

    def __init__(
        self,
        prefix: str,
        number: CNumber,
        piece: Piece,
        symbols: Mapping[Routine, str],
        given: Given,
        landed: Landings = NOWHERE,
        own: Given = _no_place,
    ) -> None:
        self.lines: list[str] = []
        self.arrays = 0
        self._prefix, self._number, self._symbols, self._given = prefix, number, symbols, given
        self._landed, self._own = landed, own
        self._found = piece.found
        self._uses = Counter(y.index for x in piece.expressions for y in x.operands if isinstance(y, Expression))
        self._text: dict[int, str] = {}
        self._turned: set[int] = set()

    def compute(self, x: Expression, *, named: bool) -> None:
        """Append the statements of an expression not yet stored."""
        if x.op is Op.CALL:
            self._call(x)
            return
        if x.op in ANGLES:
            self._turn(x)
            return
        if (place := self._place(x)) is not None:
            self._text[x.index] = place
            return
        text = self._formula(x)
        if not named and self._uses[x.index] <= 1 and len(text) <= MAX_INLINE_LENGTH:
            self._text[x.index] = f"({text})"
            return
        kind = "int" if x.op in TRUTHS else f"{self._prefix}_real"
        self.lines.append(f"const {kind} x{x.index} = {text};")
        self._text[x.index] = f"x{x.index}"

    def store(self, place: str, value: Expression | float) -> None:
        """Append the assignment of a value to a place."""
        self.lines.append(f"{place} = {self.operand(value)};")

    def copy_where(self, condition: Expression, runs: Iterable[tuple[str, str, int]]) -> None:
        """Append copies of arrays where a condition holds."""
        copies = [f"    (void)memcpy(&{to}, &{of}, {n}u * sizeof({self._prefix}_real));" for to, of, n in runs]
        self.lines += [f"if ({self.operand(condition)}) {{", *copies, "}"]

    def operand(self, x: Expression | float) -> str:
        """C text of a computed expression or a constant."""
        if not isinstance(x, Expression):
            return self._number.text(x)
        if x.index not in self._text:
            self._text[x.index] = self._place(x) or f"passed[{self._found[x.index]}]"
        return self._text[x.index]

    def _formula(self, x: Expression) -> str:
        a, *rest = map(self.operand, x.operands)
        end = self._number.suffix
        if x.op in INFIX:
            return f"{a} {INFIX[x.op]} {rest[0]}"
        if x.op is Op.NEGATE:
            return f"-{a}"
        if x.op is Op.SELECT:
            return f"{a} ? {rest[0]} : {rest[1]}"
        if x.op in (Op.MINIMUM, Op.MAXIMUM):
            return f"{self._prefix}_{x.op.value}({a}, {rest[0]})"
        return f"{LIBRARY[x.op]}{end}({a})"

    def _turn(self, x: Expression) -> None:
        angle = x.operands[0]
        if angle.index not in self._turned:
            self._turned.add(angle.index)
            names = f"s{angle.index}", f"c{angle.index}"
            self.lines += [f"{self._prefix}_real {name};" for name in names]
            self.lines.append(f"{self._prefix}_sincos({self.operand(angle)}, &{names[0]}, &{names[1]});")
        self._text[x.index] = f"{ANGLES[x.op]}{angle.index}"

    def _call(self, x: Expression) -> None:
        rest, routine, names = iter(x.operands), x.detail, []
        for part, size in enumerate(routine.inputs):
            group = [self.operand(y) for y in islice(rest, size)]
            names.append(_side_by_side(group) or self._array(f"a{x.index}_{part}", size, group))
        for part, size in enumerate(routine.layout.sizes):
            into = self._landed.calls.get((x.index, part))
            names.append(f"&{self._own(*into)}" if into else self._array(f"r{x.index}_{part}", size))
        self.lines.append(f"{self._symbols[routine]}({', '.join(names)});")

    def _array(self, name: str, size: int, values: Sequence[str] = ()) -> str:
        """Name of an array declared here, of length 1 at least."""
        if size == 0:
            return "NULL"
        self.arrays += size
        first = f" = {{{', '.join(values)}}}" if values else ""
        self.lines.append(f"{'const ' if values else ''}{self._prefix}_real {name}[{size}]{first};")
        return name

    def _place(self, x: Expression) -> str | None:
        """C text of a stored expression, or None."""
        if x.index in self._found:
            return f"passed[{self._found[x.index]}]"
        if x.op is Op.INPUT:
            return self._given(*x.detail)
        if x.index in self._landed.places:
            return self._own(*self._landed.places[x.index])
        if x.op is Op.RESULT:
            return f"r{x.operands[0].index}_{x.detail[0]}[{x.detail[1]}]"
        return None


def _side_by_side(texts: Sequence[str]) -> str | None:
    """Address of numbers that follow each other in memory already, or None."""
    found = [re.fullmatch(r"([\w>.-]+)\[(\d+)\]", text) for text in texts]
    places = [(at[1], int(at[2]) - k) for k, at in enumerate(found) if at]
    if len(places) < max(len(texts), MIN_SHARED) or len(set(places)) > 1:
        return None
    return f"&{places[0][0]}[{places[0][1]}]"


MIN_SHARED = 4
"""Numbers side by side that a function is given where they are, instead of copies."""


def most_alive(expressions: Sequence[Expression], outputs: Iterable[Expression | float]) -> int:
    """Greatest number of simultaneously live intermediate values."""
    last = {y.index: k for k, x in enumerate(expressions) for y in x.operands if isinstance(y, Expression)}
    own = {x.index for x in expressions if x.op not in (Op.INPUT, Op.CALL)}
    kept = {x.index for x in outputs if isinstance(x, Expression)}
    ending = Counter(k for i, k in last.items() if i in own)
    alive = most = 0
    for k, x in enumerate(expressions):
        alive += x.index in own and (x.index in last or x.index in kept)
        most = max(most, alive)
        alive -= ending[k]
    return most


def sine_source(prefix: str, number: CNumber) -> str:
    """C function of the sine and cosine of an angle."""
    sine = sine_for(number.precision)
    near, far = _near(prefix, number, sine), sine.farthest
    bits, within = f"uint{8 * number.size}_t", "2 ulp" if number.kind == "double" else "1.2e-7"
    return f"""\
/* Sine and cosine, within {within} up to {far:.0f} rad and NaN beyond: Cody and Waite's reduction by quarter turns.
   After an odd number of them the two change places; the second bit of k and of k + 1 are their signs. */
static void {prefix}_sincos({prefix}_real x, {prefix}_real *{prefix.upper()}_RESTRICT s, \
{prefix}_real *{prefix.upper()}_RESTRICT c)
{{
    {bits} quarter;
    {prefix}_real first;
    {prefix}_real second;
{near}    (void)memcpy(&quarter, &shifted, sizeof quarter);
    first = ((quarter & 1u) != 0u) ? near_c : near_s;
    second = ((quarter & 1u) != 0u) ? near_s : near_c;
    *s = ((quarter & 2u) != 0u) ? -first : first;
    *c = (((quarter + 1u) & 2u) != 0u) ? -second : second;
    if (!(fabs{number.suffix}(x) <= {number.constant(far)})) {{
        *s = ({prefix}_real)NAN;
        *c = ({prefix}_real)NAN;
    }}
}}
"""


def _near(prefix: str, number: CNumber, sine: Sine) -> str:
    routine = trace(lambda x: sine.reduced(x[0]), {"x": 1})
    code = CStatements(prefix, number, Piece(routine.body, {}, {}), {}, lambda _part, _k: "x")
    wanted = {x.index for x in routine.outputs if isinstance(x, Expression)}
    for x in routine.body:
        code.compute(x, named=x.index in wanted)
    for name, value in zip(("near_s", "near_c", "shifted"), routine.outputs, strict=True):
        code.lines.append(f"const {prefix}_real {name} = {code.operand(value)};")
    return "".join(f"    {line}\n" for line in code.lines)
