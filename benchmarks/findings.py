"""Findings of benchmarks: speed-ups, measurements and agreements, each with its goal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, TypeAlias

from benchmarks.interleaved import Race, Spread


class DisagreementError(Exception):
    """Two that were to be timed do not compute the same."""


@dataclass(frozen=True)
class Speedup:
    """Ratio of a peer's time to ours at the same work; seconds for one unit of that work."""

    what: str
    against: str
    ours: Spread
    theirs: Spread
    ratio: Spread
    at_least: float | None

    @classmethod
    def of(cls, what: str, against: str, race: Race, ours: str, theirs: str, at_least: float | None) -> Speedup:
        """Speed-up from a race of the two."""
        return cls(what, against, race.time(ours), race.time(theirs), race.ratio(theirs, ours), at_least)

    @property
    def as_asked(self) -> bool:
        """True if the median is as good as asked."""
        return self.at_least is None or self.ratio.median >= self.at_least


@dataclass(frozen=True)
class Measurement:
    """Measured value without a peer; `unit` is "s", or nothing for a plain number."""

    what: str
    value: Spread
    unit: str
    at_most: float | None

    @property
    def as_asked(self) -> bool:
        """True if the median is as good as asked."""
        return self.at_most is None or self.value.median <= self.at_most


@dataclass(frozen=True)
class Agreement:
    """The largest difference between two that should be equal."""

    what: str
    against: str
    difference: float
    at_most: float
    unit: str = ""

    def __post_init__(self) -> None:
        if not self.difference <= self.at_most:
            raise DisagreementError(
                f"{self.what} against {self.against}: {self.difference:.1e}, at most {self.at_most:.0e}"
            )


Finding: TypeAlias = Speedup | Measurement | Agreement


def plain(finding: Finding) -> Mapping[str, Any]:
    """Finding in JSON's types."""
    return {"kind": type(finding).__name__.lower(), **asdict(finding)}
