"""Data of the finished replication: its items, and how many printed entries met which verdict."""

from __future__ import annotations

from dataclasses import dataclass

from adaptctl.experiments.replication.counts import Counts, marks, numbers
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.verdict import Item, Outturn
from adaptctl.recording import Setting


@dataclass(frozen=True, eq=False)
class Replication:
    """Data of a replication of Sheu and Walker (1991): `items`, the tables, figures and sections that were computed
    again, in the paper's order; `study`, the arms and random draws of states behind them; name and `title` of the
    `experiment`, its `settings`, the `seconds` that it took; and `complete`, False where it was interrupted. Nothing is
    checked at construction."""

    experiment: str
    title: str
    study: Study
    items: tuple[Item, ...]
    settings: tuple[Setting, ...]
    seconds: float
    complete: bool = True

    @property
    def seed(self) -> int:
        """Seed of the first random draw of states."""
        return self.study.seed

    @property
    def numbers(self) -> Counts:
        """Counts of the numbers that Sheu and Walker (1991) print, by verdict, crosses and blanks left out."""
        return numbers(self.items)

    @property
    def marks(self) -> Counts:
        """Counts of the crosses and blanks (parameter kept, or not) that Sheu and Walker (1991) print, by verdict."""
        return marks(self.items)

    @property
    def errata(self) -> tuple[str, ...]:
        """Names of the items (tables, figures and sections of Sheu and Walker 1991), such as "table6", that are shown
        to be wrong in some entry."""
        return self._named(Outturn.ERRATUM)

    @property
    def not_reproduced(self) -> tuple[str, ...]:
        """Names of the items (tables, figures and sections of Sheu and Walker 1991), such as "table10", that could
        neither be reproduced nor be shown to be wrong."""
        return self._named(Outturn.NOT_REPRODUCED)

    def _named(self, verdict: Outturn) -> tuple[str, ...]:
        return tuple(item.name for item in self.items if item.verdict is verdict)
