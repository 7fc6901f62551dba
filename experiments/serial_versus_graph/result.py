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
    """Counts of floating-point operations (additions, subtractions, multiplications, divisions, negations) of a
    mechanism's Slotine-Li regressor, the matrix that takes parameters to torques: `reduced`, on the fundamental (base)
    parameters, and `full`, on all. Nothing is checked at construction."""

    reduced: int
    """on the independent parameters"""
    full: int
    """on all"""


@dataclass(frozen=True, eq=False)
class Side:
    """Simulated runs of one of two arms that are compared, a serial one and one with a kinematic loop, and what is
    known of the arm. `name` is fit for a file ("serial") and `label` for legends; `comparison`, a `Comparison`, has the
    runs. `tip` (3,), m, is the point in the frame of the link of index `tip_link`, from 0, that is to follow the path;
    `desired` and `tips` map each run's name to the tip's desired and actual positions in the world, (T, 3) in m at T
    samples. `regressor` are the operation counts of the arm's regressor; `closures` is the number of joints that were
    cut to make a tree of its loops; and `printed_rank` the number of independent parameters in Table 13 of Sheu and
    Walker (1991). Nothing is checked at construction."""

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
        """Run of the arm under the controller that adapts all parameters, the one named "adaptive-full"; None where it
        was not run."""
        return next((run for run in self.comparison.runs if run.name == "adaptive-full"), None)

    @property
    def joints(self) -> int:
        """Number of the arm's joints, those included that were cut to make a tree of its kinematic loops."""
        return len(self.comparison.mechanism.links) + self.closures

    def tip_errors(self, run: ControllerRun) -> Array:
        """Distances (T,) of the arm's tip from its desired position, m, at the T samples of a `run` of this arm. Raises
        `KeyError` for another run."""
        return np.asarray(np.linalg.norm(self.tips[run.name] - self.desired[run.name], axis=-1))

    def tip_rms(self, run: ControllerRun | None, start: float = 0.0, stop: float = np.inf) -> float | None:
        """Root mean square distance of the arm's tip from its desired position, m, over the samples of a `run` from
        `start`, included, to `stop`, excluded (s; all by default); None where there are no samples or `run` is None.
        Raises `KeyError` for a run that is not this arm's."""
        if run is None:
            return None
        inside = (run.rollout.time >= start) & (run.rollout.time < stop)
        return float(np.sqrt(np.mean(self.tip_errors(run)[inside] ** 2))) if inside.any() else None

    def first_tip_rms(self, run: ControllerRun | None) -> float | None:
        """Root mean square distance of the arm's tip from its desired position, m, over the first second of a `run`;
        None for a shorter run, or where `run` is None. Raises `KeyError` for a run that is not this arm's."""
        return None if run is None or run.first_rms_error is None else self.tip_rms(run, stop=BEGINNING)

    def final_tip_rms(self, run: ControllerRun | None) -> float | None:
        """Root mean square distance of the arm's tip from its desired position, m, over the last two seconds of a
        `run`; None for a shorter run, or where `run` is None. Raises `KeyError` for a run that is not this arm's."""
        return None if run is None or run.final_rms_error is None else self.tip_rms(run, start=run.duration - SETTLED)


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Outcome of a comparison of several arms on one task: `sides`, a `Side` for each arm, in order; `experiment`, the
    experiment's name, its `title`, its `purpose` (a paragraph), its `settings`, a `Setting` each, and its `seed`;
    `duration`, s, the length asked for; and `complete`, False where the experiment was interrupted: `sides` are then
    those that had begun. Raises `InputError` at construction for no sides."""

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
