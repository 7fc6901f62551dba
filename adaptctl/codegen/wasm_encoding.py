"""WebAssembly's binary format (WebAssembly Core Specification 1.0 with multiple results), as far as it is needed."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from itertools import groupby

F64, I64, I32 = b"\x7c", b"\x7e", b"\x7f"
MAGIC = b"\0asm\x01\0\0\0"
PAGE = 65536
TYPES, FUNCTIONS, MEMORIES, EXPORTS, CODE = 1, 3, 5, 7, 10
"""Numbers of sections."""

GET, SET = b"\x20", b"\x21"
CALL, SELECT, END = b"\x10", b"\x1b", b"\x0b"
ZERO = b"\x41\x00"
"""The address to which offsets are added."""


def unsigned(n: int) -> bytes:
    """The LEB128 encoding of a whole number of at least 0."""
    out = bytearray()
    while True:
        n, low = n >> 7, n & 0x7F
        out.append(low | (0x80 if n else 0))
        if not n:
            return bytes(out)


def vector(items: Sequence[bytes]) -> bytes:
    """WebAssembly's encoding of a vector: the items after their count."""
    return unsigned(len(items)) + b"".join(items)


def section(number: int, content: bytes) -> bytes:
    """WebAssembly's encoding of a section of a module, by its number and content."""
    return bytes([number]) + unsigned(len(content)) + content


def signature(given: Iterable[bytes], made: Iterable[bytes]) -> bytes:
    """WebAssembly's encoding of a function's type, from the types of its arguments and results."""
    return b"\x60" + vector(list(given)) + vector(list(made))


def body(locals_: Sequence[bytes], code: bytes) -> bytes:
    """WebAssembly's encoding of a function's code after its size; `locals_` has the types of its own variables in
    order."""
    groups = [unsigned(len(list(group))) + kind for kind, group in groupby(locals_)]
    content = vector(groups) + code + END
    return unsigned(len(content)) + content


def constant(x: float) -> bytes:
    """WebAssembly code that puts a number on the stack."""
    return b"\x44" + struct.pack("<d", x)


def load(at: int) -> bytes:
    """WebAssembly code that puts the number at a place in memory (bytes) on the stack."""
    return ZERO + b"\x2b\x03" + unsigned(at)


def store(at: int, value: bytes) -> bytes:
    """WebAssembly code that stores a number at a place in memory (bytes)."""
    return ZERO + value + b"\x39\x03" + unsigned(at)
