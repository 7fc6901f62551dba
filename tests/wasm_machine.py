"""A small machine for WebAssembly's binary format, written from the specification: for tests of what is emitted."""

from __future__ import annotations

import math
import struct
from typing import Any


class Machine:
    """A module's memory and functions."""

    def __init__(self, binary: bytes) -> None:
        assert binary[:8] == b"\0asm\x01\0\0\0"
        self.types: list[tuple[int, int]] = []
        self.kinds: list[int] = []
        self.codes: list[tuple[list[int], bytes]] = []
        self.exports: dict[str, int] = {}
        at, seen = 8, []
        while at < len(binary):
            number = binary[at]
            size, at = unsigned(binary, at + 1)
            self._section(number, binary[at : at + size])
            seen.append(number)
            at += size
        assert seen == sorted(seen)
        assert len(self.kinds) == len(self.codes)

    def _section(self, number: int, data: bytes) -> None:
        count, at = unsigned(data, 0)
        for _ in range(count):
            at = {1: self._type, 3: self._kind, 5: self._pages, 7: self._export, 10: self._code}[number](data, at)
        assert at == len(data)

    def _type(self, data: bytes, at: int) -> int:
        assert data[at] == 0x60
        given, at = unsigned(data, at + 1)
        made, at = unsigned(data, at + given)
        self.types.append((given, made))
        return at + made

    def _kind(self, data: bytes, at: int) -> int:
        kind, at = unsigned(data, at)
        self.kinds.append(kind)
        return at

    def _pages(self, data: bytes, at: int) -> int:
        assert data[at] == 0
        pages, at = unsigned(data, at + 1)
        self.memory = bytearray(65536 * pages)
        return at

    def _export(self, data: bytes, at: int) -> int:
        size, at = unsigned(data, at)
        name = data[at : at + size].decode()
        index, end = unsigned(data, at + size + 1)
        if data[at + size] == 0:
            self.exports[name] = index
        return end

    def _code(self, data: bytes, at: int) -> int:
        size, at = unsigned(data, at)
        end = at + size
        groups, at = unsigned(data, at)
        kinds: list[int] = []
        for _ in range(groups):
            count, at = unsigned(data, at)
            kinds += [data[at]] * count
            at += 1
        self.codes.append((kinds, data[at:end]))
        return end

    def write(self, at: int, values: Any) -> None:
        self.memory[at : at + 8 * len(values)] = struct.pack(f"<{len(values)}d", *values)

    def read(self, at: int, count: int) -> list[float]:
        return list(struct.unpack_from(f"<{count}d", self.memory, at))

    def call(self, index: int, *given: float) -> list[Any]:
        """Run a function; checks that the stack holds what its type says in the end."""
        kinds, code = self.codes[index]
        variables: list[Any] = [*given, *(0.0 if kind == 0x7C else 0 for kind in kinds)]
        stack: list[Any] = []
        at = 0
        while True:
            op, at = code[at], at + 1
            if op == 0x0B:
                assert at == len(code)
                assert len(stack) == self.types[self.kinds[index]][1]
                return stack
            if op in (0x20, 0x21, 0x10):
                n, at = unsigned(code, at)
                if op == 0x20:
                    stack.append(variables[n])
                elif op == 0x21:
                    variables[n] = stack.pop()
                else:
                    count = self.types[self.kinds[n]][0]
                    arguments = stack[len(stack) - count :]
                    del stack[len(stack) - count :]
                    stack += self.call(n, *arguments)
            elif op in (0x41, 0x42):
                stack.append(code[at])
                assert code[at] < 64
                at += 1
            elif op == 0x44:
                stack += struct.unpack_from("<d", code, at)
                at += 8
            elif op in (0x2B, 0x39):
                assert code[at] == 3
                offset, at = unsigned(code, at + 1)
                if op == 0x2B:
                    stack += struct.unpack_from("<d", self.memory, stack.pop() + offset)
                else:
                    value = stack.pop()
                    struct.pack_into("<d", self.memory, stack.pop() + offset, value)
            else:
                self._operate(op, stack)

    @staticmethod
    def _operate(op: int, stack: list[Any]) -> None:
        if op == 0x1B:
            condition, no = stack.pop(), stack.pop()
            stack[-1] = stack[-1] if condition else no
        elif op in ONE:
            stack.append(ONE[op](stack.pop()))
        else:
            b, a = stack.pop(), stack.pop()
            stack.append(TWO[op](a, b))


def unsigned(data: bytes, at: int) -> tuple[int, int]:
    """A number in LEB128, and where it ends."""
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at


def _extreme(choose: Any) -> Any:
    return lambda a, b: math.nan if a != a or b != b else choose(a, b)


def _divided(a: float, b: float) -> float:
    return a / b if b else math.copysign(math.inf, a) * math.copysign(1.0, b) if a and a == a else math.nan


ONE = {
    0x99: abs,
    0x9A: lambda a: -a,
    0x9E: lambda a: float(round(a)) if math.isfinite(a) else a,
    0x9F: lambda a: math.sqrt(a) if a >= 0.0 else math.nan,
    0xA7: lambda a: a & 0xFFFFFFFF,
    0xBD: lambda a: struct.unpack("<Q", struct.pack("<d", a))[0],
    0xBF: lambda a: struct.unpack("<d", struct.pack("<Q", a))[0],
}
TWO = {
    0x63: lambda a, b: int(a < b),
    0x65: lambda a, b: int(a <= b),
    0x7C: lambda a, b: (a + b) & (2**64 - 1),
    0x83: lambda a, b: a & b,
    0x85: lambda a, b: a ^ b,
    0x86: lambda a, b: (a << b) & (2**64 - 1),
    0xA0: lambda a, b: a + b,
    0xA1: lambda a, b: a - b,
    0xA2: lambda a, b: a * b,
    0xA3: _divided,
    0xA4: _extreme(min),
    0xA5: _extreme(max),
}
