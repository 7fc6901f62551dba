"""One fit of parameters to rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description.drive import MAY_BE_NEGATIVE, DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import FundamentalBasis
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.entropic import EntropicPrior, consistent_estimate
from adaptctl.identification.filtered_dynamics import Rows, SmoothMotion
from adaptctl.identification.friction_model import FrictionModel, load_columns
from adaptctl.identification.least_squares import weighted_least_squares
from adaptctl.identification.normal_equations import NormalEquations, blocks_of

# Rough sizes of a rotor's inertia over the links' mean moment, and of load-dependent friction's share.
ROTOR_INERTIA_SHARE, LOAD_FRICTION_SIZE = 0.1, 0.1


@dataclass(frozen=True)
class FitSettings:
    """Friction model, weight of the prior against the logs, and cut-off (Hz) of a fit."""

    friction: FrictionModel
    weight: float
    cutoff: float


@dataclass(frozen=True, eq=False)
class Fit:
    """Fit of parameters (P + r,) in SI units, the last r of load-dependent friction, with residual deviations (r,)."""

    x: Array
    deviations: Array
    curvature: Array
    settings: FitSettings


@dataclass(frozen=True, eq=False)
class LogEvidence:
    """Evidence that fits are made from: filtered equations of motion by cut-off (Hz), in blocks of time."""

    mechanism: Mechanism
    basis: FundamentalBasis
    drives: Drives
    prior: EntropicPrior
    motions: Sequence[SmoothMotion]
    rows: dict[float, Rows]
    edges: Sequence[tuple[int, float]]
    kept: dict[float, NDArray[np.bool_]] | None = None

    def part(self, blocks: Sequence[int]) -> LogEvidence:
        """Evidence of some blocks of time alone, by rising indices."""
        here = {cutoff: np.isin(block, blocks) for cutoff, block in self._block.items()}
        rows = {cutoff: rows.chosen(here[cutoff]) for cutoff, rows in self.rows.items()}
        kept = {cutoff: self._among_the_motions(cutoff, own) for cutoff, own in here.items()}
        return replace(self, rows=rows, edges=[self.edges[b] for b in blocks], kept=kept)

    def _among_the_motions(self, cutoff: float, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Mask of the motions' rows at a cut-off, of a mask of those that belong to the evidence."""
        if self.kept is None:
            return chosen
        mask = self.kept[cutoff].copy()
        mask[mask] = chosen
        return mask

    @cached_property
    def _plain(self) -> dict[float, NormalEquations]:
        return {cutoff: NormalEquations.of(rows, self._block[cutoff]) for cutoff, rows in self.rows.items()}

    @cached_property
    def _block(self) -> dict[float, NDArray[np.int64]]:
        return {cutoff: blocks_of(rows, self.edges) for cutoff, rows in self.rows.items()}

    @property
    def blocks(self) -> int:
        """Number of blocks of time."""
        return len(self.edges)

    def load(self, cutoff: float, x: Array) -> Array:
        """Columns (n, r, r) of load-dependent friction, whose rigid torques are those of parameters `x`."""
        columns = load_columns(self.motions, self.mechanism, x, cutoff, self.drives)
        return columns if self.kept is None else columns[self.kept[cutoff]]

    def equations(self, cutoff: float, blocks: Sequence[int], load: Array | None = None) -> NormalEquations:
        """Normal equations on P + r parameters of the rows in some blocks, summed."""
        plain = self._plain[cutoff].over(blocks)
        if load is None:
            return plain.with_blank_columns(self.mechanism.dof)
        here = np.isin(self._block[cutoff], blocks)
        return plain.with_columns(self.rows[cutoff].chosen(here), load[here])

    def mask(self, friction: FrictionModel) -> Array:
        """Mask (P + r,) of the parameters that a friction model has."""
        return np.concatenate([friction.columns(self.mechanism), np.full(self.mechanism.dof, float(friction.load))])

    def independent(self, friction: FrictionModel) -> NDArray[np.int64]:
        """Indices (c,) of the parameters that least squares is solved for: fundamental ones, then friction's."""
        energetic = self.mechanism.num_energy_parameters
        others = [c for c in np.flatnonzero(self.mask(friction)).tolist() if c >= energetic]
        return np.array([*self.basis.columns, *others])

    def fit(self, settings: FitSettings, blocks: Sequence[int]) -> Fit:
        """Consistent fit to some blocks, started where the last one on the same blocks ended."""
        load, key = self.load_from(settings, blocks), tuple(blocks)
        found = self.fitted(self.equations(settings.cutoff, blocks, load), settings, self._ends.get(key))
        self._ends[key] = found.x
        return found

    @cached_property
    def _ends(self) -> dict[tuple[int, ...], Array]:
        return {}

    def load_from(self, settings: FitSettings, blocks: Sequence[int], cutoff: float | None = None) -> Array | None:
        """Columns (n, r, r) of load-dependent friction, rigid torques by a fit without it."""
        if not settings.friction.load:
            return None
        at = settings.cutoff if cutoff is None else cutoff
        key = (settings.friction.kinds, tuple(blocks), at)
        if key not in self._loads:
            self._loads[key] = self.load(at, self._rigid(settings, tuple(blocks)))
        return self._loads[key]

    def _rigid(self, settings: FitSettings, blocks: tuple[int, ...]) -> Array:
        """Parameters found without load-dependent friction, whose rigid torques it grows with."""
        key = (settings.friction.kinds, blocks)
        if key not in self._plain_fits:
            plain = replace(settings, friction=replace(settings.friction, load=False))
            self._plain_fits[key] = self.fit(plain, blocks).x
        return self._plain_fits[key]

    @cached_property
    def _loads(self) -> dict[object, Array]:
        return {}

    @cached_property
    def _plain_fits(self) -> dict[object, Array]:
        return {}

    def fitted(self, equations: NormalEquations, settings: FitSettings, start: Array | None = None) -> Fit:
        """Consistent fit to normal equations, each joint weighted by its residual in least squares."""
        mask = self.mask(settings.friction)
        _, deviations = weighted_least_squares(equations, self.independent(settings.friction))
        A, b = equations.whitened(deviations)
        A, b = A * np.outer(mask, mask), b * mask
        prior = self.prior_of(settings.friction)
        x = consistent_estimate(A, b, prior, settings.weight, None if start is None else _started(start, prior, mask))
        return Fit(x, deviations, A, settings)

    def prior_of(self, friction: FrictionModel) -> EntropicPrior:
        """Prior of the parameters that a friction model has."""
        r, P = self.mechanism.dof, len(self.mechanism.parameter_names)
        kept = self.mask(friction)[self.prior.positive] > 0.0
        loads = np.arange(P, P + r) if friction.load else np.arange(0)
        positive = np.concatenate([self.prior.positive[kept], loads])
        scales = np.concatenate([self.prior.scales[kept], np.full(len(loads), LOAD_FRICTION_SIZE)])
        return EntropicPrior(self.prior.tens, positive, scales)

    def ordinary(self, friction: FrictionModel, cutoff: float, blocks: Sequence[int]) -> Array:
        """Parameters (P + r,) by weighted least squares without a prior: links need not be consistent."""
        return weighted_least_squares(self.equations(cutoff, blocks), self.independent(friction))[0]


def _started(start: Array, prior: EntropicPrior, mask: Array) -> Array:
    x = start * mask
    x[prior.positive] = np.where(x[prior.positive] > 0.0, x[prior.positive], prior.scales)
    return x


def positive_columns(mechanism: Mechanism, tens: Array) -> tuple[NDArray[np.int64], Array]:
    """Indices (c,) and rough sizes (c,) of the drives' parameters that must be positive."""
    first = 10 * len(mechanism.description.bodies)
    drives = mechanism.description.drive_parameters
    own = [first + k for k, (_, kind) in enumerate(drives) if kind not in MAY_BE_NEGATIVE]
    inertia = float(np.mean(np.trace(tens[:, [[4, 5, 7], [5, 6, 8], [7, 8, 9]]], axis1=1, axis2=2))) / 3.0
    rotor = {first + k for k, (_, kind) in enumerate(drives) if kind is DriveParameter.ROTOR_INERTIA}
    return np.array(own), np.array([max(ROTOR_INERTIA_SHARE * inertia, 1e-6) if c in rotor else 1.0 for c in own])
