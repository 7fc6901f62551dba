"""Arms of the paper with what its tables ask of each: draws, torques, orders of removal, bases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.dynamics import load
from adaptctl.experiments.replication.arms import (
    Draws,
    SampledArm,
    StatedMotion,
    index,
    near_parallelogram,
    paper_rank,
    puma560,
    semi_direct_drive,
)
from adaptctl.experiments.replication.judging import Computed, RoundOff, percent
from adaptctl.experiments.replication.printed import Printed
from adaptctl.identifiability import FundamentalBasis, Priority, fundamental_basis

ENERGY = "energy error [%]"
ROUND_OFF = 1e-15
"""(N m)^2 or percent: what is left when every component is kept stays below"""
COUNTS = (10, 20, 23, 25, 26, 30, 34, 35, 36)
"""The numbers of components of Tables 3 and 10 together."""
CLOSE = (0.05, 0.01, 0.001)
"""Root mean square torque errors, over the torque's own, that may be called very close; the first one judges."""
Entry: TypeAlias = Callable[[str, str], Computed]
"""What is compared with the printed entry in a row and a column."""


@dataclass(frozen=True, eq=False)
class StudiedArm:
    """Arm of a study with what follows from it, computed when first asked for; `priority` is the paper's table of the
    order in which its parameters are removed."""

    study: Study
    arm: SampledArm
    priority: str

    @cached_property
    def draws(self) -> Draws:
        """Random draws of the arm's states. Raises `RankError` where its rank cannot be certified."""
        s = self.study
        return Draws.of(self.arm, range(s.seed, s.seed + s.seeds), s.samples, s.velocity_scale)

    @cached_property
    def motion(self) -> StatedMotion:
        """Motion over one period of the study's sinusoid."""
        return self.arm.sinusoid(self.study.frequency, self.study.motion_samples)

    @cached_property
    def torque_errors(self) -> Array:
        """Mean square torque errors (seeds, k + 1, r), (N m)^2, of the draws along the motion."""
        return self.draws.torque_errors(self.motion)

    @property
    def order(self) -> Priority:
        """Order in which parameters are removed, from the printed table."""
        entries = sorted(self.study.paper.tables[self.priority].entries(), key=lambda entry: int(entry[2]))
        names = self.arm.mechanism.parameter_names
        return Priority(tuple(names[index(row, link)] for row, link, _ in entries))

    @cached_property
    def basis(self) -> FundamentalBasis:
        """Fundamental basis in that order, with exact right angles. Raises `RankError` where the rank cannot be
        certified."""
        return fundamental_basis(self.arm.space, self.order)

    @property
    def places(self) -> Entry:
        """Place, from 1, of each parameter in the default order of removal."""
        names = self.arm.mechanism.parameter_names
        order = list(Priority.default(self.arm.mechanism).indices(names))
        return lambda row, link: float(order.index(index(row, link)) + 1)

    @property
    def limits(self) -> Entry:
        """Limits of the built-in arm, rad and rad/s, as Tables 1 and 9 have them."""
        mechanism = self.arm.mechanism

        def limit(row: str, column: str) -> float:
            end = "upper" if " to " in row else "lower"
            if column == "p2 - p3" and (loops := mechanism.description.loops):
                return float(getattr(loops.conditions[0], end))
            own = mechanism.primary_joints[int(column) - 1].limits
            if row.startswith("velocity"):
                return own.velocity if end == "upper" else -own.velocity
            return float(getattr(own, end))

        return limit

    @property
    def errors(self) -> Entry:
        """Energy errors (%) and mean square torque errors ((N m)^2) by joint and number of components, over the
        draws; round-off with all components."""

        def error(row: str, column: str) -> Array | RoundOff:
            s = int(column)
            percents, torques = self.draws.percent_errors, self.torque_errors
            own = percents[:, s] if row == ENERGY else torques[:, s, int(row.removeprefix("joint")) - 1]
            return RoundOff(float(np.median(own)), ROUND_OFF) if s == self.draws.rank else own

        return error

    @property
    def medians(self) -> dict[str, list[str]]:
        """Medians over the draws of these errors, as lines of a table under its heading."""
        percents, torques = (np.median(one, axis=0) for one in (self.draws.percent_errors, self.torque_errors))
        joints = "".join(f"  joint{j + 1:<2}" for j in range(torques.shape[-1]))
        lines = [f"{'components':>10}  {'energy [%]':>10}{joints}"]
        for s in (count for count in COUNTS if count < len(percents)):
            lines.append(f"{s:>10}  {percents[s]:>10.2g}" + "".join(f"  {value:.1E}" for value in torques[s]))
        return {"Medians over the seeds: energy errors, and mean square torque errors in (N·m)²": lines}

    def fewest(self, enough: int) -> tuple[str, float]:
        """Medians over the draws, in words, of the fewest components with which every joint's RMS torque error is
        within a share of its torque's; and on which share of the draws the first needs `enough` or more."""
        squares = np.mean((self.motion.Y @ self.arm.parameters) ** 2, axis=0)
        needed = []
        for share in CLOSE:
            fine = (self.torque_errors <= share**2 * squares).all(axis=-1)
            needed.append(fine.shape[1] - np.logical_and.accumulate(fine[:, ::-1], axis=1).sum(axis=1))
        said = (f"{np.median(count):.0f} within {percent(share)}" for share, count in zip(CLOSE, needed, strict=True))
        return ", ".join(said), float(np.mean(needed[0] >= enough))


@dataclass(frozen=True)
class Study:
    """Settings of a replication of the `paper` with the arms that follow from them, computed when first asked for:
    `seeds` draws of `samples` states from `seed` on, velocities up to `velocity_scale` times the paper's bound;
    `frequency` (Hz) and `motion_samples` of the sinusoid for torques; and `unequal`, the fraction by which one side of
    the nearly parallel arm is longer than the opposite one."""

    paper: Printed
    seed: int
    seeds: int
    samples: int
    velocity_scale: float
    frequency: float
    motion_samples: int
    unequal: float

    @cached_property
    def puma(self) -> StudiedArm:
        """PUMA 560 of the paper."""
        return StudiedArm(self, puma560(self.paper), "table4")

    @cached_property
    def arm3(self) -> SampledArm:
        """First three joints of the PUMA 560, which the paper never samples."""
        nowhere = np.zeros(3)
        return SampledArm(load("puma560_arm3"), nowhere, nowhere, np.eye(3), nowhere)

    @cached_property
    def five_bar(self) -> StudiedArm:
        """Semi-direct-drive arm of four different lengths."""
        return StudiedArm(self, semi_direct_drive(self.paper), "table11")

    @cached_property
    def nearly_parallel(self) -> StudiedArm:
        """Semi-direct-drive arm whose opposite sides are equal but for `unequal`."""
        return StudiedArm(self, semi_direct_drive(self.paper, near_parallelogram(self.unequal)), "table11")

    @cached_property
    def parallelogram(self) -> SampledArm:
        """Semi-direct-drive arm whose opposite sides are equal."""
        return semi_direct_drive(self.paper, load("semi_direct_drive_parallelogram"))

    @property
    def drawn(self) -> dict[str, Draws]:
        """Random draws that were computed so far, by the arm's name."""
        cases = {"puma560": "puma", "semi_direct_drive": "five_bar", "nearly_parallelogram": "nearly_parallel"}
        found = {label: self.__dict__[key] for label, key in cases.items() if key in self.__dict__}
        return {label: case.draws for label, case in found.items() if "draws" in case.__dict__}

    def said(self, claim: str) -> int:
        """Number in question in a `claim` of the paper."""
        return int(self.paper.claims[claim].numbers)

    def rank_share(self, claim: str, draws: Draws) -> float:
        """Share of the `draws` on which the paper's threshold finds the rank that its `claim` prints."""
        return float(np.mean(paper_rank(draws.singular_values) == self.said(claim)))

    def differences(self, arm: SampledArm) -> Array:
        """Energy differences H of one draw of an `arm`."""
        states = arm.states(np.random.default_rng(self.seed), self.samples, self.velocity_scale)
        return np.diff(arm.energies(*states), axis=0)

    @property
    def numbers(self) -> dict[str, object]:
        """Settings by name, for the words that say what was chosen."""
        is_rms = abs(self.velocity_scale - 3**0.5) < 1e-3
        return {
            **{name: getattr(self, name) for name in self.__dataclass_fields__},
            "unequal": percent(self.unequal),
            "root_mean_square": ", so that their root mean square is the bound" if is_rms else "",
        }
