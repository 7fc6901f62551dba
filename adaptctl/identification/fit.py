"""One fit of parameters to rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description.drive import MAY_BE_NEGATIVE, DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import FundamentalBasis
from adaptctl.identification.consistent_estimate import consistent_estimates, optimality_residual
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.entropic import EntropicPrior
from adaptctl.identification.filtered_dynamics import Rows, SmoothMotion
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.lasting_noise import innovations
from adaptctl.identification.least_squares import each_weighted, weighted_least_squares
from adaptctl.identification.normal_equations import NormalEquations, blocks_of
from adaptctl.identification.preparation import PreparedLog

# Sums over blocks that are kept: those of five folds, their rests, and of all.
SUMS_KEPT = 12
# Factor of the prior's weight up to which a fit is near another one.
NEAR = 12.0
# Rough size of a rotor's inertia over the links' mean moment.
ROTOR_INERTIA_SHARE = 0.1
# Mean torque of the file's links over the log's from which on a joint is named, if it is above all of the log's too, as
# means of swings are by chance; and the share of the file's largest mean below which it is not.
MIN_MEAN_RATIO, MIN_MEAN_SHARE = 8.0, 0.25


@dataclass(frozen=True)
class FitSettings:
    """
    Friction model, prior's weight, cut-off (Hz), share of peak speed that masks slower joints, joints left out, names
    of parameters that the log does not tell, and times (r,) in s that the joints' noise lasts, if any does.
    """

    friction: FrictionModel
    weight: float
    cutoff: float
    slow: float = 0.0
    left_out: tuple[int, ...] = ()
    untold: tuple[str, ...] = ()
    lasting: tuple[float, ...] = ()

    def judging(self, cutoff: float) -> FitSettings:
        """Settings by which a fit is judged: all rows of a cut-off, as they are."""
        return replace(self, cutoff=cutoff, slow=0.0, lasting=())

    def columns(self, mechanism: Mechanism) -> Array:
        """Mask (P,) of the parameters: links', and those of the friction model in the drives of joints that count."""
        mask = self.friction.columns(mechanism)
        first = len(mask) - len(mechanism.description.drive_parameters)
        names = {mechanism.primary_joints[j].name for j in self.left_out}
        for k, name in enumerate(mechanism.parameter_names[first:]):
            if name.rsplit(".", 1)[0] in names or name in self.untold:
                mask[first + k] = 0.0
        return mask


@dataclass(frozen=True, eq=False)
class Fit:
    """Fit of parameters (P,) in SI units, with residual deviations (r,), normal matrix (P, P) and moment (P,)."""

    x: Array
    deviations: Array
    curvature: Array
    moment: Array
    prior: EntropicPrior
    settings: FitSettings

    @cached_property
    def residual(self) -> float:
        """Optimality residual of the parameters."""
        return optimality_residual(self.curvature, self.moment, self.prior, self.settings.weight, self.x)


class RowsPart(NamedTuple):
    """Rows with the motions that they are of, the blocks (n,) that they belong to, and the joints' peak speeds (r,)."""

    rows: Rows
    motions: Sequence[SmoothMotion]
    block: NDArray[np.int64]
    peaks: Array


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
    band: float

    @property
    def sampled(self) -> LogEvidence:
        """Evidence of the rows that it has alone."""
        return self

    def part(self, blocks: Sequence[int]) -> LogEvidence:
        """Evidence of some blocks of time alone, by rising indices."""
        here = {cutoff: np.isin(block, blocks) for cutoff, block in self._block.items()}
        rows = {cutoff: rows.chosen(here[cutoff]) for cutoff, rows in self.rows.items()}
        return replace(self, rows=rows, edges=[self.edges[b] for b in blocks])

    def advanced(self, delay: float) -> LogEvidence:
        """Evidence whose torques are those of a delay (s) later."""
        rows = {}
        for cutoff, own in self.rows.items():
            torque, change = own.torque.copy(), own.change.copy()
            for motion in self.motions:
                here = own.log == motion.number
                rise, change[here] = motion.later(cutoff, own.time[here], delay)
                torque[here] += rise
            rows[cutoff] = replace(own, torque=torque, change=change)
        return replace(self, rows=rows)

    def sums(self, cutoff: float, slow: float, lasting: tuple[float, ...] = ()) -> NormalEquations:
        """Normal equations of rows of a cut-off, by blocks, without joints slower than a share of their peaks."""
        key = cutoff, slow, lasting
        if key not in self._sums:
            used = self.used(cutoff, slow)
            rows = innovations(self.rows[cutoff], used, lasting)
            self._sums[key] = NormalEquations.of(rows, self._block[cutoff], self.blocks, used)
        return self._sums[key]

    @property
    def logs(self) -> Sequence[PreparedLog]:
        """Logs, or their pieces."""
        return [motion.log for motion in self.motions]

    def parts(self, cutoff: float) -> Iterator[RowsPart]:
        """Rows of a cut-off of all blocks, in parts."""
        yield RowsPart(self.rows[cutoff], self.motions, self._block[cutoff], self.peaks)

    def file_torques(self, cutoff: float) -> Array:
        """Mean torques (2, r) that the prior's links alone take in the rows of a cut-off, and that were measured."""
        rows, tens = self.rows[cutoff].moved, self.prior.tens.ravel()
        return np.stack([(rows.regressor[..., : tens.size] @ tens).mean(axis=0), rows.torque.mean(axis=0)])

    def weighing_otherwise(self, cutoff: float) -> tuple[int, ...]:
        """Joints whose links in the file take many times the mean torque that was measured."""
        told, measured = np.abs(self.file_torques(cutoff))
        whole = np.sqrt(np.mean(self.rows[cutoff].moved.torque ** 2, axis=0))
        most = np.max([np.full(len(told), MIN_MEAN_SHARE * told.max()), MIN_MEAN_RATIO * measured, whole], axis=0)
        return tuple(np.flatnonzero(told > most).tolist())

    def used(self, cutoff: float, slow: float) -> NDArray[np.bool_]:
        """Mask (n, r) of the joints' rows that fits are made from."""
        return self.rows[cutoff].used(slow * self.peaks)

    def counted(self, settings: FitSettings) -> NDArray[np.bool_]:
        """Mask (n, r) of the joints' rows that a fit with some settings is made from."""
        used = self.used(settings.cutoff, settings.slow).copy()
        used[:, list(settings.left_out)] = False
        return used

    @cached_property
    def _summed(self) -> dict[tuple[object, ...], NormalEquations]:
        return {}

    def fitted_rows(self, settings: FitSettings) -> Rows:
        """Rows that a fit with some settings is made from, where `counted` has them."""
        return innovations(self.rows[settings.cutoff], self.used(settings.cutoff, settings.slow), settings.lasting)

    @cached_property
    def peaks(self) -> Array:
        """Greatest speeds (r,) of the joints in rad/s (m/s)."""
        return np.max([np.abs(motion.velocity).max(axis=0) for motion in self.motions], axis=0)

    @cached_property
    def _sums(self) -> dict[tuple[float, float, tuple[float, ...]], NormalEquations]:
        return {}

    @cached_property
    def _block(self) -> dict[float, NDArray[np.int64]]:
        return {cutoff: blocks_of(rows, self.edges) for cutoff, rows in self.rows.items()}

    @property
    def blocks(self) -> int:
        """Number of blocks of time."""
        return len(self.edges)

    def equations(self, settings: FitSettings, blocks: Sequence[int]) -> NormalEquations:
        """Normal equations of the rows in some blocks, summed; the last ones are kept, as many settings share them."""
        key = settings.cutoff, settings.slow, settings.lasting, settings.left_out, tuple(blocks)
        if key not in self._summed:
            if len(self._summed) >= SUMS_KEPT:
                self._summed.clear()
            whole = self.sums(settings.cutoff, settings.slow, settings.lasting)
            self._summed[key] = whole.over(blocks).without(settings.left_out)
        return self._summed[key]

    def independent(self, settings: FitSettings) -> NDArray[np.int64]:
        """Indices (c,) of the parameters that least squares is solved for: fundamental ones, then friction's."""
        energetic, mask = self.mechanism.num_energy_parameters, settings.columns(self.mechanism)
        others = [c for c in np.flatnonzero(mask).tolist() if c >= energetic]
        return np.array([*(c for c in self.basis.columns if mask[c]), *others])

    def fit(self, settings: FitSettings, blocks: Sequence[int]) -> Fit:
        """Consistent fit to some blocks."""
        return self.fits(settings, [blocks])[0]

    def fits(self, settings: FitSettings, parts: Sequence[Sequence[int]]) -> list[Fit]:
        """Consistent fits to several parts, started where those with a prior of about the same weight ended."""
        keys = [tuple(blocks) for blocks in parts]
        if new := [key for key in keys if (settings, key) not in self._fits]:
            starts = [self._nearest(key, settings.weight) for key in new]
            each = self.fitted([self.equations(settings, key) for key in new], settings, starts)
            for key, found in zip(new, each, strict=True):
                self._ends[key, settings.weight] = found.x
                self._fits[settings, key] = found
        return [self._fits[settings, key] for key in keys]

    def _nearest(self, blocks: tuple[int, ...], weight: float) -> Array | None:
        """End (P,) of a fit near one on some blocks, if any is: on the same ones first, then of the nearest weight."""
        far = {end: (end[0] != blocks, abs(np.log(end[1] / weight))) for end in self._ends}
        near = [end for end, (_, ratio) in far.items() if ratio <= np.log(NEAR)]
        return self._ends[min(near, key=far.__getitem__)] if near else None

    @cached_property
    def _ends(self) -> dict[tuple[tuple[int, ...], float], Array]:
        """Ends (P,) of the last fits by their blocks and weights of the prior."""
        return {}

    @cached_property
    def _fits(self) -> dict[tuple[FitSettings, tuple[int, ...]], Fit]:
        return {}

    def fitted(
        self, each: Sequence[NormalEquations], settings: FitSettings, starts: Sequence[Array | None] = ()
    ) -> list[Fit]:
        """Consistent fits to normal equations, each joint weighted by its residual in least squares."""
        mask, prior, columns = settings.columns(self.mechanism), self.prior_of(settings), self.independent(settings)
        _, deviations = each_weighted(NormalEquations.stacked(each), columns)
        whitened = [own.whitened(spread) for own, spread in zip(each, deviations, strict=True)]
        A, b = (np.stack(part) for part in zip(*whitened, strict=True))
        A, b = A * np.outer(mask, mask), b * mask
        begun = [_started(start, prior, mask) for start in starts if start is not None]
        found = consistent_estimates(A, b, prior, settings.weight, np.stack(begun) if len(begun) == len(each) else None)
        return [Fit(*parts, prior, settings) for parts in zip(found, deviations, A, b, strict=True)]

    def prior_of(self, settings: FitSettings) -> EntropicPrior:
        """Prior of the parameters that settings have."""
        kept = settings.columns(self.mechanism)[self.prior.positive] > 0.0
        return EntropicPrior(self.prior.tens, self.prior.positive[kept], self.prior.scales[kept])

    def ordinary(self, settings: FitSettings, blocks: Sequence[int]) -> Array:
        """Parameters (P,) by weighted least squares without a prior: links need not be consistent."""
        return weighted_least_squares(self.equations(settings, blocks), self.independent(settings))[0]


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
