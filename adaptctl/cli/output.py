"""Output of commands: JSON for programs, tables and text as wide as the terminal for people."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Group, RenderableType


def print_json(content: Mapping[str, Any]) -> None:
    """Print a mapping of JSON's types on stdout, indented by two characters. Raises `ValueError` for NaN and infinity,
    which JSON does not have, and `TypeError` for values of other types."""
    json.dump(content, sys.stdout, indent=2, allow_nan=False)
    sys.stdout.write("\n")


def print_parts(parts: Iterable[RenderableType]) -> None:
    """Print the parts of a report, texts and tables of the package rich, on stdout, one below the other, as wide as the
    terminal. `OSError` passes where stdout cannot be written."""
    from rich.console import Console

    console = Console()
    for part in parts:
        console.print(part)


def terminal_width() -> int:
    """Number of characters in a line of the terminal; 80 where there is no terminal and the environment variable
    COLUMNS is not set. Nothing is raised."""
    from rich.console import Console

    return Console().width


def titled(title: str, *parts: RenderableType) -> Group:
    """A group, of the package rich, of an empty line, a title in bold, and `parts`, texts or tables, indented by two
    characters. Nothing is raised."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    return Group(Text(), Text(title, style="bold"), *(Padding(part, (0, 0, 0, 2), expand=False) for part in parts))
