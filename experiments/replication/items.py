"""Items of the paper that can be computed again, by the names that the command line takes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from difflib import get_close_matches

from adaptctl.errors import NotFoundError
from adaptctl.experiments.replication.comparisons import conclusions, table13
from adaptctl.experiments.replication.figures import figure1, figure3, figure4, figure6
from adaptctl.experiments.replication.mass_redistribution import section53
from adaptctl.experiments.replication.puma560_energy import table1, table2, table3
from adaptctl.experiments.replication.puma560_parameters import table4, table5, table6, table7, table8
from adaptctl.experiments.replication.semi_direct_drive_tables import table9, table10, table11, table12
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.verdict import Item

ALL = "all"

ITEMS: dict[str, Callable[[Study], Item]] = {
    "figure1": figure1,
    "table1": table1,
    "table2": table2,
    "figure3": figure3,
    "table3": table3,
    "figure4": figure4,
    "table4": table4,
    "table5": table5,
    "table6": table6,
    "table7": table7,
    "table8": table8,
    "table9": table9,
    "table10": table10,
    "figure6": figure6,
    "table11": table11,
    "table12": table12,
    "table13": table13,
    "section5.3": section53,
    "conclusions": conclusions,
}
"""In the order of the paper. Figures 2 and 5 are drawings of the two arms."""


def chosen(names: Iterable[str]) -> tuple[str, ...]:
    """Names of the tables, figures and sections of Sheu and Walker (1991) that `names` ask for, in the paper's order,
    each once: `names` has such names, such as "table7", or "all" for all. Raises `NotFoundError`, with the names that
    exist, for an unknown name."""
    asked = set(names)
    for name in sorted(asked - ITEMS.keys() - {ALL}):
        close = get_close_matches(name, ITEMS, n=1)
        guess = f" (did you mean {close[0]!r}?)" if close else ""
        raise NotFoundError(f"only: there is no {name!r}{guess}; there are {', '.join(ITEMS)}, and {ALL}")
    return tuple(name for name in ITEMS if name in asked or ALL in asked)
