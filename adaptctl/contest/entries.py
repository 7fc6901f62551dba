"""Entries of a contest: a law on a robot, under all conditions and seeds, whose rows are one file."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from adaptctl.arrays import Array
from adaptctl.contest.conditions import CONDITIONS, PlantCondition
from adaptctl.contest.contest_file import law_name
from adaptctl.contest.foreign_runs import foreign_runs
from adaptctl.contest.known import Knowledge, Known
from adaptctl.contest.laws import LAWS, Entrant
from adaptctl.contest.measures import DIVERGED, NOTHING, RECORDED, ContestRuns, measured
from adaptctl.contest.own_law import is_own, line_in, own_entrant, source_hash
from adaptctl.contest.scene import Scene, robot_name, scene_of
from adaptctl.contest.trial import TimeExceededError, tried
from adaptctl.contest.unseen_motion import unseen_torque_error
from adaptctl.control import Controller
from adaptctl.errors import AdaptctlError, printable
from adaptctl.files import hashed
from adaptctl.simulation import simulate_many
from adaptctl.simulation.whole_runs import whole
from adaptctl.version import __version__

Row: TypeAlias = dict[str, Any]
LONGEST_REASON = 400
"""characters"""


@dataclass(frozen=True)
class ContestEntry:
    """A law on a robot."""

    law: str
    robot: str
    robot_sha256: str
    conditions: tuple[str, ...]
    seeds: tuple[int, ...]
    duration: float
    draws: tuple[str, ...]
    plant: str

    @property
    def name(self) -> str:
        """Name of its file, which tells all that its rows depend on."""
        own = source_hash(self.law) if is_own(self.law) else self.law
        told = [self.robot_sha256, own, __version__, self.conditions, self.seeds, self.duration, self.draws, self.plant]
        return f"{robot_name(self.robot)}.{law_name(self.law)}.{hashed(told)[:16]}.parquet"

    def rows(self) -> list[Row]:
        """Rows by condition and seed; a run that fails has its reason."""
        warnings.simplefilter("ignore")
        try:
            entrant = entrant_of(self.law)
        except Exception as error:  # whatever the law's own code raises
            return [row for name in self.conditions for row in self.failed(name, self.reason_of(error))]
        trials: dict[float, int] = {}
        rows: list[Row] = []
        for name in self.conditions:
            try:
                rows += self._under(name, entrant, trials)
            except TimeExceededError as error:  # as it would again
                rest = self.conditions[self.conditions.index(name) :]
                return rows + [row for other in rest for row in self.failed(other, self.reason_of(error), entrant)]
        return rows

    def about(self, condition: str, seed: int) -> Row:
        """Row of a run before it is made."""
        named = {"robot": robot_name(self.robot), "condition": condition, "law": law_name(self.law), "seed": seed}
        return {**NOTHING, **named, "knows": "", "gains": "", "reason": "", "parameters": 0}

    def failed(self, condition: str, reason: str, entrant: Entrant | None = None, **more: Any) -> Iterator[Row]:
        """Rows of all seeds under a condition, with the reason why there are no others."""
        for seed in self.seeds:
            yield {**self.about(condition, seed), **_told(entrant), **more, "reason": reason}

    def reason_of(self, error: BaseException) -> str:
        """Reason of a failure in a line, which names that of the law's own file."""
        told = " ".join(str(error).split()) or "no message"
        if isinstance(error, AdaptctlError):
            return printable(told, LONGEST_REASON)
        where = line_in(Path(self.law.rpartition(":")[0]), error) if is_own(self.law) else ""
        return printable(f"{type(error).__name__}: {told}", LONGEST_REASON) + where

    def _under(self, name: str, entrant: Entrant, trials: dict[float, int]) -> list[Row]:
        condition = CONDITIONS[name]
        more: Row = {}
        period = condition.control_period
        try:
            scene = scene_of(self.robot, period)
            more["parameters"] = len(scene.model.names)
            truth = [condition.parameters(scene, seed) for seed in self.seeds]
            known = [Known.of(scene, entrant.knows, *each) for each in zip(self.seeds, truth, strict=True)]
            if period not in trials:
                trials[period] = tried(entrant, known[0])
            more["operations"] = trials[period]
            laws = _laws(entrant, known)
            runs = self.run(scene, condition, laws, np.array(truth))
        except TimeExceededError:
            raise
        except Exception as error:  # whatever the law's own code raises
            if not (is_own(self.law) or isinstance(error, AdaptctlError)):
                raise
            return list(self.failed(name, self.reason_of(error), entrant, **more))
        limits, more = condition.limit_share * scene.tuning.torque_limits, {**more, **_told(entrant)}
        found = (measured(runs, k, limits, condition.event) for k in range(len(self.seeds)))
        rows = [{**self.about(name, seed), **more, **one} for seed, one in zip(self.seeds, found, strict=True)]
        for k, row in enumerate(rows):
            if not row["reason"]:
                loaded = condition.loaded(scene, truth[k], self.duration)
                one = laws if isinstance(laws, Controller) else laws[k]
                row["unseen"] = unseen_torque_error(scene, one, runs.estimate[k], loaded, row["seed"])
        return rows

    def run(self, scene: Scene, condition: PlantCondition, laws: Any, truth: Array) -> ContestRuns:
        """Runs of all seeds together."""
        followed = [
            scene.reference(seed) if "reference" in self.draws else scene.tuning.reference for seed in self.seeds
        ]
        signed = "initial error" in self.draws
        off = [scene.initial_error(seed) if signed else scene.tuning.initial_error for seed in self.seeds]
        start = np.array([one(0.0).p + error for one, error in zip(followed, off, strict=True)])
        shared: Row = {"duration": self.duration, "record_every": RECORDED}
        references = [condition.reference(one) for one in followed]
        if self.plant != "adaptctl":
            return foreign_runs(self.plant, scene, condition, laws, references, start, truth, **shared)
        given: Row = {"p": start, "parameters": truth, "seed": list(self.seeds), "divergence_bound": DIVERGED}
        runs = whole(simulate_many(condition.plant(scene), laws, references, **given, **shared))
        return ContestRuns(runs.time, runs.error, runs.torque, runs.largest_error, runs.diverged_at, runs.estimate[-1])


def entrant_of(law: str) -> Entrant:
    """Entrant of a law's name, or of its file and class."""
    return own_entrant(law) if is_own(law) else next(one for one in LAWS if one.name == law)


def _told(entrant: Entrant | None) -> Row:
    """Knowledge and gains of a law, as columns."""
    return {"knows": entrant.knows.value, "gains": entrant.tuned} if entrant else {}


def _laws(entrant: Entrant, known: list[Known]) -> Controller[Any] | list[Controller[Any]]:
    """One law for all seeds, or one each where it is told what differs between them."""
    first = entrant.make(known[0])
    same = [np.array_equal(one.told, known[0].told) for one in known]
    if entrant.knows is Knowledge.LIMITS or all(same):
        return first
    return [first if alike else entrant.make(one) for one, alike in zip(known, same, strict=True)]
