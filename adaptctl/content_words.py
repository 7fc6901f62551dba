"""Words for what is wrong with the contents of a file."""

from __future__ import annotations

import re

KINDS = {
    "object": "a table",
    "array": "a list",
    "str": "text",
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "null": "nothing",
}
"""of msgspec's names of types"""
_TYPES = re.compile(rf"`((?:{'|'.join(KINDS)})(?: \| (?:{'|'.join(KINDS)}))*)`")


def in_words(message: str) -> str:
    """msgspec's message for readers of files, such as "expected a number, got text - at `$.links[0].mass`"."""
    message = re.sub(r"^Object missing required field (`[^`]*`)", r"\1 is missing", message)
    message = re.sub(r"^Object contains unknown field", "unknown field", message)
    return _TYPES.sub(_named, re.sub("^Expected ", "expected ", message))


def _named(found: re.Match[str]) -> str:
    """Kinds of values; what may be left out is not told, since no file says nothing by a value."""
    names = found.group(1).split(" | ")
    return " or ".join(KINDS[name] for name in names if name != "null" or len(names) == 1)
