"""Output of commands: JSON for programs, tables and text as wide as the terminal for people.

The package rich, which takes longer to import than many a command runs, is imported where something is printed with it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, Group, RenderableType
    from rich.measure import Measurement
    from rich.table import Table
    from rich.text import Text

Words: TypeAlias = "str | tuple[str, str] | Text"
"""A text, or one with its style; names from files are no markup."""
UNBOUNDED = 10_000
"""characters: wider than any table"""


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


def words(*parts: Words) -> Text:
    """A text, `rich.text.Text`, of `parts` one after the other, each with its style if it has one. Nothing is
    raised."""
    from rich.text import Text

    return Text.assemble(*parts)


def stacked(*parts: RenderableType) -> Group:
    """A group, of the package rich, of `parts`, texts or tables, one below the other. Nothing is raised."""
    from rich.console import Group

    return Group(*parts)


def titled(title: str, *parts: RenderableType) -> Group:
    """A group, of the package rich, of an empty line, a title in bold, and `parts`, texts or tables, indented by two
    characters. Nothing is raised."""
    from rich.padding import Padding

    return stacked(words(), words((title, "bold")), *(Padding(part, (0, 0, 0, 2), expand=False) for part in parts))


def listed(rows: Iterable[Sequence[Words]], whole: bool = False) -> Table:
    """A table, `rich.table.Table`, of `rows` of texts without lines and heads; where they are `whole`, the first column
    is never folded. Nothing is raised."""
    from rich.table import Table

    table = Table(box=None, show_header=False, pad_edge=False)
    if whole:
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
    for row in rows:
        table.add_row(*map(words, row))
    return table


def headed(heads: Sequence[str], rows: Iterable[Sequence[Words]], numbers: bool = False) -> Table:
    """A table, `rich.table.Table`, with the columns' titles `heads` and `rows` of texts, flush right but for the first
    column where they are `numbers`. What is too wide for its column goes on in the next line. Nothing is raised."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for i, head in enumerate(heads):
        table.add_column(head, overflow="fold", justify="right" if numbers and i else "left")
    for row in rows:
        table.add_row(*map(words, row))
    return table


@dataclass(frozen=True)
class WrappedTable:
    """A table of numbers for a terminal of any width, printed by the package rich: `heads` are the columns' titles,
    `rows` hold a text for each column. Where it is too wide, further columns go on in tables below, the first column
    repeated in each, so that no number is cut. Nothing is checked at construction."""

    heads: Sequence[str]
    rows: Sequence[Sequence[Words]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table]:
        """Tables as wide as there is room, at least one column beside the first each."""
        left = list(range(1, len(self.heads)))
        while left:
            count = 1
            while count < len(left) and self._width(console, options, left[: count + 1]) <= options.max_width:
                count += 1
            yield self._table(left[:count])
            left = left[count:]

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        """Widths between which it can be drawn."""
        from rich.measure import Measurement

        whole = list(range(1, len(self.heads)))
        return Measurement(1, self._width(console, options, whole)).clamp(max_width=options.max_width)

    def _width(self, console: Console, options: ConsoleOptions, columns: Sequence[int]) -> int:
        from rich.measure import Measurement

        return Measurement.get(console, options.update(max_width=UNBOUNDED), self._table(columns)).maximum

    def _table(self, columns: Sequence[int]) -> Table:
        chosen = (0, *columns)
        rows = ([row[i] for i in chosen] for row in self.rows)
        return headed([self.heads[i] for i in chosen], rows, numbers=True)
