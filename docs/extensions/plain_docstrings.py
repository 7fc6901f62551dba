"""Docstrings as they are written: plain text with `names`, lists, and formulas that are set off by indentation.

reStructuredText would take ``|s|`` for a substitution, ``link_`` for a link, and run the lines of a formula
together.
"""

import re
from typing import Any

UNDERLINE = re.compile(r"-{3,}")
MARKUP = re.compile(r"(`+)(?:(?!\1).)*\1|([|*]|_(?!\w))")
"""A span in backticks, which stays, or a character that would be markup."""


def _as_written(app: Any, kind: str, name: str, what: Any, options: Any, lines: list[str]) -> None:
    if any(UNDERLINE.fullmatch(line) for line in lines):  # numpydoc's sections, which napoleon reads
        return
    result: list[str] = []
    literal = False
    for before, line in zip(["", *lines], lines, strict=False):
        set_off = line.startswith(" ")
        if set_off and not literal and not before:
            literal = True
            if not _last(result).endswith("::"):
                result += ["::", ""]
        literal = literal and (set_off or not line)
        result.append(line if literal else MARKUP.sub(_escaped, line))
    lines[:] = result


def _last(lines: list[str]) -> str:
    return next((line for line in reversed(lines) if line), "")


def _escaped(found: re.Match[str]) -> str:
    return found[0] if found[1] else f"\\{found[0]}"


def setup(app: Any) -> dict[str, bool]:
    """Listen to autodoc."""
    app.connect("autodoc-process-docstring", _as_written)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
