"""Replication of Sheu and Walker (1991)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import ClassVar

from adaptctl.errors import InputError, NotFoundError
from adaptctl.experiments.experiment import ClosedLoopExperiment, setting, stated
from adaptctl.experiments.replication import closed_loop, puma560, semi_direct_drive
from adaptctl.experiments.replication.arms import Study
from adaptctl.experiments.replication.judging import Computation, Item, judged_item, printed
from adaptctl.experiments.replication.pages import Replication
from adaptctl.recording import Progress, Result

ITEMS: dict[str, Callable[[Study], Computation]] = {
    "section5.3" if step is semi_direct_drive.section53 else step.__name__: step
    for step in (*puma560.STEPS, *semi_direct_drive.STEPS)
}
"""In the paper's order; figures 2 and 5 are drawings of the arms."""
ALL, ARMS_IN_LOOP = "all", "serial-versus-graph"
OF_TABLES = ("seed", "seeds", "samples", "velocity_scale", "frequency", "motion_samples", "unequal")


@dataclass(frozen=True)
class SheuWalker1991(ClosedLoopExperiment):
    """Experiment that replicates Sheu and Walker (1991)."""

    name: ClassVar[str] = "sheu-walker-1991"
    title: ClassVar[str] = "Replication of Sheu and Walker (1991)"

    only: tuple[str, ...] = setting(
        (ALL,), f"items to compute: {ALL}, or any of {', '.join(ITEMS)}; or the closed-loop comparison: {ARMS_IN_LOOP}"
    )
    seeds: int = setting(200, "number of seeds, from --seed on; the paper has one draw", low=2, high=10_000)
    samples: int = setting(101, "states per draw; 101 in the paper", low=62, high=10_000)
    velocity_scale: float = setting(3**0.5, "velocity bound divided by that of the paper", low=0.01, high=100.0)
    frequency: float = setting(0.7, "frequency of the sinusoid for computed torques, Hz", low=0.01, high=10.0)
    motion_samples: int = setting(501, "samples per period of the sinusoid", low=11, high=5001)
    unequal: float = setting(0.005, "relative excess length of link 4 of the nearly parallel arm", low=1e-5, high=0.1)

    def __post_init__(self) -> None:
        super().__post_init__()
        chosen(self.only)

    def run(self, progress: Progress) -> Result:
        """Replication, or the arms in closed loop."""
        if chosen(self.only) == ():
            return closed_loop.side_by_side(self.seed, self.duration, self.control_period, progress)
        return self.replication(progress).result

    def replication(self, progress: Progress) -> Replication:
        """Replication of what `only` names."""
        started, names, items = time.perf_counter(), chosen(self.only), list[Item]()
        study = Study(printed(), **{name: getattr(self, name) for name in OF_TABLES})
        try:
            for i, name in enumerate(names):
                progress("Tables and figures", i / len(names))
                items.append(judged_item(name, study.paper, ITEMS[name](study), study.numbers))
            progress("Tables and figures", 1.0)
        except KeyboardInterrupt:
            if not items:
                raise
        flags = {f"--{name.replace('_', '-')}" for name in (*OF_TABLES, "only")}
        settings = tuple(one for one in stated(self) if one.name in flags)
        seconds, complete = time.perf_counter() - started, len(items) == len(names)
        return Replication(self.name, self.title, study, tuple(items), settings, seconds, complete)


def chosen(names: Iterable[str]) -> tuple[str, ...]:
    """Names in the paper's order."""
    asked = set(names)
    for name in sorted(asked - ITEMS.keys() - {ALL, ARMS_IN_LOOP}):
        close = get_close_matches(name, (*ITEMS, ARMS_IN_LOOP), n=1)
        guess = f" (did you mean {close[0]!r}?)" if close else ""
        there = ", ".join((*ITEMS, ARMS_IN_LOOP))
        raise NotFoundError(f"only: unknown item {name!r}{guess}; items: {there}, and {ALL}")
    if ARMS_IN_LOOP in asked and len(asked) > 1:
        raise InputError(f"only: {ARMS_IN_LOOP} is a separate run; give it alone")
    return tuple(name for name in ITEMS if name in asked or ALL in asked)
