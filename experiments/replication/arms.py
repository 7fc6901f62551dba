"""The paper's arms, random draws of their states, and the sinusoid that is stated in place of its unprinted one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from adaptctl.arrays import Array, stacked, stacked_rows, whole_count
from adaptctl.caching import cached_property
from adaptctl.description import Pose
from adaptctl.description.inertia import PARAMETERS
from adaptctl.dynamics import Mechanism, load
from adaptctl.experiments.replication.printed import BLANK, Number, Printed, PrintedTable
from adaptctl.identifiability import EssentialSpace, Reduction, essential_space, reduce
from adaptctl.scalars import column

GRID = 65
"""Closed configurations over the loop's whole range, from which any other is one short step away."""
FROM, TO, FASTEST = "position from [rad]", "position to [rad]", "velocity to [rad/s]"
NAMES = {"I_x": "I_xx", "I_y": "I_yy", "I_z": "I_zz"}
"""The paper's moments of inertia; its other names are ours."""
PRODUCTS = ("I_xy", "I_xz", "I_yz")
"""In the paper +integral xy dm, here the tensor's own entries."""
THRESHOLD = float(np.sqrt(np.finfo(np.float64).eps))
"""The paper's, of singular values as a share of the largest: the square root of the machine precision."""


def index(row: str, link: str) -> int:
    """Index, from 0, among all of a mechanism's parameters, ten a link, of the one in a `row` ("m", "mc_x", "I_x" or
    "I_xx", ...) and the column of a `link` ("1", "2", ...) of the paper's tables. Raises `ValueError` for a row that is
    no parameter, `InputError` for a link below 1."""
    return 10 * (whole_count(int(link), "link", 1) - 1) + PARAMETERS.index(NAMES.get(row, row))


def sign(row: str) -> float:
    """Sign that converts a parameter in a `row` of the paper's tables into this package's: -1 for products of
    inertia."""
    return -1.0 if row in PRODUCTS else 1.0


def parameters(table: PrintedTable, half_units: bool = False) -> Array:
    """Inertial parameters (10 N,) of N links in a printed `table`, in this package's order, signs and SI units, blanks
    as zeros; with `half_units`, half a unit of the last printed digit of each instead. Raises `InputError` for an entry
    that is no number."""
    out = np.zeros(10 * len(table.columns))
    for row, link, text in table.entries():
        if text != BLANK:
            printed = Number.of(text)
            out[index(row, link)] = 0.5 * printed.unit if half_units else sign(row) * printed.value
    return out


def kept(table: PrintedTable) -> tuple[int, ...]:
    """Indices, ascending, of the parameters for which a printed `table` has a cross or a number."""
    return tuple(sorted(index(row, link) for row, link, text in table.entries() if text != BLANK))


def paper_rank(singular_values: Array) -> Array:
    """Rank of each of several matrices (...) by the paper's rule (section 3.1): how many of its `singular_values`
    (..., P), in descending order, are above its threshold. Raises `IndexError` for a single number."""
    return np.count_nonzero(singular_values > THRESHOLD * singular_values[..., :1], axis=-1)


@dataclass(frozen=True, eq=False)
class StatedMotion:
    """Motion of an arm of r joints along a sinusoid: `time` (T,) in s, positions `p` (T, r) in rad, and torque
    regressors `Y` (T, r, P), N m per SI unit: Y D is the torque (T, r) of the parameters D (P,)."""

    time: Array
    p: Array
    Y: Array


@dataclass(frozen=True, eq=False)
class SampledArm:
    """Arm, a `mechanism`, with the box from which the paper samples its states: positions p = X u (rad) of r joints
    with X the matrix `mixing` (r, r) and u (r,) between `lower` and `upper`, and velocities (rad/s) between minus and
    plus `fastest` (r,) times a factor. For the semi-direct-drive arm u is p1, p2 and p2 - p3, which Table 9 bounds."""

    mechanism: Mechanism
    lower: Array
    upper: Array
    mixing: Array
    fastest: Array

    @cached_property
    def space(self) -> EssentialSpace:
        """Essential space of the arm. Raises `RankError` where its rank cannot be certified."""
        return essential_space(self.mechanism)

    @property
    def parameters(self) -> Array:
        """Inertial parameters D (P,) of the arm, SI units."""
        return self.mechanism.inertial_parameters

    def states(self, generator: np.random.Generator, samples: int, velocity_scale: float) -> tuple[Array, Array]:
        """Random positions (rad) and velocities (rad/s), (`samples`, r) each, drawn by `generator`; `velocity_scale`
        times the arm's bound is the largest velocity."""
        u = generator.uniform(self.lower, self.upper, (samples, len(self.lower)))
        v = velocity_scale * generator.uniform(-self.fastest, self.fastest, u.shape)
        return u @ self.mixing.T, v

    def sinusoid(self, frequency: float, samples: int) -> StatedMotion:
        """Motion over one period of a sinusoid of `frequency` (Hz) at `samples` even times, the last a period after the
        first: every bounded coordinate moves through its whole range, all in phase."""
        time = np.linspace(0.0, 1.0 / frequency, samples)
        rate = 2.0 * np.pi * frequency
        sine, cosine = np.sin(rate * time)[:, None], np.cos(rate * time)[:, None]
        center, half = 0.5 * (self.lower + self.upper), 0.5 * (self.upper - self.lower)
        parts = (center + half * sine, rate * half * cosine, -(rate**2) * half * sine)
        p, v, a = (part @ self.mixing.T for part in parts)
        rows = self.mechanism.equations.torque_regressor(
            column(self._configuration(p)), column(v), column(v), column(a), range(len(self.parameters))
        )
        return StatedMotion(time, p, stacked_rows(rows, time.shape))

    def energies(self, p: Array, v: Array) -> Array:
        """Energy regressors (..., P), J per SI unit, at positions `p` (rad) and velocities `v` (rad/s), (..., r)."""
        E = self.mechanism.equations.energy_regressor(column(self._configuration(p)), column(v))
        return stacked(E.of, p.shape[:-1])

    def _configuration(self, p: Array) -> Array:
        """U(p) (..., n), from the nearest of a grid of closed configurations: a short way, forty times as fast."""
        return self.mechanism.configuration(p, None if self.mechanism.continuation is None else self._near(p))

    def _near(self, p: Array) -> Array:
        """Closed configurations (..., n) near primary positions: p2 and p3 may turn together without opening a loop."""
        bends, closed = self._closed
        place = np.rint((p[..., 1] - p[..., 2] - bends[0]) / (bends[1] - bends[0])).astype(int)
        bend, near = bends[place], closed[place].copy()
        near[..., :3] = np.stack([p[..., 0], p[..., 1], p[..., 1] - bend], axis=-1)
        return near

    @cached_property
    def _closed(self) -> tuple[Array, Array]:
        """Values of p2 - p3 over its range (GRID,), and closed configurations (GRID, n) there."""
        bends = np.linspace(self.lower[2], self.upper[2], GRID)
        p = np.stack([np.zeros(GRID), np.full(GRID, -np.pi / 2), -np.pi / 2 - bends], axis=-1)
        return bends, self.mechanism.configuration(p)


def puma560(tables: Printed) -> SampledArm:
    """PUMA 560 with the parameters of Table 6 and the box of Table 1 in `tables`. Gives a
    `PhysicalConsistencyWarning`, since no rigid bodies have these parameters."""
    lower, upper, fastest = tables.tables["table1"].values(FROM, TO, FASTEST)
    return SampledArm(load("puma560"), lower, upper, np.eye(6), fastest)


def semi_direct_drive(tables: Printed, mechanism: Mechanism | None = None) -> SampledArm:
    """Semi-direct-drive arm with the box of Table 9 in `tables`: the built-in one, or a `mechanism` of its kind."""
    rows = {label: row.split() for label, row in tables.tables["table9"].rows.items()}
    lower, upper = (np.array([float(rows[label][column]) for column in (0, 1, 3)]) for label in (FROM, TO))
    mixing = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, -1.0]])
    fastest = np.array([float(text) for text in rows[FASTEST][:3]])
    return SampledArm(mechanism or load("semi_direct_drive"), lower, upper, mixing, fastest)


def near_parallelogram(share: float) -> Mechanism:
    """Parallelogram arm whose link 4 is longer than the opposite side, link 2, by the fraction `share`."""
    description = load("semi_direct_drive_parallelogram").description
    links = tuple(
        replace(link, near=Pose(link.near.rotation, (1.0 + share) * link.near.translation))
        if link.name == "link5"
        else link
        for link in description.links
    )
    return Mechanism(replace(description, name=f"{description.name}, unequal", links=links))


@dataclass(frozen=True, eq=False)
class Draws:
    """Random samples of an arm's states, one a seed: `singular_values` (seeds, P) of the energy differences H, J per SI
    unit, and `reductions`, one a seed, which write the `arm`'s parameters as a sum of essential components, along the
    right singular vectors of H, in descending order of energy (section 3 of the paper)."""

    arm: SampledArm
    singular_values: Array
    reductions: tuple[Reduction, ...]

    @classmethod
    def of(cls, arm: SampledArm, seeds: Sequence[int], samples: int, velocity_scale: float) -> Draws:
        """Draws of `samples` states of an `arm` for each of the `seeds`, velocities up to `velocity_scale` times the
        bound. Raises `RankError` where the arm's rank cannot be certified."""
        states = [arm.states(np.random.default_rng(seed), samples, velocity_scale) for seed in seeds]
        p, v = (np.stack(parts) for parts in zip(*states, strict=True))
        H = np.diff(arm.energies(p, v), axis=1)
        _, values, right = np.linalg.svd(H @ arm.space.basis, full_matrices=False)
        reductions = tuple(_reduction(arm, *factors) for factors in zip(values, right, strict=True))
        return cls(arm, np.asarray(np.linalg.svd(H, compute_uv=False)), reductions)

    @property
    def rank(self) -> int:
        """Rank k of the arm. Raises `RankError` where it cannot be certified."""
        return self.arm.space.rank

    @cached_property
    def percent_errors(self) -> Array:
        """Energy errors (seeds, k + 1) in % with the first 0 to k components (equation 23 of the paper)."""
        return np.stack([reduction.percent_errors for reduction in self.reductions])

    @cached_property
    def weights(self) -> Array:
        """Sizes |beta_j| (seeds, k) of the components, J, in descending order (equation 19 of the paper)."""
        return np.abs(np.stack([reduction.weights for reduction in self.reductions]))

    def torque_errors(self, motion: StatedMotion) -> Array:
        """Mean square torque errors (seeds, k + 1, r), (N m)^2, along a `motion` with the first 0 to k components."""
        Y = motion.Y
        parts = np.stack([reduction.components for reduction in self.reductions])
        missing = np.cumsum(parts[:, ::-1], axis=1)[:, ::-1]
        # The mean of (Y d)^2 is d' (mean of Y' Y) d: one small matrix a joint instead of every torque of every seed.
        squares = np.einsum("tjp,tjq->jpq", Y, Y, optimize=True) / len(Y)
        errors = np.maximum(np.einsum("...p,jpq,...q->...j", missing, squares, missing, optimize=True), 0.0)
        left = parts.sum(axis=1) - self.arm.parameters
        nothing_missing = np.mean(np.einsum("tjp,sp->stj", Y, left, optimize=True) ** 2, axis=1)
        return np.concatenate([errors, nothing_missing[:, None]], axis=1)

    def torque(self, motion: StatedMotion, seed: int, components: int) -> Array:
        """Torques (T, r), N m, along a `motion` from the first `components` components of the draw with index `seed`.
        Raises `InputError` for a number of components out of 0 to k, `IndexError` for no such draw."""
        return motion.Y @ self.reductions[seed].parameters(components)


def _reduction(arm: SampledArm, values: Array, right: Array) -> Reduction:
    """The reduction for one draw, whose factors among the essential parameters are given."""
    energies = values[:, None] * (right @ arm.space.basis.T)
    drawn = replace(arm.space, energies=lambda: energies, states="a draw of Sheu and Walker's kind")
    return reduce(drawn, arm.parameters, components=arm.space.rank)
