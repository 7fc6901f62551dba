"""Edits of XML text by place: what is not edited stays as it is, byte for byte."""

from __future__ import annotations

from collections.abc import Iterable


def edited(data: bytes, edits: Iterable[tuple[int, int, bytes]]) -> bytes:
    """A copy of the bytes `data` with pieces replaced: each of `edits` is (start, end, new bytes), zero-based indices
    in `data`, `end` not included. The pieces must not overlap, which is not checked."""
    for start, end, new in sorted(edits, reverse=True):
        data = data[:start] + new + data[end:]
    return data


def end_of_tag(data: bytes, at: int) -> int:
    """The index in the XML bytes `data` just behind the ">" that ends the tag which begins at index `at`; a ">" within
    a quoted attribute does not count. It is the length of `data` where the tag does not end. Nothing is raised."""
    quote = 0
    for i in range(at, len(data)):
        byte = data[i]
        if quote:
            quote = 0 if byte == quote else quote
        elif byte in b"\"'":
            quote = byte
        elif byte == ord(">"):
            return i + 1
    return len(data)
