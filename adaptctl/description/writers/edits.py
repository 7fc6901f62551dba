"""Edits of XML text by place: what is not edited stays as it is, byte for byte."""

from __future__ import annotations

from collections.abc import Iterable


def edited(data: bytes, edits: Iterable[tuple[int, int, bytes]]) -> bytes:
    """The text with pieces from start to end replaced; they must not overlap."""
    for start, end, new in sorted(edits, reverse=True):
        data = data[:start] + new + data[end:]
    return data


def end_of_tag(data: bytes, at: int) -> int:
    """Index behind the '>' of the tag that begins at a place; quoted attributes may hold one too."""
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
