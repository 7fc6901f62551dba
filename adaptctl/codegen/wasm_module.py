"""WebAssembly modules of graphs."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby, islice
from typing import NamedTuple

from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.recorded_loops import LoopRoutine
from adaptctl.compilation.routine import Routine, numbered, trace
from adaptctl.compilation.sine import DOUBLE
from adaptctl.errors import InputError

F64, I64, I32 = b"\x7c", b"\x7e", b"\x7f"
MAGIC = b"\0asm\x01\0\0\0"
PAGE = 65536
TYPES, FUNCTIONS, MEMORIES, EXPORTS, CODE = 1, 3, 5, 7, 10
"""Numbers of sections."""

GET, SET = b"\x20", b"\x21"
CALL, SELECT, END = b"\x10", b"\x1b", b"\x0b"
ZERO = b"\x41\x00"
"""base address of offsets"""


def unsigned(n: int) -> bytes:
    """Encoding of an unsigned integer (LEB128)."""
    if n < 0:
        raise InputError(f"WebAssembly: an unsigned integer: expected a whole number of at least 0, got {n}")
    out = bytearray()
    while True:
        n, low = n >> 7, n & 0x7F
        out.append(low | (0x80 if n else 0))
        if not n:
            return bytes(out)


def vector(items: Sequence[bytes]) -> bytes:
    """Encoding of a vector of encoded `items`."""
    return unsigned(len(items)) + b"".join(items)


def section(number: int, content: bytes) -> bytes:
    """Bytes of a section: number, length, content."""
    return bytes([number]) + unsigned(len(content)) + content


def signature(given: Iterable[bytes], made: Iterable[bytes]) -> bytes:
    """Encoding of a function's type."""
    return b"\x60" + vector(list(given)) + vector(list(made))


def body(locals_: Sequence[bytes], code: bytes) -> bytes:
    """Bytes of a function: length, local variables, code."""
    groups = [unsigned(len(list(group))) + kind for kind, group in groupby(locals_)]
    content = vector(groups) + code + END
    return unsigned(len(content)) + content


def constant(x: float) -> bytes:
    """Instruction that pushes the 64-bit float `x`."""
    return b"\x44" + struct.pack("<d", x)


def load(at: int) -> bytes:
    """Instructions that push the 64-bit float at an address."""
    return ZERO + b"\x2b\x03" + unsigned(at)


def store(at: int, value: bytes) -> bytes:
    """Instructions that store a 64-bit float at an address."""
    return ZERO + value + b"\x39\x03" + unsigned(at)


BINARY = {
    Op.ADD: b"\xa0", Op.SUBTRACT: b"\xa1", Op.MULTIPLY: b"\xa2", Op.DIVIDE: b"\xa3", Op.MINIMUM: b"\xa4",
    Op.MAXIMUM: b"\xa5", Op.LESS: b"\x63", Op.LESS_EQUAL: b"\x65",
}  # fmt: skip
UNARY = {Op.NEGATE: b"\x9a", Op.SQRT: b"\x9f", Op.ROUND: b"\x9e", Op.ABSOLUTE: b"\x99"}
TRUTHS, ANGLES = (Op.LESS, Op.LESS_EQUAL), {Op.SIN: 0, Op.COS: 1}


class WasmPlaces(NamedTuple):
    """Number of a function, and addresses of arguments and results."""

    number: int
    inputs: Sequence[int]
    outputs: Sequence[int]


class WasmCode:
    """Code of one function, written expression by expression."""

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
        """Write the code of an expression whose operands have been written."""
        if x.op in ANGLES:
            self._text[x.index] = GET + unsigned(self._sine(x.operands[0], sincos) + ANGLES[x.op])
            return
        text = self._formula(x)
        if self._uses[x.index] > 1:
            text = self.keep(text, I32 if x.op in TRUTHS else F64)
        self._text[x.index] = text

    def call(self, x: Expression, called: WasmPlaces, results: Iterable[Expression]) -> None:
        """Append a call and read the results that are used."""
        rest, routine = iter(x.operands), x.detail
        for at, size in zip(called.inputs, routine.inputs, strict=True):
            for k, y in enumerate(islice(rest, size)):
                self.code += store(at + 8 * k, self.operand(y))
        self.code += CALL + unsigned(called.number)
        for result in results:
            part, k = result.detail
            self._text[result.index] = self.keep(load(called.outputs[part] + 8 * k), F64)

    def operand(self, x: Expression | float) -> bytes:
        """Instructions that push the value of an expression."""
        return self._text[x.index] if isinstance(x, Expression) else constant(x)

    def keep(self, text: bytes, kind: bytes) -> bytes:
        """Store a pushed value in a local variable; return its read instruction."""
        number = self.new(kind)
        self.code += text + SET + unsigned(number)
        return GET + unsigned(number)

    def new(self, kind: bytes) -> int:
        """Index of a new local variable."""
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
        """First of two variables with an angle's sine and cosine."""
        if angle.index not in self._turned:
            sine, cosine = self.new(F64), self.new(F64)
            call = CALL + unsigned(sincos()) + SET + unsigned(cosine) + SET + unsigned(sine)
            self.code += self.operand(angle) + call
            self._turned[angle.index] = sine
        return self._turned[angle.index]


FIRST = 64
"""unused bytes at the start of memory"""


class WasmModule:
    """WebAssembly module of routines in double precision."""

    def __init__(self) -> None:
        self._types: list[bytes] = []
        self._functions: list[tuple[int, bytes]] = []
        self._exports: dict[str, int] = {}
        self._called: dict[Routine | LoopRoutine, WasmPlaces] = {}
        self._memory = FIRST
        self._turning: int | None = None

    def export(self, name: str, routine: Routine) -> WasmPlaces:
        """Add a routine's function; return its addresses."""
        called = self._function(routine)
        self._exports[name] = called.number
        return called

    def binary(self) -> bytes:
        """Module in WebAssembly's binary format."""
        pages = -(-self._memory // PAGE)
        memory = unsigned(6) + b"memory" + b"\x02\x00"
        names = [unsigned(len(name)) + name.encode() + b"\x00" + unsigned(k) for name, k in self._exports.items()]
        return b"".join(
            [
                MAGIC,
                section(TYPES, vector(self._types)),
                section(FUNCTIONS, vector([unsigned(kind) for kind, _ in self._functions])),
                section(MEMORIES, vector([b"\x00" + unsigned(pages)])),
                section(EXPORTS, vector([memory, *names])),
                section(CODE, vector([code for _, code in self._functions])),
            ]
        )

    def _function(self, routine: Routine | LoopRoutine) -> WasmPlaces:
        if isinstance(routine, LoopRoutine):
            self._called.setdefault(routine, self._function(routine.straight()))
        elif routine not in self._called:
            inputs, outputs = [self._room(n) for n in routine.inputs], [self._room(n) for n in routine.layout.sizes]
            for inner in routine.subroutines:
                self._function(inner)
            code = WasmCode(routine.body, routine.outputs, lambda part, k: load(inputs[part] + 8 * k))
            results: dict[Expression, list[Expression]] = {}
            for x in routine.body:
                if x.op is Op.RESULT:
                    results.setdefault(x.operands[0], []).append(x)
            for x in routine.body:
                if x.op is Op.CALL:
                    code.call(x, self._called[x.detail], results.get(x, ()))
                elif x.op is not Op.RESULT:
                    code.compute(x, self._sincos)
            for (part, k), value in zip(numbered(routine.layout.sizes), routine.outputs, strict=True):
                code.code += store(outputs[part] + 8 * k, code.operand(value))
            index = self._added(signature((), ()), code.locals, bytes(code.code))
            self._called[routine] = WasmPlaces(index, inputs, outputs)
        return self._called[routine]

    def _room(self, numbers: int) -> int:
        at, self._memory = self._memory, self._memory + 8 * numbers
        return at

    def _added(self, kind: bytes, variables: Sequence[bytes], code: bytes) -> int:
        if kind not in self._types:
            self._types.append(kind)
        self._functions.append((self._types.index(kind), body(variables, code)))
        return len(self._functions) - 1

    def _sincos(self) -> int:
        """Function to sine and cosine with native code's operations, NaN beyond its range."""
        if self._turning is None:
            routine = trace(lambda x: DOUBLE.reduced(x[0]), {"x": 1})
            angle = GET + b"\x00"
            code = WasmCode(routine.body, routine.outputs, lambda _part, _k: angle, parameters=1)
            for x in routine.body:
                code.compute(x, lambda: 0)
            sine, cosine = (code.keep(code.operand(value), F64) for value in routine.outputs[:2])
            quarter = code.keep(code.operand(routine.outputs[2]) + b"\xbd", I64)
            odd = quarter + _integer(1) + b"\x83\xa7"  # i32.wrap(k & 1)
            near = angle + b"\x99" + constant(DOUBLE.farthest) + b"\x65"
            after = quarter + _integer(1) + b"\x7c"
            turned = [(cosine + sine + odd + SELECT, quarter), (sine + cosine + odd + SELECT, after)]
            for value, sign in turned:
                signed = value + b"\xbd" + sign + _integer(2) + b"\x83" + _integer(62) + b"\x86\x85\xbf"
                code.code += signed + constant(float("nan")) + near + SELECT
            self._turning = self._added(signature([F64], [F64, F64]), code.locals, bytes(code.code))
        return self._turning


def _integer(n: int) -> bytes:
    return b"\x42" + bytes([n])
