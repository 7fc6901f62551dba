"""Flags of commands, and their output: JSON for programs, tables and text as wide as the terminal for people.

The package rich, which takes longer to import than many a command runs, is imported where something is printed with it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from cyclopts import Parameter

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, Group, RenderableType
    from rich.measure import Measurement
    from rich.table import Table
    from rich.text import Text

    from adaptctl.recording.page import Part, Section
    from adaptctl.recording.page import Table as Content
    from adaptctl.recording.result import Fact

Robot = Annotated[str, Parameter(help="Name of a built-in robot, or a .urdf, .xml (MJCF) or .toml file.")]
Json = Annotated[bool, Parameter(help="Print JSON instead of text.")]
Period = Annotated[float, Parameter(help="Control period, s.")]
Folder = Annotated[Path, Parameter(metavar="DIR", help="Folder to write.")]
Overwrite = Annotated[bool, Parameter(help="Overwrite a folder that is not empty.")]

Words: TypeAlias = "str | tuple[str, str] | Text"
"""A text, or one with its style; names from files are no markup."""
UNBOUNDED = 10_000
"""characters: wider than any table"""


def print_json(content: Mapping[str, Any]) -> None:
    """Print a mapping of JSON's types on stdout, indented by two characters."""
    print(json.dumps(content, indent=2, allow_nan=False))


def print_note(text: str) -> None:
    """Print a note, a line on stderr."""
    print(f"adaptctl: note: {text}", file=sys.stderr)


def print_parts(parts: Iterable[RenderableType]) -> None:
    """Print parts, one below the other, as wide as the terminal."""
    from rich.console import Console

    console = Console()
    for part in parts:
        console.print(part)


def words(*parts: Words) -> Text:
    """A text, `rich.text.Text`, of `parts` one after the other, each with its style if it has one."""
    from rich.text import Text

    return Text.assemble(*parts)


def stacked(*parts: RenderableType) -> Group:
    """A group, of the package rich, of `parts`, texts or tables, one below the other. Nothing is raised."""
    from rich.console import Group

    return Group(*parts)


def titled(title: str, *parts: RenderableType) -> Group:
    """Group of an empty line, a title in bold and indented parts."""
    from rich.padding import Padding

    return stacked(words(), words((title, "bold")), *(Padding(part, (0, 0, 0, 2), expand=False) for part in parts))


def listed(rows: Iterable[Sequence[Words]], whole: bool = False) -> Table:
    """Table without lines and heads; the first column is never folded where `whole`."""
    from rich.table import Table

    table = Table(box=None, show_header=False, pad_edge=False)
    if whole:
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
    for row in rows:
        table.add_row(*map(words, row))
    return table


def headed(heads: Sequence[str], rows: Iterable[Sequence[Words]], align: str = "") -> Table:
    """Table with heads; columns whose letter of `align` is "r" are flush right."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for head, letter in zip(heads, align.ljust(len(heads), "l"), strict=True):
        table.add_column(words(head), overflow="fold", justify="right" if letter == "r" else "left")
    for row in rows:
        table.add_row(*map(words, row))
    return table


def print_sections(sections: Iterable[Section]) -> None:
    """Print the sections of a report on stdout, texts and tables; what only a page can show is left out."""
    for section in sections:
        parts = [_printed(part) for part in section.parts]
        print_parts([titled(section.title, *(part for part in parts if part is not None))])


def _printed(part: Part) -> RenderableType | None:
    from adaptctl.recording.page import Lines, Note, Table

    if isinstance(part, Table):
        return stacked(*([words(part.title)] if part.title else []), _table(part))
    if isinstance(part, Lines):
        return None if part.beside else listed(("-", line) for line in part.lines)
    if isinstance(part, Note):
        return words((part.head, "bold"), " " if part.head else "", part.text)
    return words(part) if isinstance(part, str) else None


def _table(content: Content) -> RenderableType:
    rows = [[cell.text for cell in row] for row in content.cells]
    if set(content.align[1:]) == {"r"}:
        return WrappedTable(content.header, rows)
    return headed(content.header, rows, content.align)


def print_outcome(outcome: str, facts: Iterable[Fact], folder: Path, notes: Iterable[str] = ()) -> None:
    """Print the `outcome` of what was run, its `facts` and `notes`, a line each, and where in its `folder` to look."""
    answers = list(facts)
    width = max(len(question) for question, *_ in answers)
    print(outcome)
    print("\n".join([f"  {question:<{width}}  {answer}" for question, answer, _ in answers]))
    print("".join(f"  note: {note}\n" for note in notes))
    if (folder / "recording.rrd").exists():
        print(f"Recording:   rerun {folder / 'recording.rrd'}")
    print(f"Report:      {folder / 'report.html'}")


@dataclass(frozen=True)
class WrappedTable:
    """Table that goes on below where it is too wide, so that no number is cut."""

    heads: Sequence[str]
    rows: Sequence[Sequence[Words]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table]:
        """Tables as wide as there is room, at least one column beside the first each."""
        left = list(range(1, len(self.heads)))
        while left:
            count = len(left)
            while count > 1 and self._width(console, options, left[:count]) > options.max_width:
                count -= 1
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
        return headed([self.heads[i] for i in chosen], rows, "l" + "r" * len(columns))
