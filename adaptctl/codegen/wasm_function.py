"""Straight-line WebAssembly: the code that computes expressions on its stack, and keeps what is used again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import islice

from adaptctl.codegen.wasm_encoding import CALL, F64, GET, I32, SELECT, SET, constant, load, store, unsigned
from adaptctl.compilation.graph import Expression, Op

BINARY = {
    Op.ADD: b"\xa0", Op.SUBTRACT: b"\xa1", Op.MULTIPLY: b"\xa2", Op.DIVIDE: b"\xa3", Op.MINIMUM: b"\xa4",
    Op.MAXIMUM: b"\xa5", Op.LESS: b"\x63", Op.LESS_EQUAL: b"\x65",
}  # fmt: skip
UNARY = {Op.NEGATE: b"\x9a", Op.SQRT: b"\x9f", Op.ROUND: b"\x9e", Op.ABSOLUTE: b"\x99"}
TRUTHS, ANGLES = (Op.LESS, Op.LESS_EQUAL), {Op.SIN: 0, Op.COS: 1}


class Called:
    """A WebAssembly function that others call: its `index` in the module, and the addresses in memory, bytes, of its
    arguments, `inputs`, and of the parts of its result, `outputs`. Nothing is checked."""

    def __init__(self, index: int, inputs: Sequence[int], outputs: Sequence[int]) -> None:
        self.index, self.inputs, self.outputs = index, inputs, outputs


class WasmCode:
    """Code of one WebAssembly function, written expression by expression: `code` has its bytes so far, `locals` the
    types of its local variables, WebAssembly's byte for each.

    Made of `body`, all expressions to be written, which tells what is used more than once; `outputs`, the expressions
    and constants that are its results; `given`, a callable `given(i, k)` that returns the code which puts scalar k of
    argument i, both from 0, on the stack; and `parameters`, the number of WebAssembly parameters that the function has
    (0 by default), whose indices come before those of the local variables. Nothing is checked.
    """

    def __init__(
        self, body: Sequence[Expression], outputs: Iterable[Expression | float], given: Callable[[int, int], bytes],
        parameters: int = 0,
    ) -> None:  # fmt: skip
        self.code = bytearray()
        self.locals: list[bytes] = []
        self._first, self._given = parameters, given
        self._uses = Counter(y.index for x in body for y in x.operands if isinstance(y, Expression))
        self._uses.update(y.index for y in outputs if isinstance(y, Expression))
        self._text: dict[int, bytes] = {}
        self._turned: dict[int, int] = {}

    def compute(self, x: Expression, sincos: Callable[[], int]) -> None:
        """Write the WebAssembly code of the expression `x`, which is no call and no result of one, and whose operands
        have been written before. Where it is used more than once, its value is stored in a new local variable; else its
        code becomes part of the code that uses it. `sincos` is a callable that returns the index of the function of
        sine and cosine, called where it is needed. Raises `KeyError` for an operation that this code has no instruction
        for."""
        if x.op in ANGLES:
            self._text[x.index] = GET + unsigned(self._sine(x.operands[0], sincos) + ANGLES[x.op])
            return
        text = self._formula(x)
        if self._uses[x.index] > 1:
            text = self.keep(text, I32 if x.op in TRUTHS else F64)
        self._text[x.index] = text

    def call(self, x: Expression, called: Called, results: Iterable[Expression]) -> None:
        """Append a call, the expression `x`, of the function `called`: its arguments are stored at their addresses in
        memory; after the call the results that are used, the expressions `results`, are read from their addresses into
        local variables. Raises `ValueError` where the function has another number of arguments."""
        rest, routine = iter(x.operands), x.detail
        for at, size in zip(called.inputs, routine.inputs, strict=True):
            for k, y in enumerate(islice(rest, size)):
                self.code += store(at + 8 * k, self.operand(y))
        self.code += CALL + unsigned(called.index)
        for result in results:
            part, k = result.detail
            self._text[result.index] = self.keep(load(called.outputs[part] + 8 * k), F64)

    def operand(self, x: Expression | float) -> bytes:
        """The WebAssembly instructions, bytes, that push the value of `x` onto the stack; `x` is a constant or an
        expression whose code has been written by `compute` or `call`. Raises `KeyError` for an expression that has not
        been written."""
        return self._text[x.index] if isinstance(x, Expression) else constant(x)

    def keep(self, text: bytes, kind: bytes) -> bytes:
        """Append the WebAssembly instructions `text`, which push one value, to the function, with one that stores the
        value in a new local variable, so that they run once; return the instruction, bytes, that pushes the variable's
        value. `kind` is the variable's type, WebAssembly's byte for it. Nothing is checked."""
        number = self.new(kind)
        self.code += text + SET + unsigned(number)
        return GET + unsigned(number)

    def new(self, kind: bytes) -> int:
        """Add a local variable of the type `kind`, WebAssembly's byte for it, such as that of a 64-bit float, to the
        function, and return its index, which counts from 0 and begins after the function's own parameters. Nothing is
        checked."""
        self.locals.append(kind)
        return self._first + len(self.locals) - 1

    def _formula(self, x: Expression) -> bytes:
        if x.op is Op.INPUT:
            return self._given(*x.detail)
        operands = [self.operand(y) for y in x.operands]
        if x.op is Op.SELECT:
            return operands[1] + operands[2] + operands[0] + SELECT
        return b"".join(operands) + (BINARY | UNARY)[x.op]

    def _sine(self, angle: Expression, sincos: Callable[[], int]) -> int:
        """The first of the two variables that hold an angle's sine and cosine."""
        if angle.index not in self._turned:
            sine, cosine = self.new(F64), self.new(F64)
            call = CALL + unsigned(sincos()) + SET + unsigned(cosine) + SET + unsigned(sine)
            self.code += self.operand(angle) + call
            self._turned[angle.index] = sine
        return self._turned[angle.index]
