"""The paper's arms and what its tables need of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array, whole_count
from adaptctl.caching import cached_property
from adaptctl.description import Pose
from adaptctl.description.inertia import PARAMETERS
from adaptctl.dynamics import Mechanism, load
from adaptctl.experiments.replication.judging import BLANK, Entry, Number, Paper, Printed, RoundOff, percent
from adaptctl.identifiability import (
    EssentialSpace,
    FundamentalBasis,
    Priority,
    Reduction,
    essential_space,
    fundamental_basis,
    reduce,
)

FROM, TO, FASTEST = "position from [rad]", "position to [rad]", "velocity to [rad/s]"
ENERGY = "energy error [%]"
NAMES = {"I_x": "I_xx", "I_y": "I_yy", "I_z": "I_zz"}
"""The paper's names of moments of inertia."""
PRODUCTS = ("I_xy", "I_xz", "I_yz")
"""In the paper +integral xy dm, here the tensor's entries."""
THRESHOLD = float(np.sqrt(np.finfo(np.float64).eps))
"""The paper's bound of singular values over the largest."""
ROUND_OFF = 1e-15
"""(N m)^2 or percent, with every component"""
CLOSE_TORQUE_ERRORS = (0.05, 0.01, 0.001)
"""RMS torque errors, relative, that may be called very close; the first one judges."""


def index(row: str, link: str) -> int:
    """Index of an entry of the tables among a mechanism's parameters."""
    return 10 * (whole_count(int(link), "link", 1) - 1) + PARAMETERS.index(NAMES.get(row, row))


def sign(row: str) -> float:
    """Sign from the paper's convention: -1 for products of inertia."""
    return -1.0 if row in PRODUCTS else 1.0


def parameters(table: Printed, half_units: bool = False) -> Array:
    """Parameters (10 N,) of a table, in this package's order and signs."""
    out = np.zeros(10 * len(table.columns))
    for row, link, text in table.entries():
        if text != BLANK:
            printed = Number.of(text)
            out[index(row, link)] = 0.5 * printed.unit if half_units else sign(row) * printed.value
    return out


def paper_rank(singular_values: Array) -> Array:
    """Rank by the paper's rule (section 3.1)."""
    return np.count_nonzero(singular_values > THRESHOLD * singular_values[..., :1], axis=-1)


class StatedMotion(NamedTuple):
    """Sinusoidal motion with its torque regressors."""

    time: Array
    p: Array
    Y: Array


@dataclass(frozen=True, eq=False)
class Arm:
    """Arm of a study, computed on first use."""

    study: Study
    mechanism: Mechanism
    bounds: str = "table9"
    priority: str = "table11"

    @cached_property
    def space(self) -> EssentialSpace:
        """Essential space. Raises `RankError` where its rank cannot be certified."""
        return essential_space(self.mechanism)

    @property
    def parameters(self) -> Array:
        """Inertial parameters D (P,), SI units."""
        return self.mechanism.inertial_parameters

    @cached_property
    def box(self) -> Array:
        """Least and greatest u (rad), and fastest velocities (rad/s), from the table, (3, r)."""
        rows = self.study.paper.items[self.bounds].rows
        return np.array([[float(x) for x in rows[label].split() if x != BLANK] for label in (FROM, TO, FASTEST)])

    def positions(self, u: Array) -> Array:
        """Positions (..., r), rad, or their rates, of bounded coordinates `u` (..., r)."""
        return (
            u
            if self.mechanism.description.loops is None
            else np.stack([u[..., 0], u[..., 1], u[..., 1] - u[..., 2]], -1)
        )

    def states(self, generator: np.random.Generator, samples: int, velocity_scale: float) -> tuple[Array, Array]:
        """Random positions and velocities (samples, r)."""
        lower, upper, fastest = self.box
        u = generator.uniform(lower, upper, (samples, len(lower)))
        return self.positions(u), velocity_scale * generator.uniform(-fastest, fastest, u.shape)

    @cached_property
    def motion(self) -> StatedMotion:
        """One period of the study's sinusoid, all coordinates in phase."""
        rate, (lower, upper, _) = 2.0 * np.pi * self.study.frequency, self.box
        time = np.linspace(0.0, 1.0 / self.study.frequency, self.study.motion_samples)
        sine, cosine = np.sin(rate * time)[:, None], np.cos(rate * time)[:, None]
        half = 0.5 * (upper - lower)
        parts = (0.5 * (lower + upper) + half * sine, rate * half * cosine, -(rate**2) * half * sine)
        p, v, a = map(self.positions, parts)
        return StatedMotion(time, p, self.mechanism.torque_regressor(p, v, a))

    @cached_property
    def differences(self) -> Array:
        """Energy differences H (seeds, samples - 1, P), J per SI unit."""
        s = self.study
        generators = map(np.random.default_rng, range(s.seed, s.seed + s.seeds))
        p, v = map(np.stack, zip(*(self.states(one, s.samples, s.velocity_scale) for one in generators), strict=True))
        return np.diff(self.mechanism.energy_regressor(p, v), axis=1)

    @cached_property
    def singular_values(self) -> Array:
        """Singular values (seeds, P) of the energy differences."""
        return np.asarray(np.linalg.svd(self.differences, compute_uv=False))

    @cached_property
    def reductions(self) -> tuple[Reduction, ...]:
        """Reductions to essential components, one per seed; errors are on the same states, as in the paper."""
        _, values, right = np.linalg.svd(self.differences @ self.space.basis, full_matrices=False)
        energies = values[..., None] * (right @ self.space.basis.T)
        drawn = (replace(self.space, energies=partial(np.asarray, own), states="a draw") for own in energies)
        return tuple(reduce(one, self.parameters, components=self.space.rank) for one in drawn)

    @cached_property
    def percent_errors(self) -> Array:
        """Energy errors (seeds, k + 1) in % with the first 0 to k components (equation 23)."""
        return np.stack([reduction.percent_errors for reduction in self.reductions])

    @cached_property
    def weights(self) -> Array:
        """Sizes |beta_j| (seeds, k) of the components, J, descending (equation 19)."""
        return np.abs(np.stack([reduction.weights for reduction in self.reductions]))

    @cached_property
    def torque_errors(self) -> Array:
        """Mean square torque errors (seeds, k + 1, r), (N m)^2, with the first 0 to k components."""
        Y = self.motion.Y
        parts = np.stack([reduction.components for reduction in self.reductions])
        missing = np.cumsum(parts[:, ::-1], axis=1)[:, ::-1]
        # The mean of (Y d)^2 is d' (mean of Y' Y) d: one small matrix a joint instead of every torque of every seed.
        squares = np.einsum("tjp,tjq->jpq", Y, Y, optimize=True) / len(Y)
        errors = np.maximum(np.einsum("...p,jpq,...q->...j", missing, squares, missing, optimize=True), 0.0)
        left = parts.sum(axis=1) - self.parameters
        nothing_missing = np.mean(np.einsum("tjp,sp->stj", Y, left, optimize=True) ** 2, axis=1)
        return np.concatenate([errors, nothing_missing[:, None]], axis=1)

    @cached_property
    def basis(self) -> FundamentalBasis:
        """Fundamental basis in the printed order, with exact right angles."""
        return fundamental_basis(self.space, self.order)

    @property
    def order(self) -> Priority:
        """Order of removal, from the table."""
        entries = sorted(self.study.paper.items[self.priority].entries(), key=lambda entry: int(entry[2]))
        return Priority(tuple(self.mechanism.parameter_names[index(row, link)] for row, link, _ in entries))

    @property
    def places(self) -> Entry:
        """Place, from 1, in the default order of removal."""
        order = list(Priority.default(self.mechanism).indices(self.mechanism.parameter_names))
        return lambda row, link: float(order.index(index(row, link)) + 1)

    def limit(self, row: str, column: str) -> float:
        """Limit of the built-in arm, rad or rad/s, in Table 1 or 9."""
        end, loops = "upper" if " to " in row else "lower", self.mechanism.description.loops
        if column == "p2 - p3" and loops:
            return float(getattr(loops.conditions[0], end))
        own = self.mechanism.primary_joints[int(column) - 1].limits
        if row.startswith("velocity"):
            return own.velocity if end == "upper" else -own.velocity
        return float(getattr(own, end))

    def error(self, row: str, column: str) -> Array | RoundOff:
        """Errors of the draws in an entry of Table 3 or 10."""
        s = int(column)
        energy, joint = row == ENERGY, 0 if row == ENERGY else int(row.removeprefix("joint")) - 1
        own = self.percent_errors[:, s] if energy else self.torque_errors[:, s, joint]
        return RoundOff(float(np.median(own)), ROUND_OFF) if s == self.space.rank else own

    def fewest(self, enough: int) -> tuple[str, float]:
        """Median of the fewest components with small torque errors."""
        squares = np.mean((self.motion.Y @ self.parameters) ** 2, axis=0)
        needed = []
        for share in CLOSE_TORQUE_ERRORS:
            fine = (self.torque_errors <= share**2 * squares).all(axis=-1)
            needed.append(fine.shape[1] - np.logical_and.accumulate(fine[:, ::-1], axis=1).sum(axis=1))
        said = (
            f"{np.median(count):.0f} within {percent(share)}"
            for share, count in zip(CLOSE_TORQUE_ERRORS, needed, strict=True)
        )
        return ", ".join(said), float(np.mean(needed[0] >= enough))

    def rank_share(self, claim: str) -> float:
        """Share of the draws with the rank that its `claim` prints."""
        return float(np.mean(paper_rank(self.singular_values) == self.study.said(claim)))


@dataclass(frozen=True)
class Study:
    """Settings of a replication, and its arms."""

    paper: Paper
    seed: int
    seeds: int
    samples: int
    velocity_scale: float
    frequency: float
    motion_samples: int
    unequal: float

    @cached_property
    def puma(self) -> Arm:
        """PUMA 560 of the paper. Gives a `PhysicalConsistencyWarning`."""
        return Arm(self, load("puma560"), "table1", "table4")

    @cached_property
    def arm3(self) -> Arm:
        """First three joints of the PUMA 560, which the paper never samples."""
        return Arm(self, load("puma560_arm3"))

    @cached_property
    def five_bar(self) -> Arm:
        """Semi-direct-drive arm of four different lengths."""
        return Arm(self, load("semi_direct_drive"))

    @cached_property
    def nearly_parallel(self) -> Arm:
        """Semi-direct-drive arm, opposite sides equal but for `unequal`."""
        return Arm(self, near_parallelogram(self.unequal))

    @cached_property
    def parallelogram(self) -> Arm:
        """Semi-direct-drive arm whose opposite sides are equal."""
        return Arm(self, load("semi_direct_drive_parallelogram"))

    @property
    def drawn(self) -> Mapping[str, Arm]:
        """Arms whose draws were computed so far."""
        cases = {"puma560": "puma", "semi_direct_drive": "five_bar", "nearly_parallelogram": "nearly_parallel"}
        found = {label: self.__dict__[key] for label, key in cases.items() if key in self.__dict__}
        return {label: arm for label, arm in found.items() if "reductions" in arm.__dict__}

    def said(self, claim: str) -> int:
        """Number in a `claim` of the paper."""
        return int(self.paper.claims[claim].numbers)

    @property
    def numbers(self) -> dict[str, object]:
        """Settings by name."""
        is_rms = abs(self.velocity_scale - 3**0.5) < 1e-3
        return vars(self) | {
            "unequal": percent(self.unequal),
            "root_mean_square": ", so that their root mean square is the bound" if is_rms else "",
        }


def near_parallelogram(share: float) -> Mechanism:
    """Parallelogram arm with link 4 longer than link 2 by the fraction `share`."""
    description = load("semi_direct_drive_parallelogram").description
    links = list(description.links)
    near = links[4].parent_to_joint
    links[4] = replace(links[4], parent_to_joint=Pose(near.rotation, (1.0 + share) * near.translation))
    return Mechanism(replace(description, name=f"{description.name}, unequal", links=tuple(links)))
