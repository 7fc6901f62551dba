"""Arms, draws and torques that the tables share, computed when first asked for."""

from __future__ import annotations

from dataclasses import dataclass

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism, load
from adaptctl.experiments.replication.arms import (
    SampledArm,
    StatedMotion,
    near_parallelogram,
    puma560,
    semi_direct_drive,
)
from adaptctl.experiments.replication.draws import Draws
from adaptctl.experiments.replication.paper_layout import index
from adaptctl.experiments.replication.printed import printed
from adaptctl.identifiability import (
    EssentialSpace,
    FundamentalBasis,
    Priority,
    essential_space,
    fundamental_basis,
)


@dataclass(frozen=True)
class Study:
    """The study behind a replication: its choices, and the arms, draws and torques that follow from them."""

    seed: int
    seeds: int
    samples: int
    velocity_scale: float
    frequency: float
    motion_samples: int
    unequal: float

    @cached_property
    def puma(self) -> SampledArm:
        """The PUMA 560 of Tables 1 and 6."""
        return puma560()

    @cached_property
    def arm3(self) -> Mechanism:
        """The mechanism of the PUMA's first three joints."""
        return load("puma560_arm3")

    @cached_property
    def arm3_space(self) -> EssentialSpace:
        """Essential space of the first three joints."""
        return essential_space(self.arm3)

    @cached_property
    def five_bar(self) -> SampledArm:
        """The semi-direct-drive arm with generic lengths."""
        return semi_direct_drive()

    @cached_property
    def nearly_parallel(self) -> SampledArm:
        """Semi-direct-drive arm with sides that are equal but for a small share."""
        return semi_direct_drive(near_parallelogram(self.unequal))

    @cached_property
    def puma_draws(self) -> Draws:
        """Draws of Table 2 and Figure 3."""
        return self._draws(self.puma)

    @cached_property
    def five_bar_draws(self) -> Draws:
        """The draws of Figure 3's other arm."""
        return self._draws(self.five_bar)

    @cached_property
    def nearly_parallel_draws(self) -> Draws:
        """Draws of the arm with nearly equal sides."""
        return self._draws(self.nearly_parallel)

    @cached_property
    def puma_motion(self) -> StatedMotion:
        """The stated sinusoid of the PUMA."""
        return self.puma.sinusoid(self.frequency, self.motion_samples)

    @cached_property
    def five_bar_motion(self) -> StatedMotion:
        """The stated sinusoid of the semi-direct-drive arm."""
        return self.five_bar.sinusoid(self.frequency, self.motion_samples)

    @cached_property
    def nearly_parallel_motion(self) -> StatedMotion:
        """The stated sinusoid of the arm with nearly equal sides."""
        return self.nearly_parallel.sinusoid(self.frequency, self.motion_samples)

    @cached_property
    def puma_torque_errors(self) -> Array:
        """Mean square torque errors (seeds, 37, 6) of the PUMA, (N m)^2."""
        return self.puma_draws.torque_errors(self.puma_motion)

    @cached_property
    def five_bar_torque_errors(self) -> Array:
        """Mean square torque errors (seeds, 27, 3) of the semi-direct-drive arm, (N m)^2."""
        return self.five_bar_draws.torque_errors(self.five_bar_motion)

    @cached_property
    def nearly_parallel_torque_errors(self) -> Array:
        """Mean square torque errors (seeds, 27, 3) of the arm with nearly equal sides, (N m)^2."""
        return self.nearly_parallel_draws.torque_errors(self.nearly_parallel_motion)

    @cached_property
    def puma_basis(self) -> FundamentalBasis:
        """The fundamental basis that Table 4's priorities yield with exact right angles."""
        return fundamental_basis(self.puma.space, self.priority("table4", self.puma.mechanism))

    @cached_property
    def five_bar_basis(self) -> FundamentalBasis:
        """The fundamental basis that Table 11's priorities yield."""
        return fundamental_basis(self.five_bar.space, self.priority("table11", self.five_bar.mechanism))

    def priority(self, table: str, mechanism: Mechanism) -> Priority:
        """Priorities of a table of the paper, for a mechanism."""
        entries = list(printed().tables[table].entries())
        order = sorted(entries, key=lambda entry: int(entry[2]))
        return Priority(tuple(mechanism.parameter_names[index(row, link)] for row, link, _ in order))

    @property
    def drawn(self) -> dict[str, Draws]:
        """The draws that were made, by arm."""
        labels = {
            "puma_draws": "puma560",
            "five_bar_draws": "semi_direct_drive",
            "nearly_parallel_draws": "nearly_parallelogram",
        }
        return {label: self.__dict__[key] for key, label in labels.items() if key in self.__dict__}

    @property
    def choices(self) -> tuple[str, ...]:
        """Texts of the choices behind the draws."""
        return (
            f"{self.seeds} draws of {self.samples} states, positions uniform within the table's ranges",
            f"velocities uniform up to {self.velocity_scale:.4g} times the table's bound, so that their root mean "
            "square is the bound"
            if abs(self.velocity_scale - 3**0.5) < 1e-3
            else f"velocities uniform up to {self.velocity_scale:.4g} times the table's bound",
        )

    @property
    def motion_choice(self) -> str:
        """Text of the stated sinusoid."""
        return (
            f"one sinusoid of {self.frequency:g} Hz in all joints, in phase, each through the whole of its range in "
            f"the table; errors are means over one period of {self.motion_samples} samples"
        )

    def _draws(self, arm: SampledArm) -> Draws:
        return Draws.of(arm, range(self.seed, self.seed + self.seeds), self.samples, self.velocity_scale)
