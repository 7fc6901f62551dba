"""Tables for a terminal of any width: one that is too wide goes on below, and no number is cut."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich import box
from rich.console import Console, ConsoleOptions
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

UNBOUNDED = 10_000
"""characters: wider than any table"""


@dataclass(frozen=True)
class WrappedTable:
    """A table for a terminal of any width, printed by the package rich: `heads` are the columns' titles, `rows` hold a
    text for each column. Where it is too wide, further columns go on in tables below, the first column repeated in
    each, so that no number is cut. Nothing is checked at construction."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str | Text]]

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
        whole = list(range(1, len(self.heads)))
        return Measurement(1, self._width(console, options, whole)).clamp(max_width=options.max_width)

    def _width(self, console: Console, options: ConsoleOptions, columns: Sequence[int]) -> int:
        return Measurement.get(console, options.update(max_width=UNBOUNDED), self._table(columns)).maximum

    def _table(self, columns: Sequence[int]) -> Table:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        table.add_column(self.heads[0], overflow="fold")
        for i in columns:
            table.add_column(self.heads[i], justify="right", overflow="fold")
        for row in self.rows:
            table.add_row(row[0], *(row[i] for i in columns))
        return table
