"""Data of several arms on one task: each one's runs, and the paths of its tip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.recording.comparison import BEGINNING, SETTLED, Comparison, ControllerRun, Setting


@dataclass(frozen=True)
class OperationCounts:
    """Operation counts of a compiled Slotine-Li regressor: additions, subtractions, multiplications, divisions and
    negations."""

    reduced: int
    """on the independent parameters"""
    full: int
    """on all"""


@dataclass(frozen=True, eq=False)
class Side:
    """One side of the comparison: an arm's runs, and the path of its tip."""

    name: str
    """short and fit for a file: ``serial``"""
    label: str
    comparison: Comparison
    tip_link: int
    tip: Array
    """(3,) the point of that link which is to follow the path, m"""
    desired: Mapping[str, Array]
    """(T, 3) where the tip should be, for each run by name, m"""
    tips: Mapping[str, Array]
    """(T, 3) where it was"""
    regressor: OperationCounts
    closures: int
    """joints that were cut to make a tree"""
    printed_rank: int
    """the number of independent parameters that the paper prints"""

    @property
    def full(self) -> ControllerRun | None:
        """Adaptive run on all parameters; None where it was not run."""
        return next((run for run in self.comparison.runs if run.name == "adaptive-full"), None)

    @property
    def joints(self) -> int:
        """Number of the mechanism's joints, those that were cut among them."""
        return len(self.comparison.mechanism.links) + self.closures

    def tip_errors(self, run: ControllerRun) -> Array:
        """Distance (T,) of the tip from where it should be, m."""
        return np.asarray(np.linalg.norm(self.tips[run.name] - self.desired[run.name], axis=-1))

    def tip_rms(self, run: ControllerRun | None, start: float = 0.0, stop: float = np.inf) -> float | None:
        """Root mean square of `tip_errors` over a stretch of time, m; None without samples."""
        if run is None:
            return None
        inside = (run.rollout.time >= start) & (run.rollout.time < stop)
        return float(np.sqrt(np.mean(self.tip_errors(run)[inside] ** 2))) if inside.any() else None

    def first_tip_rms(self, run: ControllerRun | None) -> float | None:
        """Root mean square distance of the tip over the first second, m; None where there is no such run."""
        return None if run is None or run.first_rms_error is None else self.tip_rms(run, stop=BEGINNING)

    def final_tip_rms(self, run: ControllerRun | None) -> float | None:
        """Root mean square distance of the tip over the last two seconds that were run, m; None where there is no such
        run."""
        return None if run is None or run.final_rms_error is None else self.tip_rms(run, start=run.duration - SETTLED)


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Arms side by side: runs of several on one task; of those only that were begun when it was interrupted."""

    experiment: str
    title: str
    purpose: str
    sides: tuple[Side, ...]
    settings: tuple[Setting, ...]
    seed: int
    duration: float
    complete: bool = True

    def __post_init__(self) -> None:
        if not self.sides:
            raise InputError(f"{self.experiment}: nothing was run, so there is nothing to show")
