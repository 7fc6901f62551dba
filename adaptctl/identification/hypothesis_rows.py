"""Equations of motion on which hypotheses about what a log's columns mean are compared."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.description.drive import DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.array_equations import OnArrays
from adaptctl.identification.consistent_estimate import consistent_estimates
from adaptctl.identification.filtered_dynamics import MIN_ROWS, ROWS_PER_PERIOD, RowFilter, Rows, SmoothMotion
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.friction_model import SIMPLE_FRICTION
from adaptctl.identification.least_squares import each_weighted, explained_squares, weighted_least_squares
from adaptctl.identification.momentum_balance import PackedRegressor
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.payloads import without_payloads
from adaptctl.identification.preparation import PreparationStep, derivative, filtered
from adaptctl.logs.units import TORQUE

# Rows are w*tau = (w*Y) D with the kernel w of the other fits, but with accelerations from differences of the smoothed
# positions, so that one regressor for each sample serves; the differences are as smooth as the filter w makes them.

# Instants in a period of the cut-off, instants in all, and windows of a log that are spread over it if it has more.
DENSITY, MAX_INSTANTS, WINDOWS = 8.0, 2500, 10
# Motions that are tried for each joint, about.
MOTIONS = 12
# Weight of the prior, share of peak speed below which a joint's rows do not count, and relative error of a joint below
# which fits count as equal.
PRIOR_WEIGHT, SLOW, LEAST_ERROR = 0.1, 0.05, 0.003
# Share of torques that the file's links explain and ratio of torques to theirs, beyond which a common one is a gear's;
# a larger one only if gears are stated, as many files' links are placeholders of little mass. Not asked: joints below
# a share of the links' largest torque: rotors and friction outweigh links there, as at wrists.
EXPLAINED, OTHER_SIDE, ALIKE, LARGE = 0.4, 10.0, 3.0, 0.1


class MotionProducts(NamedTuple):
    """Products of each joint's rows (r, P, P), and of these and all torques (r, r, P)."""

    normal: Array
    moments: Array


@dataclass(frozen=True, eq=False)
class HypothesisRows:
    """Instants of logs (M, r), with the filters that make rows of them, and the rows' torques (n, r)."""

    evidence: LogEvidence
    windows: Sequence[SmoothMotion]
    position: Array
    velocity: Array
    acceleration: Array
    springs: tuple[DriveParameter, ...] = ()

    @classmethod
    def of(
        cls,
        evidence: LogEvidence,
        others: Sequence[SmoothMotion] = (),
        springs: tuple[DriveParameter, ...] = (),
    ) -> HypothesisRows:
        """Instants of evidence and of other motions, about a dozen in a period of the lowest cut-off."""
        thin = [_thinned(motion, evidence.band) for motion in (*evidence.motions, *others)]
        thin = [(m, a) for m, a in thin if len(m.position) >= RowFilter.of(m, evidence.band).taps] or thin[:1]
        most = MAX_INSTANTS // len(thin)
        parts = [window for motion, acceleration in thin for window in _windows(motion, acceleration, most)]
        windows = [replace(motion, number=k) for k, (motion, _) in enumerate(parts)]
        p, v = (np.concatenate([getattr(motion, what) for motion in windows]) for what in ("position", "velocity"))
        return cls(evidence, windows, p, v, np.concatenate([acceleration for _, acceleration in parts]), springs)

    @cached_property
    def settings(self) -> FitSettings:
        """Settings of all fits to these rows."""
        return FitSettings(SIMPLE_FRICTION.also(self.springs), PRIOR_WEIGHT, self.evidence.band, SLOW)

    @cached_property
    def rows(self) -> Rows:
        """Rows of the log as it is, without known payloads."""
        mechanism = self.evidence.mechanism
        Y = mechanism.torque_regressor(self.position, self.velocity, self.acceleration)
        rows = Rows.joined([f.rows(motion, f.signal(part)) for motion, f, part in self._parts(Y)])
        return without_payloads(rows, self.windows, mechanism, self.evidence.drives)

    @cached_property
    def packed(self) -> PackedRegressor:
        """Regressor of the log as it is."""
        return PackedRegressor.of(self.rows.regressor)

    @cached_property
    def used(self) -> NDArray[np.bool_]:
        """Mask (n, r) of the joints' rows that count."""
        fast = np.abs(self.rows.velocity) >= SLOW * np.abs(self.velocity).max(axis=0)
        return np.asarray(self.rows.moving[:, None] & fast)

    @cached_property
    def sources(self) -> list[str]:
        """Names of the logs, in their order."""
        return list(dict.fromkeys(motion.log.source for motion in self.windows))

    def of_source(self, source: str) -> NDArray[np.bool_]:
        """Mask (n,) of the rows of a log."""
        numbers = [motion.number for motion in self.windows if motion.log.source == source]
        return np.isin(self.rows.log, numbers)

    def filtered(self, values: Array) -> Array:
        """Values (M, ...) at all instants through the filter: (n, ...) at rows."""
        return np.concatenate([f.signal(part) for _, f, part in self._parts(values)])

    def regressor(self, mechanism: Mechanism, position: Array, velocity: Array, acceleration: Array) -> PackedRegressor:
        """Regressor (n, r, P) of another motion of the joints, or of another mechanism."""
        own = mechanism is self.evidence.mechanism
        evaluated = self._equation.call if own else mechanism.torque_regressor
        packed = PackedRegressor.of(evaluated(position, velocity, acceleration))
        return packed._replace(values=self.filtered(packed.values))

    @cached_property
    def _equation(self) -> OnArrays:
        """Regressor of the mechanism, which is asked for so often that it is compiled at once."""
        mechanism = self.evidence.mechanism
        found = mechanism.column_regressor("torque_regressor", range(len(mechanism.parameter_names)))
        found.is_native(MOTIONS * mechanism.dof * len(self.position))
        return found

    def _parts(self, values: Array) -> Iterator[tuple[SmoothMotion, RowFilter, Array]]:
        ends = np.cumsum([0, *(len(motion.position) for motion in self.windows)]).tolist()
        each = zip(self.windows, self._filters, pairwise(ends), strict=True)
        return ((motion, own, values[a:b]) for motion, own, (a, b) in each)

    @cached_property
    def _filters(self) -> list[RowFilter]:
        """Filter of each window."""
        band, most = self.evidence.band, len(self.position) // MIN_ROWS
        strides = (min(int(motion.rate / (ROWS_PER_PERIOD * band)), most) for motion in self.windows)
        pairs = zip(self.windows, strides, strict=True)
        return [replace(RowFilter.of(motion, band), every=max(1, stride)) for motion, stride in pairs]

    def mixed(self, mixing: Array, products: MotionProducts | None = None) -> NormalEquations:
        """Equations of a motion, by default as it is, and of matrices (..., r, r) times the torques, a block each."""
        normal, moments = products or self._products
        each, counts = mixing.reshape(-1, *mixing.shape[-2:]), self.used.sum(axis=0, dtype=np.float64)
        moment = np.einsum("bik,ikp->bip", each, moments)
        square = np.einsum("bij,bik,ijk->bi", each, each, self._squares)
        return NormalEquations(normal[None], moment, square, counts[None])

    def products(self, regressor: PackedRegressor) -> MotionProducts:
        """Products of a motion's rows."""
        joints, parameters = regressor.shape
        found = MotionProducts(np.zeros((joints, parameters, parameters)), np.zeros((joints, joints, parameters)))
        for j in range(joints):
            columns, values = regressor.joint(j)
            own = values * self.used[:, j, None]
            found.normal[j][np.ix_(columns, columns)] = own.T @ own
            found.moments[j][:, columns] = self.rows.torque.T @ own
        return found

    @cached_property
    def _products(self) -> MotionProducts:
        return self.products(self.packed)

    @cached_property
    def _squares(self) -> Array:
        """Products (r, r, r) of all torques, in each joint's rows."""
        return np.asarray(np.einsum("nj,nk,ni->ijk", self.rows.torque, self.rows.torque, self.used.astype(np.float64)))

    def sums(self, regressor: PackedRegressor, torque: Array) -> NormalEquations:
        """Normal equations of a regressor and torques."""
        found = NormalEquations.zero(1, *regressor.shape)
        found.add(regressor, torque, np.zeros(len(torque), dtype=np.int64), self.used)
        return found

    def later(self, delay: float) -> NormalEquations:
        """Normal equations of the motion as it is and the torques of a delay (s) later."""
        rows = self.rows
        torque = rows.torque.copy()
        for motion in self.windows:
            here = rows.log == motion.number
            torque[here] += motion.later(rows.cutoff, rows.time[here], delay)[0]
        return self.sums(self.packed, torque)

    def least(self, equations: NormalEquations) -> tuple[Array, Array]:
        """Parameters (P,) and deviations (r,) by least squares; further columns than the mechanism's are free."""
        more = np.arange(len(self.evidence.mechanism.parameter_names), equations.moment.shape[-1])
        return weighted_least_squares(equations, np.concatenate([self._independent, more]))

    def explained(self, columns: NDArray[np.int64], added: Array, deviations: Array) -> Array:
        """Squares (k,) explained by least squares with the joints' deviations (r,) if moments (k, c) are added."""
        A, b = self.mixed(np.eye(len(deviations))).whitened(deviations)
        moments = np.tile(b, (len(added), 1))
        moments[:, columns] += added
        own = self._independent
        return np.asarray(explained_squares(A[np.ix_(own, own)], moments[:, own]))

    def least_errors(self, mixings: Array) -> Array:
        """Relative errors (B,) of least squares on the motion as it is and on torques of matrices (B, r, r)."""
        equations = self.mixed(mixings)
        _, deviations = each_weighted(equations, self._independent)
        return _mean_errors(deviations**2 * equations.count, equations.square)

    @cached_property
    def _independent(self) -> NDArray[np.int64]:
        return self.evidence.independent(self.settings)

    def consistent(self, fits: Sequence[tuple[NormalEquations, Array]], start: Array | None = None) -> list[Array]:
        """Consistent parameters (P,) of equations with the joints' deviations (r,), searched together from a start."""
        sizes = [equations.moment.shape[-1] for equations, _ in fits]
        A, b = np.zeros((len(fits), max(sizes), max(sizes))), np.zeros((len(fits), max(sizes)))
        for k, (equations, deviations) in enumerate(fits):
            A[k, : sizes[k], : sizes[k]], b[k, : sizes[k]] = equations.whitened(deviations)
        mask = np.append(self._columns, np.ones(max(sizes) - len(self._columns)))
        begun = None if start is None else np.tile(np.append(start, np.zeros(max(sizes) - len(start))), (len(fits), 1))
        prior = self.evidence.prior_of(self.settings)
        found = consistent_estimates(A * np.outer(mask, mask), b * mask, prior, PRIOR_WEIGHT, begun)
        return [x[:size] for x, size in zip(found, sizes, strict=True)]

    @cached_property
    def _columns(self) -> Array:
        return self.settings.columns(self.evidence.mechanism)

    @cached_property
    def _slopes(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Slopes (r,) of the torques on those of the file's links, shares (r,) so explained, and mask of large ones."""
        tens = self.evidence.prior.tens.ravel()
        links = self.rows.regressor[..., : tens.size] @ tens
        return *_each_joint(self.rows, links, self.used), self._large(links)

    def other_unit(self) -> str | None:
        """Sentence on torques that are a thousandth or a thousand of those of the file's links, as another unit is."""
        slopes, shares, large = self._slopes
        units = {TORQUE["N m"]: ("N m", "mN m"), TORQUE["mN m"]: ("mN m", "N m")}
        own = self.evidence.drives.units.torque
        if own not in units or self.evidence.prior.is_placeholder or not self._steady(slopes[large], shares[large]):
            return None
        stated, meant = units[own]
        slope = float(np.median(slopes[large]))
        if not 0.5 < slope * TORQUE[meant] / own < 2.0:
            return None
        return (
            f"{', '.join(self.sources)}: all torques are about {slope:.2g} times those of the robot file's links: "
            f"{meant} taken for {stated}; give torque={meant!r} as their unit"
        )

    def file_slopes(self) -> tuple[PreparationStep, bool]:
        """Line on torques over those of the file's links, often placeholders, and if all seem on gears' other side."""
        slopes, shares, large = self._slopes
        names = [joint.name for joint in self.evidence.mechanism.primary_joints]
        each = [f"{n} {slope:.2g} ({share:.0%})" for n, slope, share in zip(names, slopes, shares, strict=True)]
        told = f"{', '.join(each)} of their variation beside friction explained"
        geared = not self.evidence.prior.is_placeholder and self._geared(slopes[large], shares[large])
        side = f"; all about {np.median(slopes[large]):.2g}: are they on the other side of gears?" if geared else ""
        return PreparationStep("torques over the file's", told + side), geared

    def _large(self, torque: Array) -> NDArray[np.bool_]:
        """Mask (r,) of the joints with a good part of the largest torque of their kind, forces and torques apart."""
        revolute = np.array([joint.kind.is_revolute for joint in self.evidence.mechanism.primary_joints])
        sizes = np.linalg.norm(torque, axis=0)
        most = [sizes[revolute == own].max() for own in revolute]
        return np.asarray(sizes >= LARGE * np.array(most))

    def _geared(self, slopes: Array, shares: Array) -> bool:
        """True if joints' slopes, with the shares explained, are alike and so far from 1 as a gear would make them."""
        most = np.abs(slopes).max()
        gears = bool(np.abs(self.evidence.drives.transmission).max() > OTHER_SIDE)
        return self._steady(slopes, shares) and bool(most < 1 / OTHER_SIDE or (gears and most > OTHER_SIDE))

    def _steady(self, slopes: Array, shares: Array) -> bool:
        """True if slopes explain much and are alike."""
        return bool(shares.min() > EXPLAINED and np.abs(slopes).max() < ALIKE * np.abs(slopes).min())


def relative_error(equations: NormalEquations, x: Array) -> float:
    """Geometric mean over the joints of a fit's errors relative to the torques, each at least 0.3 %."""
    return float(_mean_errors(equations.misfit(x)[None], equations.square.sum(axis=0)[None])[0])


def _mean_errors(misfits: Array, squares: Array) -> Array:
    counted = np.all(squares > 0.0, axis=0)
    shares = misfits[:, counted] / squares[:, counted]
    return np.asarray(np.exp(0.5 * np.mean(np.log(shares + LEAST_ERROR**2), axis=1)))


def _each_joint(rows: Rows, told: Array, used: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Slopes (r,) of torques on others beside friction and an offset, and shares (r,) explained beside those."""
    slopes, shares = np.zeros((2, told.shape[1]))
    for j in range(told.shape[1]):
        here, v = used[:, j], rows.velocity[used[:, j], j]
        if np.count_nonzero(here) < 8:
            continue
        friction = np.column_stack([v, np.sign(v), np.ones(len(v))])
        own, other = (_left(friction, values[here, j]) for values in (told, rows.torque))
        products = float(own @ own), float(other @ other)
        if min(products) > 0.0:
            slopes[j], shares[j] = own @ other / products[0], (own @ other) ** 2 / (products[0] * products[1])
    return slopes, shares


def _left(columns: Array, values: Array) -> Array:
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values)[0])


def _thinned(motion: SmoothMotion, cutoff: float) -> tuple[SmoothMotion, Array]:
    """Motion with about a dozen instants in a period of a cut-off (Hz), and its accelerations."""
    inner = filtered(motion.velocity, derivative(np.ones(1), motion.rate))
    edge = (len(motion.velocity) - len(inner)) // 2
    acceleration = np.pad(inner, ((edge, edge), (0, 0)), mode="edge")
    k = max(1, int(motion.rate / (DENSITY * cutoff)))
    thin = replace(motion, every=k * motion.every, position=motion.position[::k], velocity=motion.velocity[::k])
    return thin, acceleration[::k]


def _windows(motion: SmoothMotion, acceleration: Array, most: int) -> Iterator[tuple[SmoothMotion, Array]]:
    """The motion itself, or windows spread over it that have at most so many instants together."""
    whole, length = len(motion.position), max(most // WINDOWS, 100)
    count = max(1, most // length)
    starts = [0] if whole <= most else np.linspace(0, whole - length, count).astype(int).tolist()
    for start in starts:
        part = slice(0, whole) if whole <= most else slice(start, start + length)
        first = motion.first + motion.every * part.start
        yield (
            replace(motion, first=first, position=motion.position[part], velocity=motion.velocity[part]),
            acceleration[part],
        )
