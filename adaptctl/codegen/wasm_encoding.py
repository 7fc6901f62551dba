"""WebAssembly's binary format (WebAssembly Core Specification 1.0 with multiple results), as far as it is needed."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from itertools import groupby

from adaptctl.errors import InputError

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
    """The bytes of the whole number `n`, of at least 0, in WebAssembly's encoding of unsigned integers (LEB128: seven
    bits in each byte, the lowest first). Raises `InputError` for a negative one, of which there is no such encoding."""
    if n < 0:
        raise InputError(f"WebAssembly: an unsigned integer: expected a whole number of at least 0, got {n}")
    out = bytearray()
    while True:
        n, low = n >> 7, n & 0x7F
        out.append(low | (0x80 if n else 0))
        if not n:
            return bytes(out)


def vector(items: Sequence[bytes]) -> bytes:
    """The bytes of WebAssembly's encoding of a vector: the number of `items`, then these, each encoded already. Nothing
    is raised."""
    return unsigned(len(items)) + b"".join(items)


def section(number: int, content: bytes) -> bytes:
    """The bytes of a section of a WebAssembly module: its `number`, which tells its kind, its length, and its encoded
    `content`. Raises `ValueError` for a number that is not from 0 to 255."""
    return bytes([number]) + unsigned(len(content)) + content


def signature(given: Iterable[bytes], made: Iterable[bytes]) -> bytes:
    """The bytes of WebAssembly's encoding of a function's type, from the encoded types, one byte each, of its
    arguments, `given`, and of its results, `made`. Nothing is checked."""
    return b"\x60" + vector(list(given)) + vector(list(made))


def body(locals_: Sequence[bytes], code: bytes) -> bytes:
    """The bytes of a WebAssembly function in a module's code section: its length, its local variables, whose encoded
    types `locals_` has in order, and its `code`, after which an end mark is put. Nothing is checked."""
    groups = [unsigned(len(list(group))) + kind for kind, group in groupby(locals_)]
    content = vector(groups) + code + END
    return unsigned(len(content)) + content


def constant(x: float) -> bytes:
    """The bytes of the WebAssembly instruction that puts the float `x`, of 64 bits, on the stack. Nothing is raised."""
    return b"\x44" + struct.pack("<d", x)


def load(at: int) -> bytes:
    """The bytes of the WebAssembly instructions that put the 64-bit float at the address `at`, bytes from the beginning
    of memory, on the stack. Raises `InputError` for an address below 0."""
    return ZERO + b"\x2b\x03" + unsigned(at)


def store(at: int, value: bytes) -> bytes:
    """The bytes of the WebAssembly instructions that store a 64-bit float at the address `at`, bytes from the beginning
    of memory; `value` is the code that puts it on the stack. Raises `InputError` for an address below 0."""
    return ZERO + value + b"\x39\x03" + unsigned(at)
