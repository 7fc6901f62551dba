"""Data of the finished replication: its items, and how many printed entries met which verdict."""

from __future__ import annotations

from dataclasses import dataclass

from adaptctl.experiments.replication.counts import Counts, marks, numbers
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.verdict import Item, Outturn
from adaptctl.recording import Setting


@dataclass(frozen=True, eq=False)
class Replication:
    """Replication of the tables and figures of Sheu and Walker (1991), finished or interrupted: `items`, an `Item` for
    each table, figure and section that was computed again, in the paper's order; `study`, the `Study` with the arms and
    random draws of states behind them; `experiment`, the experiment's name, its `title` and its `settings`, a `Setting`
    each; `seconds`, the time that it took; and `complete`, False where it was interrupted. Nothing is checked at
    construction."""

    experiment: str
    title: str
    study: Study
    items: tuple[Item, ...]
    settings: tuple[Setting, ...]
    seconds: float
    complete: bool = True

    @property
    def seed(self) -> int:
        """Seed of the first random draw of states of the replication."""
        return self.study.seed

    @property
    def numbers(self) -> Counts:
        """Counts by verdict, a `Counts`, of the numbers that Sheu and Walker (1991) print in the replication's items,
        crosses and blanks left out."""
        return numbers(self.items)

    @property
    def marks(self) -> Counts:
        """Counts by verdict, a `Counts`, of the crosses and blanks (parameter kept, or not) that Sheu and Walker (1991)
        print in the replication's items."""
        return marks(self.items)

    @property
    def errata(self) -> tuple[str, ...]:
        """Names of those items of the replication (tables, figures and sections of Sheu and Walker 1991), such as
        "table6", whose verdict is that they are wrong."""
        return self._named(Outturn.ERRATUM)

    @property
    def not_reproduced(self) -> tuple[str, ...]:
        """Names of those items of the replication (tables, figures and sections of Sheu and Walker 1991), such as
        "table10", whose verdict is that they could neither be reproduced nor be shown to be wrong."""
        return self._named(Outturn.NOT_REPRODUCED)

    def _named(self, verdict: Outturn) -> tuple[str, ...]:
        return tuple(item.name for item in self.items if item.verdict is verdict)
