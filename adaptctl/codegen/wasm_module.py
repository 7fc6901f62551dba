"""WebAssembly modules straight from graphs: no compiler, no linker, one memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from adaptctl.codegen import wasm_encoding as wasm
from adaptctl.codegen.wasm_encoding import F64, GET, I64, SELECT, unsigned
from adaptctl.codegen.wasm_function import Called, WasmCode
from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.layout import numbered
from adaptctl.compilation.routine import Routine, trace
from adaptctl.compilation.sine import DOUBLE

FIRST = 64
"""Bytes at the beginning of memory that nothing uses."""


@dataclass(frozen=True)
class WasmPlaces:
    """Addresses, in bytes from the beginning of a WebAssembly module's memory, of the arguments of a function,
    `inputs`, and of the parts of its result, `outputs`: contiguous 64-bit floats. Nothing is checked."""

    inputs: tuple[int, ...]
    outputs: tuple[int, ...]


class WasmModule:
    """A WebAssembly module of routines (traced functions) in double precision, empty at first: its method `export` adds
    the function of a routine under a name, its method `binary` returns the module's bytes."""

    def __init__(self) -> None:
        self._types: list[bytes] = []
        self._functions: list[tuple[int, bytes]] = []
        self._exports: dict[str, int] = {}
        self._called: dict[Routine, Called] = {}
        self._memory = FIRST
        self._turning: int | None = None

    def export(self, name: str, routine: Routine) -> WasmPlaces:
        """Add a function that computes `routine`, a traced function, to the module, exported under `name`, and return
        the addresses, `WasmPlaces`, of its arguments and results. It takes no WebAssembly parameters: it reads and
        writes the module's memory at these addresses. A routine that was added before is not written again. Raises
        `KeyError` for an operation that WebAssembly code is not written for."""
        called = self._function(routine)
        self._exports[name] = called.index
        return WasmPlaces(tuple(called.inputs), tuple(called.outputs))

    def binary(self) -> bytes:
        """The module in WebAssembly's binary format, with the functions that were exported and the memory, exported as
        "memory". Nothing is raised."""
        pages = -(-self._memory // wasm.PAGE)
        memory = unsigned(6) + b"memory" + b"\x02\x00"
        names = [unsigned(len(name)) + name.encode() + b"\x00" + unsigned(k) for name, k in self._exports.items()]
        return b"".join(
            [
                wasm.MAGIC,
                wasm.section(wasm.TYPES, wasm.vector(self._types)),
                wasm.section(wasm.FUNCTIONS, wasm.vector([unsigned(kind) for kind, _ in self._functions])),
                wasm.section(wasm.MEMORIES, wasm.vector([b"\x00" + unsigned(pages)])),
                wasm.section(wasm.EXPORTS, wasm.vector([memory, *names])),
                wasm.section(wasm.CODE, wasm.vector([code for _, code in self._functions])),
            ]
        )

    def _function(self, routine: Routine) -> Called:
        if routine not in self._called:
            inputs, outputs = [self._room(n) for n in routine.inputs], [self._room(n) for n in routine.layout.sizes]
            for inner in routine.calls:
                self._function(inner)
            code = WasmCode(routine.body, routine.outputs, lambda part, k: wasm.load(inputs[part] + 8 * k))
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
                code.code += wasm.store(outputs[part] + 8 * k, code.operand(value))
            index = self._added(wasm.signature((), ()), code.locals, bytes(code.code))
            self._called[routine] = Called(index, inputs, outputs)
        return self._called[routine]

    def _room(self, numbers: int) -> int:
        at, self._memory = self._memory, self._memory + 8 * numbers
        return at

    def _added(self, kind: bytes, variables: Sequence[bytes], code: bytes) -> int:
        if kind not in self._types:
            self._types.append(kind)
        self._functions.append((self._types.index(kind), wasm.body(variables, code)))
        return len(self._functions) - 1

    def _sincos(self) -> int:
        """The function from an angle to its sine and cosine, NaN where it is too far: the operations of native code."""
        if self._turning is None:
            routine = trace(lambda x: DOUBLE.reduced(x[0]), {"x": 1})
            angle = GET + b"\x00"
            code = WasmCode(routine.body, routine.outputs, lambda _part, _k: angle, parameters=1)
            for x in routine.body:
                code.compute(x, lambda: 0)
            sine, cosine = (code.keep(code.operand(value), F64) for value in routine.outputs[:2])
            quarter = code.keep(code.operand(routine.outputs[2]) + b"\xbd", I64)
            odd = quarter + _integer(1) + b"\x83\xa7"  # i32.wrap(k & 1)
            near = angle + b"\x99" + wasm.constant(DOUBLE.farthest) + b"\x65"
            after = quarter + _integer(1) + b"\x7c"
            turned = [(cosine + sine + odd + SELECT, quarter), (sine + cosine + odd + SELECT, after)]
            for value, sign in turned:
                signed = value + b"\xbd" + sign + _integer(2) + b"\x83" + _integer(62) + b"\x86\x85\xbf"
                code.code += signed + wasm.constant(float("nan")) + near + SELECT
            self._turning = self._added(wasm.signature([F64], [F64, F64]), code.locals, bytes(code.code))
        return self._turning


def _integer(n: int) -> bytes:
    """A whole number below 64, of 64 bits."""
    return b"\x42" + bytes([n])


def memory_of(places: Mapping[str, int]) -> dict[str, int]:
    """Indices of 64-bit floats, as JavaScript's Float64Array counts, of the addresses `places`, in bytes, by the same
    names: an address divided by 8. Nothing is checked."""
    return {name: at // 8 for name, at in places.items()}
