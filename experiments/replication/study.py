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
    """Study that a replication of Sheu and Walker (1991) is made of: its settings, with the arms, random draws of
    states and torques that follow from them, computed when first asked for.

    There are `seeds` random draws of `samples` states each, with the seeds `seed`, `seed` + 1, ...; `velocity_scale`
    (no unit) times the paper's bound is the largest velocity; `frequency` (Hz) and `motion_samples` are those of the
    sinusoid for torques; `unequal` (no unit) is the fraction by which one side of a linkage that is nearly a
    parallelogram is longer than the opposite one. Nothing is checked at construction.
    """

    seed: int
    seeds: int
    samples: int
    velocity_scale: float
    frequency: float
    motion_samples: int
    unequal: float

    @cached_property
    def puma(self) -> SampledArm:
        """PUMA 560 arm, a `SampledArm`, with the inertial parameters of Table 6 of Sheu and Walker (1991) and the
        ranges of states of their Table 1."""
        return puma560()

    @cached_property
    def arm3(self) -> Mechanism:
        """The `Mechanism` of the first three joints of the PUMA 560."""
        return load("puma560_arm3")

    @cached_property
    def arm3_space(self) -> EssentialSpace:
        """Essential space, an `EssentialSpace`, of the inertial parameters of the PUMA 560's first three joints: their
        directions that change energies. Raises `RankError` where the number of identifiable parameters cannot be
        certified."""
        return essential_space(self.arm3)

    @cached_property
    def five_bar(self) -> SampledArm:
        """Semi-direct-drive arm, a `SampledArm`: a five-bar linkage of four different lengths with the ranges of states
        of Table 9 of Sheu and Walker (1991)."""
        return semi_direct_drive()

    @cached_property
    def nearly_parallel(self) -> SampledArm:
        """Semi-direct-drive arm, a `SampledArm`: a five-bar linkage whose opposite sides are equal, except that one is
        longer by the fraction `unequal` of this study, with the ranges of states of Table 9 of Sheu and Walker
        (1991)."""
        return semi_direct_drive(near_parallelogram(self.unequal))

    @cached_property
    def puma_draws(self) -> Draws:
        """Random draws, a `Draws`, of the PUMA 560's states, for Tables 2 and 3 and Figures 3 and 4 of Sheu and Walker
        (1991). Raises `RankError` where the arm's number of identifiable parameters cannot be certified."""
        return self._draws(self.puma)

    @cached_property
    def five_bar_draws(self) -> Draws:
        """Random draws, a `Draws`, of states of the semi-direct-drive arm with four different lengths, for Figure 3 and
        Table 10 of Sheu and Walker (1991). Raises `RankError` where the arm's number of identifiable parameters cannot
        be certified."""
        return self._draws(self.five_bar)

    @cached_property
    def nearly_parallel_draws(self) -> Draws:
        """Random draws, a `Draws`, of states of the semi-direct-drive arm with nearly equal opposite sides, for Figures
        3 and 6 and Table 10 of Sheu and Walker (1991). Raises `RankError` where the arm's number of identifiable
        parameters cannot be certified."""
        return self._draws(self.nearly_parallel)

    @cached_property
    def puma_motion(self) -> StatedMotion:
        """Motion of the PUMA 560, a `StatedMotion`, over one period of a sinusoid of this study's `frequency` (Hz) in
        all joints, each through the whole of its range in Table 1 of Sheu and Walker (1991), at `motion_samples`
        times."""
        return self.puma.sinusoid(self.frequency, self.motion_samples)

    @cached_property
    def five_bar_motion(self) -> StatedMotion:
        """Motion, a `StatedMotion`, of the semi-direct-drive arm with four different lengths over one period of a
        sinusoid of this study's `frequency` (Hz) in all joints, through the whole of the ranges in Table 9 of Sheu and
        Walker (1991), at `motion_samples` times."""
        return self.five_bar.sinusoid(self.frequency, self.motion_samples)

    @cached_property
    def nearly_parallel_motion(self) -> StatedMotion:
        """Motion, a `StatedMotion`, of the semi-direct-drive arm with nearly equal opposite sides over one period of a
        sinusoid of this study's `frequency` (Hz) in all joints, through the whole of the ranges in Table 9 of Sheu and
        Walker (1991), at `motion_samples` times."""
        return self.nearly_parallel.sinusoid(self.frequency, self.motion_samples)

    @cached_property
    def puma_torque_errors(self) -> Array:
        """Mean square torque errors (seeds, 37, 6), (N m)^2, of the PUMA 560 over one period of this study's sinusoid:
        by random draw of states (seed), by number kept of essential components (the parameters' parts along the right
        singular vectors of energy differences), 0 to 36, and by joint. Raises `RankError` where the arm's number of
        identifiable parameters cannot be certified."""
        return self.puma_draws.torque_errors(self.puma_motion)

    @cached_property
    def five_bar_torque_errors(self) -> Array:
        """Mean square torque errors (seeds, 27, 3), (N m)^2, of the semi-direct-drive arm with four different lengths
        over one period of this study's sinusoid: by random draw of states (seed), by number kept of essential
        components (the parameters' parts along the right singular vectors of energy differences), 0 to 26, and by
        joint. Raises `RankError` where the arm's number of identifiable parameters cannot be certified."""
        return self.five_bar_draws.torque_errors(self.five_bar_motion)

    @cached_property
    def nearly_parallel_torque_errors(self) -> Array:
        """Mean square torque errors (seeds, 27, 3), (N m)^2, of the semi-direct-drive arm with nearly equal opposite
        sides over one period of this study's sinusoid: by random draw of states (seed), by number kept of essential
        components (the parameters' parts along the right singular vectors of energy differences), 0 to 26, and by
        joint. Raises `RankError` where the arm's number of identifiable parameters cannot be certified."""
        return self.nearly_parallel_draws.torque_errors(self.nearly_parallel_motion)

    @cached_property
    def puma_basis(self) -> FundamentalBasis:
        """Fundamental basis of the PUMA 560, a `FundamentalBasis`: the independent (base) parameters that are kept when
        others are removed in the order of Table 4 of Sheu and Walker (1991), with exact right angles. Raises
        `RankError` where their number cannot be certified."""
        return fundamental_basis(self.puma.space, self.priority("table4", self.puma.mechanism))

    @cached_property
    def five_bar_basis(self) -> FundamentalBasis:
        """Fundamental basis of the semi-direct-drive arm with four different lengths, a `FundamentalBasis`: the
        independent (base) parameters that are kept when others are removed in the order of Table 11 of Sheu and Walker
        (1991). Raises `RankError` where their number cannot be certified."""
        return fundamental_basis(self.five_bar.space, self.priority("table11", self.five_bar.mechanism))

    def priority(self, table: str, mechanism: Mechanism) -> Priority:
        """Order in which parameters of a `mechanism` are removed, a `Priority`, from a `table` of Sheu and Walker
        (1991), "table4" or "table11", whose entries number the parameters in that order. Raises `KeyError` for an
        unknown table, `ValueError` for one with other entries, `IndexError` for a mechanism of fewer links than the
        table has."""
        entries = list(printed().tables[table].entries())
        order = sorted(entries, key=lambda entry: int(entry[2]))
        return Priority(tuple(mechanism.parameter_names[index(row, link)] for row, link, _ in order))

    @property
    def drawn(self) -> dict[str, Draws]:
        """Random draws of states, a `Draws` each, that this study has computed so far, a mapping from the arm's name:
        "puma560", "semi_direct_drive" and "nearly_parallelogram"; those not yet computed are left out."""
        labels = {
            "puma_draws": "puma560",
            "five_bar_draws": "semi_direct_drive",
            "nearly_parallel_draws": "nearly_parallelogram",
        }
        return {label: self.__dict__[key] for key, label in labels.items() if key in self.__dict__}

    @property
    def choices(self) -> tuple[str, ...]:
        """Two texts on the settings of this study's random draws of states: first the number of draws, of states in
        each, and the range of positions; then the range of velocities."""
        return (
            f"{self.seeds} draws of {self.samples} states, positions uniform within the table's ranges",
            f"velocities uniform up to {self.velocity_scale:.4g} times the table's bound, so that their root mean "
            "square is the bound"
            if abs(self.velocity_scale - 3**0.5) < 1e-3
            else f"velocities uniform up to {self.velocity_scale:.4g} times the table's bound",
        )

    @property
    def motion_choice(self) -> str:
        """Text on the sinusoid along which this study computes torques: frequency, range and samples."""
        return (
            f"one sinusoid of {self.frequency:g} Hz in all joints, in phase, each through the whole of its range in "
            f"the table; errors are means over one period of {self.motion_samples} samples"
        )

    def _draws(self, arm: SampledArm) -> Draws:
        return Draws.of(arm, range(self.seed, self.seed + self.seeds), self.samples, self.velocity_scale)
