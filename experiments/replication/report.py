"""Report of the replication: one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from adaptctl.experiments.replication.printed import printed
from adaptctl.experiments.replication.result import Replication
from adaptctl.experiments.replication.verdict import Check, Outturn
from adaptctl.experiments.replication.wording import INCOMPLETE, facts, headline
from adaptctl.files import write_text
from adaptctl.recording.page import embedded, rendered

STYLES = {
    Outturn.GIVEN: "given",
    Outturn.REPRODUCED: "reproduced",
    Outturn.IN_SHAPE: "in-shape",
    Outturn.ERRATUM: "erratum",
    Outturn.NOT_REPRODUCED: "not-reproduced",
}


class Grid(NamedTuple):
    """Named tuple of checks of printed entries in the layout of a table of Sheu and Walker (1991): `columns`, their
    labels, and `rows`, each a label and, for every column, the check of the entry there or None where there is none.
    Nothing is checked at construction."""

    columns: list[str]
    rows: list[tuple[str, list[Check | None]]]


def write_report(path: str | Path, replication: Replication, figures: Mapping[str, Path]) -> None:
    """Write the report of a `replication` of Sheu and Walker (1991), one HTML page at `path` with the `figures` (PNG
    files by name) inside, whole or not at all; nothing is returned. Raises `FileError` where it cannot be written,
    `OSError` where a figure cannot be read."""
    write_text(path, report(replication, figures))


def report(replication: Replication, figures: Mapping[str, Path]) -> str:
    """HTML text of the report of a `replication` of Sheu and Walker (1991): one page with the `figures`, PNG files by
    name, inside. Raises `OSError` where a figure cannot be read."""
    drawings = [drawing for item in replication.items for drawing in item.drawings]
    return rendered(
        "replication.html",
        __package__ or "",
        replication=replication,
        headline=headline(replication),
        incomplete=INCOMPLETE,
        facts=list(facts(replication)),
        items=replication.items,
        grids={item.name: grid(item.name, item.checks) for item in replication.items},
        labels={item.name: item.label for item in replication.items},
        styles=STYLES,
        verdicts=[(verdict.value, STYLES[verdict], MEANINGS[verdict]) for verdict in Outturn],
        figures=embedded(drawings, figures),
    )


MEANINGS = {
    Outturn.GIVEN: "an input of the paper, used as printed",
    Outturn.REPRODUCED: "computed again as it stands; where digits are missing, their number is said",
    Outturn.IN_SHAPE: (
        "it depends on samples, a motion or an arm that the paper does not print; what was chosen is said, and the "
        "printed number lies among those of all seeds"
    ),
    Outturn.ERRATUM: "wrong, with a proof by numbers",
    Outturn.NOT_REPRODUCED: "outside of everything that was computed, and not shown to be wrong",
}


def grid(name: str, checks: Sequence[Check]) -> Grid:
    """Checks of the printed entries of one item, a `Grid` of columns' labels and rows in the layout of Sheu and Walker
    (1991). `name` is the item's, such as "table7", `checks` its checks. Columns are those of the paper's table of that
    name that have a check, in the table's order, or, where the item is no table, in the order in which the checks have
    them, as rows always are. Of two checks of one entry the last is shown."""
    table = printed().tables.get(name)
    present = dict.fromkeys(check.column for check in checks)
    columns = [column for column in (table.columns if table else present) if column in present]
    place = {(check.row, check.column): check for check in checks}
    rows = dict.fromkeys(check.row for check in checks)
    return Grid(columns, [(row, [place.get((row, column)) for column in columns]) for row in rows])
