"""Data of the finished replication: its items, and how many printed entries met which verdict."""

from __future__ import annotations

from dataclasses import dataclass

from adaptctl.experiments.replication.counts import Counts, marks, numbers
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.verdict import Item, Outturn
from adaptctl.recording import Setting


@dataclass(frozen=True, eq=False)
class Replication:
    """Result of the replication: items of the paper that were computed again, in its order."""

    experiment: str
    title: str
    study: Study
    items: tuple[Item, ...]
    settings: tuple[Setting, ...]
    seconds: float
    complete: bool = True

    @property
    def seed(self) -> int:
        """Seed of the first draw."""
        return self.study.seed

    @property
    def numbers(self) -> Counts:
        """Counts of printed numbers by verdict."""
        return numbers(self.items)

    @property
    def marks(self) -> Counts:
        """Counts of printed crosses and blanks by verdict."""
        return marks(self.items)

    @property
    def errata(self) -> tuple[str, ...]:
        """Names of the items that are wrong somewhere in the paper."""
        return self._named(Outturn.ERRATUM)

    @property
    def not_reproduced(self) -> tuple[str, ...]:
        """Names of the items that could not be reproduced."""
        return self._named(Outturn.NOT_REPRODUCED)

    def _named(self, verdict: Outturn) -> tuple[str, ...]:
        return tuple(item.name for item in self.items if item.verdict is verdict)
