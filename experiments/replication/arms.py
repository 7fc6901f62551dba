"""The paper's two arms, where it samples them, and the sinusoid that is stated here in place of its unprinted one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from adaptctl.arrays import Array, stacked, stacked_rows
from adaptctl.caching import cached_property
from adaptctl.description import Pose
from adaptctl.dynamics import Mechanism, load
from adaptctl.experiments.replication.printed import printed
from adaptctl.identifiability import EssentialSpace, essential_space
from adaptctl.scalars import column

GRID = 65
"""Closed configurations over the loop's whole range, from which any other is one short step away."""
FROM, TO, FASTEST = "position from [rad]", "position to [rad]", "velocity to [rad/s]"


@dataclass(frozen=True, eq=False)
class StatedMotion:
    """Motion of an arm of r joints along a sinusoid, at T times: `time` (T,), s; positions `p` (T, r), rad; and torque
    regressors `Y` (T, r, P), N m per SI unit of each of the P inertial parameters D (P,): Y D is the torque (T, r).
    Nothing is checked at construction."""

    time: Array
    p: Array
    Y: Array


@dataclass(frozen=True, eq=False)
class SampledArm:
    """Arm, a `mechanism`, with a box from which its states are sampled, as in Sheu and Walker (1991): positions p = X
    u, rad, of r joints, with X the matrix `mixing` (r, r) and u (r,) between `lower` and `upper` (r,), rad; and
    velocities of the joints, rad/s, between minus and plus `fastest` (r,) times the factor that the method `states` is
    given.

    For the PUMA 560 `mixing` is the identity. For the semi-direct-drive arm u is p1, p2 and p2 - p3, which the paper's
    Table 9 bounds. Nothing is checked at construction.
    """

    mechanism: Mechanism
    lower: Array
    upper: Array
    mixing: Array
    fastest: Array

    @cached_property
    def space(self) -> EssentialSpace:
        """Essential space of the arm's P inertial parameters, an `EssentialSpace`: the k directions of parameters that
        change energies, found and certified at random states. Raises `RankError` where k cannot be certified."""
        return essential_space(self.mechanism)

    @property
    def parameters(self) -> Array:
        """The P inertial parameters D (P,) of the arm: of each link m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz,
        I_zz (kg, kg m, kg m^2), about its frame's origin."""
        return self.mechanism.inertial_parameters

    def states(self, generator: np.random.Generator, samples: int, velocity_scale: float) -> tuple[Array, Array]:
        """Random positions p, rad, and velocities, rad/s, of the arm's r joints, a pair of arrays (`samples`, r), drawn
        by `generator`. p is this object's `mixing` (r, r) times u (r,), u uniform between its `lower` and `upper`;
        velocities are uniform between minus and plus `velocity_scale` (no unit) times its `fastest`. Nothing is
        raised."""
        u = generator.uniform(self.lower, self.upper, (samples, len(self.lower)))
        v = velocity_scale * generator.uniform(-self.fastest, self.fastest, u.shape)
        return u @ self.mixing.T, v

    def sinusoid(self, frequency: float, samples: int) -> StatedMotion:
        """Motion of the arm, a `StatedMotion`, over one period of a sinusoid of `frequency` (Hz), at `samples` evenly
        spaced times, the last a period after the first: every coordinate bounded by this object's `lower` and `upper`
        moves through its whole range, all in phase. Nothing is checked."""
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
        """Energy regressors E (..., P) of the arm, J per SI unit of each of its P inertial parameters, at positions `p`
        (rad) and velocities `v` (rad/s), both (..., r): for parameters D (P,), E D is the kinetic plus potential
        energy, J. Nothing is checked."""
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


def puma560() -> SampledArm:
    """PUMA 560 arm of Sheu and Walker (1991), a `SampledArm`: the mechanism "puma560", six joints with the inertial
    parameters of their Table 6, and the box of positions, rad, and velocities, rad/s, of their Table 1. Gives a
    `PhysicalConsistencyWarning`, since no rigid bodies have these parameters."""
    table = printed().tables["table1"]
    lower, upper, fastest = table.values(FROM, TO, FASTEST)
    return SampledArm(load("puma560"), lower, upper, np.eye(6), fastest)


def semi_direct_drive(mechanism: Mechanism | None = None) -> SampledArm:
    """Semi-direct-drive arm (five-bar linkage on a vertical axis), a `SampledArm`, with the box of positions, rad, and
    velocities, rad/s, of Table 9 of Sheu and Walker (1991). `mechanism` is another arm of its kind with the same three
    joints, which is not checked; None, the default, stands for the built-in "semi_direct_drive"."""
    rows = {label: row.split() for label, row in printed().tables["table9"].rows.items()}
    lower, upper = ([float(rows[label][column]) for column in (0, 1, 3)] for label in (FROM, TO))
    mixing = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, -1.0]])
    fastest = np.array([float(text) for text in rows[FASTEST][:3]])
    return SampledArm(mechanism or load("semi_direct_drive"), np.array(lower), np.array(upper), mixing, fastest)


def near_parallelogram(share: float) -> Mechanism:
    """Mechanism of the built-in semi-direct-drive parallelogram with one side lengthened: link 4 is longer than the
    opposite side, link 2, by the fraction `share` (no unit, 0.005 for 0.5 %). Nothing is checked."""
    description = load("semi_direct_drive_parallelogram").description
    links = tuple(
        replace(link, near=Pose(link.near.rotation, (1.0 + share) * link.near.translation))
        if link.name == "link5"
        else link
        for link in description.links
    )
    return Mechanism(replace(description, name=f"{description.name}, unequal", links=links))
