"""Replication of Sheu and Walker (1991): every table and figure beside what is computed, with a verdict."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import ClassVar

from adaptctl.experiments.experiment import Experiment, setting, stated
from adaptctl.experiments.replication.artifacts import shown
from adaptctl.experiments.replication.items import ALL, ITEMS, chosen
from adaptctl.experiments.replication.result import Replication
from adaptctl.experiments.replication.study import Study
from adaptctl.experiments.replication.verdict import Item
from adaptctl.recording import Progress, Result

STAGE = "Tables and figures"


@dataclass(frozen=True)
class SheuWalker1991(Experiment):
    """Experiment that replicates Sheu and Walker (1991), "Identifying the independent inertial parameter space of robot
    manipulators": every table and figure of its PUMA 560 and semi-direct-drive arm is computed again and compared with
    what the paper prints. Raises at construction `NotFoundError` for an unknown table or figure in `only`, `InputError`
    for a setting of the wrong type or out of its bounds, `NonFiniteError` for NaN or infinity."""

    name: ClassVar[str] = "sheu-walker-1991"
    title: ClassVar[str] = "Sheu and Walker (1991), replicated"

    only: tuple[str, ...] = setting((ALL,), f"what to compute: {ALL}, or any of {', '.join(ITEMS)}")
    seeds: int = setting(200, "draws of random states where the paper made one, from --seed on", low=2, high=10_000)
    samples: int = setting(101, "states a draw; the paper's 101", low=62, high=10_000)
    velocity_scale: float = setting(
        3**0.5,
        "velocities are uniform up to this times the paper's bound; the root of 3 makes the bound their root mean "
        "square, which meets the scale of Table 2",
        low=0.01,
        high=100.0,
    )
    frequency: float = setting(
        0.7, "of the sinusoid for computed torques, Hz; this one meets the scale of Table 3", low=0.01, high=10.0
    )
    motion_samples: int = setting(501, "samples over the sinusoid's period", low=11, high=5001)
    unequal: float = setting(
        0.005, "share by which link 4 of the nearly parallel arm is longer than link 2", low=1e-5, high=0.1
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        chosen(self.only)

    def run(self, progress: Progress) -> Result:
        """Result of replicating Sheu and Walker (1991), a `Result`: outcome in words, facts (questions with answers),
        an empty verdict, since no controller runs, and a function that writes the result files into a folder that it is
        given. `progress(what, share)` is called with the step's name and the fraction done, 0 to 1; Ctrl-C
        (`KeyboardInterrupt`) keeps the tables and figures done, and is raised where there are none. Raises `RankError`
        where an arm's number of independent parameters cannot be certified."""
        return shown(self.compare(progress))

    def compare(self, progress: Progress) -> Replication:
        """Replication of Sheu and Walker (1991), a `Replication`, of the tables and figures that the setting `only`
        names, in the paper's order. `progress(what, share)` is called with the step's name and the fraction done, 0 to
        1; Ctrl-C (`KeyboardInterrupt`) keeps those done, as a replication that is not complete, and is raised where
        there are none. Raises `RankError` where an arm's number of independent parameters cannot be certified."""
        started, names = time.perf_counter(), chosen(self.only)
        study, items = self._study(), list[Item]()
        try:
            for i, name in enumerate(names):
                progress(STAGE, i / len(names))
                items.append(ITEMS[name](study))
            progress(STAGE, 1.0)
        except KeyboardInterrupt:
            if not items:
                raise
        return Replication(
            experiment=self.name,
            title=self.title,
            study=study,
            items=tuple(items),
            settings=tuple(stated(self)),
            seconds=time.perf_counter() - started,
            complete=len(items) == len(names),
        )

    def _study(self) -> Study:
        return Study(
            seed=self.seed,
            seeds=self.seeds,
            samples=self.samples,
            velocity_scale=self.velocity_scale,
            frequency=self.frequency,
            motion_samples=self.motion_samples,
            unequal=self.unequal,
        )
