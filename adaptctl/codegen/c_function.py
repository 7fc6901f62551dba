"""Straight-line C: the statements that compute expressions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice

from adaptctl.codegen.c_number import CNumber
from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.llvm import Piece
from adaptctl.compilation.routine import Routine

LONGEST = 90
"""Characters of what is written in place of a name, where it is used once."""

LIBRARY = {Op.SQRT: "sqrt", Op.ROUND: "rint", Op.ABSOLUTE: "fabs"}
INFIX = {Op.ADD: "+", Op.SUBTRACT: "-", Op.MULTIPLY: "*", Op.DIVIDE: "/", Op.LESS: "<", Op.LESS_EQUAL: "<="}
TRUTHS = (Op.LESS, Op.LESS_EQUAL)
ANGLES = {Op.SIN: "s", Op.COS: "c"}

Given = Callable[[int, int], str]
"""Text of an argument's number."""


class CStatements:
    """Writer of C statements, expression by expression, that compute a piece of a routine (traced function): the whole
    of it or, where it is long, one of several C functions that share the array `passed` of intermediate values. The
    attribute `lines` is the list of the lines of C text written so far, the attribute `arrays` the total length of the
    arrays that they declare.

    Made of `prefix`, which begins all names in the C code; `number`, the `CNumber`, double or float; `piece`, the
    `Piece`, which tells what earlier pieces left in `passed`; `symbols`, the C functions' names by `Routine`, for
    calls; and `given`, a callable `given(i, k)` that returns the C text of scalar k of the routine's argument i, both
    from 0. Nothing is checked.
    """

    def __init__(
        self, prefix: str, number: CNumber, piece: Piece, symbols: Mapping[Routine, str], given: Given
    ) -> None:
        self.lines: list[str] = []
        self.arrays = 0
        self._prefix, self._number, self._symbols, self._given = prefix, number, symbols, given
        self._found = piece.found
        self._uses = Counter(y.index for x in piece.expressions for y in x.operands if isinstance(y, Expression))
        self._text: dict[int, str] = {}
        self._turned: set[int] = set()

    def compute(self, x: Expression, *, named: bool) -> None:
        """Append the statements that compute the expression `x`, whose operands have been computed before, unless its
        value is stored already, as an input's is. With `named` its value gets a variable; without, the text of one that
        is used once and has at most 90 characters is written where it is used instead. Raises `KeyError` for a call of
        a routine without a name in `symbols`."""
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
        if not named and self._uses[x.index] <= 1 and len(text) <= LONGEST:
            self._text[x.index] = f"({text})"
            return
        kind = "int" if x.op in TRUTHS else f"{self._prefix}_real"
        self.lines.append(f"const {kind} x{x.index} = {text};")
        self._text[x.index] = f"x{x.index}"

    def store(self, place: str, value: Expression | float) -> None:
        """Append the assignment of `value`, an expression that has been computed or a constant, to `place`, the C text
        of a variable or an array's element. Nothing is checked."""
        self.lines.append(f"{place} = {self.operand(value)};")

    def copy_where(self, condition: Expression, runs: Iterable[tuple[str, str, int]]) -> None:
        """Append C statements that copy contiguous arrays where a `condition`, a comparison that has been computed, is
        true: an `if` with one `memcpy` for each of `runs`. A run is the C text of the destination's first element, that
        of the source's first element, and the number of elements. Nothing is checked."""
        copies = [f"    (void)memcpy(&{to}, &{of}, {n}u * sizeof({self._prefix}_real));" for to, of, n in runs]
        self.lines += [f"if ({self.operand(condition)}) {{", *copies, "}"]

    def operand(self, x: Expression | float) -> str:
        """The C text of an operand `x`: of an expression whose value has been computed or is stored already, as an
        input's is, or of a constant. Raises `KeyError` for an expression that is neither."""
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
        """Sine and cosine of an angle, both at once."""
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
            names.append(self._array(f"a{x.index}_{part}", size, group))
        for part, size in enumerate(routine.layout.sizes):
            names.append(self._array(f"r{x.index}_{part}", size))
        self.lines.append(f"{self._symbols[routine]}({', '.join(names)});")

    def _array(self, name: str, size: int, values: Sequence[str] = ()) -> str:
        """The name of an array of numbers that is declared here; C has none of length 0."""
        if size == 0:
            return "NULL"
        self.arrays += size
        first = f" = {{{', '.join(values)}}}" if values else ""
        self.lines.append(f"{'const ' if values else ''}{self._prefix}_real {name}[{size}]{first};")
        return name

    def _place(self, x: Expression) -> str | None:
        """C's text of an expression that is in memory already; None for others."""
        if x.index in self._found:
            return f"passed[{self._found[x.index]}]"
        if x.op is Op.INPUT:
            return self._given(*x.detail)
        if x.op is Op.RESULT:
            return f"r{x.operands[0].index}_{x.detail[0]}[{x.detail[1]}]"
        return None


def most_alive(expressions: Sequence[Expression], outputs: Iterable[Expression | float]) -> int:
    """The greatest number of intermediate values that are live at one time, computed with a use to come, where
    `expressions` are computed in this order: about as many numbers as the stack holds. Inputs and calls do not count;
    those of `outputs`, expressions and constants, that nothing else uses are live to the end. Nothing is checked."""
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
