"""One fit of a robot's parameters to rows: by least squares, or consistent, with or without load-dependent friction."""

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

ROTOR, LOAD = 0.1, 0.1
"""Rough sizes of a rotor's inertia over the links' mean moment, and of load-dependent friction's share."""


@dataclass(frozen=True)
class FitSettings:
    """Settings of a fit of a robot's parameters to logs: the `friction` model, the `weight` (unitless), against the
    logs, of the prior, which is a first guess of the links, and the `cutoff` (Hz) of the low-pass filter that the
    equations of motion go through. Nothing is checked at construction."""

    friction: FrictionModel
    weight: float
    cutoff: float


@dataclass(frozen=True, eq=False)
class Fit:
    """Fit of a robot's parameters to logs, and the `settings` that it was made with.

    `x` (P + r,), SI units, are the P parameters of the mechanism with all kinds of friction, in the order of its
    `parameter_names`, zero for those that the friction model does not have, then, for each of r primary (independent)
    joints, the coefficient (unitless) of load-dependent friction, its torque over that of the joint without friction.
    `deviations` (r,) are the standard deviations of the joints' torque residuals, N m (N for a prismatic joint).
    `curvature` (P + r, P + r), per SI units of two parameters, is the normal matrix Y^T W Y of the equations torque = Y
    x, with the transpose Y^T, in which W divides each joint's by the square of its deviation; it is zero for parameters
    that the friction model does not have. Made by `LogEvidence.fit`; nothing is checked at construction.
    """

    x: Array
    deviations: Array
    curvature: Array
    settings: FitSettings


@dataclass(frozen=True, eq=False)
class LogEvidence:
    """Evidence of logs that fits are made from: rows of filtered equations of motion, at each of several cut-offs of a
    low-pass filter, in B blocks of time.

    `mechanism` is the robot with every kind of friction, P parameters and r primary (independent) joints; `basis` are
    its fundamental (base) parameters, `drives` its transmission, and `prior` its parameters before the logs. `motions`
    are the logs' smoothed motions, `rows` the `Rows` (equations) by cut-off (Hz), and `edges` the beginning of each
    block: the zero-based index of its log, and a time (s). `kept` holds, by cut-off, masks of those of the motions'
    rows that belong to the evidence, None where all do. Methods raise `KeyError` for a cut-off that it does not have.
    Nothing is checked at construction.
    """

    mechanism: Mechanism
    basis: FundamentalBasis
    drives: Drives
    prior: EntropicPrior
    motions: Sequence[SmoothMotion]
    rows: dict[float, Rows]
    edges: Sequence[tuple[int, float]]
    kept: dict[float, NDArray[np.bool_]] | None = None

    def part(self, blocks: Sequence[int]) -> LogEvidence:
        """The evidence (rows of filtered equations of motion), a `LogEvidence`, of some `blocks` of time alone, given
        by their zero-based indices, which must rise; that is not checked. Raises `IndexError` for a block that does not
        exist."""
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
        """Normal equations by cut-off (Hz), without load-dependent friction."""
        return {cutoff: NormalEquations.of(rows, self._block[cutoff]) for cutoff, rows in self.rows.items()}

    @cached_property
    def _block(self) -> dict[float, NDArray[np.int64]]:
        return {cutoff: blocks_of(rows, self.edges) for cutoff, rows in self.rows.items()}

    @property
    def blocks(self) -> int:
        """Number of the blocks of time that the evidence, rows of filtered equations of motion, is grouped in."""
        return len(self.edges)

    def load(self, cutoff: float, x: Array) -> Array:
        """Columns (n, r, r), N m (N for prismatic joints), of load-dependent friction in the n rows of low-pass
        filtered equations of motion at a `cutoff` (Hz). They are the torques of r joints (second axis) by the friction
        of each of r drives (third axis) for a coefficient of 1, that is, as large as the rigid torque (the torque
        without friction) at the drive's joint. The rigid torques are those of the mechanism's P parameters, SI units,
        the first P of `x`. Raises `InputError` for parameters that no mechanism may have (not finite, above 1e20, or a
        rotor's inertia below zero)."""
        columns = load_columns(self.motions, self.mechanism, x, cutoff, self.drives)
        return columns if self.kept is None else columns[self.kept[cutoff]]

    def equations(self, cutoff: float, blocks: Sequence[int], load: Array | None = None) -> NormalEquations:
        """Normal equations, a `NormalEquations` of one block, of the rows at a `cutoff` (Hz) in some `blocks` of time
        (zero-based indices), summed. They are on P + r parameters: the mechanism's P, and the r coefficients of
        load-dependent friction (its torque over that of the joint without friction). `load` (n, r, r), N m (N if
        prismatic), is the regressor on these coefficients in all n rows at the cut-off, as the method `load_from` gives
        it; None for zeros. Raises `KeyError` for a cut-off that the evidence does not have, `IndexError` for a block
        that does not exist."""
        plain = self._plain[cutoff].over(blocks)
        if load is None:
            return plain.with_blank_columns(self.mechanism.dof)
        here = np.isin(self._block[cutoff], blocks)
        return plain.with_columns(self.rows[cutoff].chosen(here), load[here])

    def mask(self, friction: FrictionModel) -> Array:
        """Mask (P + r,) of zeros and ones: 1 for those of the mechanism's P parameters and r coefficients of
        load-dependent friction (its torque over that of the joint without friction) that a friction model has. Links'
        parameters and rotor inertias always have 1. Nothing is raised."""
        return np.concatenate([friction.columns(self.mechanism), np.full(self.mechanism.dof, float(friction.load))])

    def independent(self, friction: FrictionModel) -> NDArray[np.int64]:
        """Zero-based indices (c,) of the c parameters that least squares is solved for, among the mechanism's P
        parameters and the r coefficients of load-dependent friction (its torque over that of the joint without
        friction). First come the fundamental (base) parameters, which the motion can tell apart, then those of the
        `friction` model. Nothing is raised."""
        energetic = self.mechanism.num_energy_parameters
        others = [c for c in np.flatnonzero(self.mask(friction)).tolist() if c >= energetic]
        return np.array([*self.basis.columns, *others])

    def fit(self, settings: FitSettings, blocks: Sequence[int]) -> Fit:
        """The fit, a `Fit`, of physically consistent parameters with some `settings` to the equations in some `blocks`
        of time (zero-based indices). The search begins where the last one on the same blocks ended. Raises `KeyError`
        for a cut-off that the evidence does not have, `IndexError` for a block that does not exist, `AdaptctlError`
        where the search does not converge."""
        load, key = self.load_from(settings, blocks), tuple(blocks)
        found = self.fitted(self.equations(settings.cutoff, blocks, load), settings, self._ends.get(key))
        self._ends[key] = found.x
        return found

    @cached_property
    def _ends(self) -> dict[tuple[int, ...], Array]:
        return {}

    def load_from(self, settings: FitSettings, blocks: Sequence[int], cutoff: float | None = None) -> Array | None:
        """Columns (n, r, r), N m (N for prismatic joints), of load-dependent friction in all n rows of low-pass
        filtered equations of motion at a `cutoff` (Hz; None for the settings' own), or None where the friction model of
        the `settings` has no such friction. They are the torques of r joints (second axis) by the friction of each of r
        drives (third axis) for a coefficient of 1, that is, as large as the rigid torque (the torque without friction)
        at the drive's joint. The rigid torques are those of a fit without it to some `blocks` of time (zero-based
        indices). Raises `KeyError` for a cut-off that the evidence does not have, `AdaptctlError` where that fit is not
        found."""
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
        """The fit, a `Fit`, of physically consistent parameters to normal `equations`, with the friction model and
        weight of the `settings`. The parameters are P + r, the mechanism's P and r coefficients of load-dependent
        friction (its torque over that of the joint without friction). Sums over the equations' blocks of time are
        taken; each joint's equations are divided by the standard deviation of its torque residuals in weighted least
        squares. `start` (P + r,), SI units, is where the search begins, None for the prior. Raises `AdaptctlError`
        where the search does not converge, `ValueError` for equations of no instants."""
        mask = self.mask(settings.friction)
        _, deviations = weighted_least_squares(equations, self.independent(settings.friction))
        A, b = equations.whitened(deviations)
        A, b = A * np.outer(mask, mask), b * mask
        prior = self.prior_of(settings.friction)
        x = consistent_estimate(A, b, prior, settings.weight, None if start is None else _started(start, prior, mask))
        return Fit(x, deviations, A, settings)

    def prior_of(self, friction: FrictionModel) -> EntropicPrior:
        """The prior, an `EntropicPrior` (first guesses of links, rough sizes of positive parameters), of the parameters
        that a `friction` model has: the evidence's own, without the friction terms that the model lacks. Where the
        model has load-dependent friction, its r coefficients (its torque over that of the joint without friction) are
        added as positive parameters of rough size 0.1. Nothing is raised."""
        r, P = self.mechanism.dof, len(self.mechanism.parameter_names)
        kept = self.mask(friction)[self.prior.positive] > 0.0
        loads = np.arange(P, P + r) if friction.load else np.arange(0)
        positive = np.concatenate([self.prior.positive[kept], loads])
        scales = np.concatenate([self.prior.scales[kept], np.full(len(loads), LOAD)])
        return EntropicPrior(self.prior.tens, positive, scales)

    def ordinary(self, friction: FrictionModel, cutoff: float, blocks: Sequence[int]) -> Array:
        """Parameters (P + r,), SI units, by weighted least squares with a `friction` model on some `blocks` of time
        (zero-based indices), at a `cutoff` (Hz), without a prior: links need not be physically consistent. They are P
        of the mechanism and r coefficients of load-dependent friction, which are zero. Raises `KeyError` for a cut-off
        that the evidence does not have, `IndexError` for a block that does not exist."""
        return weighted_least_squares(self.equations(cutoff, blocks), self.independent(friction))[0]


def _started(start: Array, prior: EntropicPrior, mask: Array) -> Array:
    """Start of a search: parameters that must be positive and are not begin at their scale."""
    x = start * mask
    x[prior.positive] = np.where(x[prior.positive] > 0.0, x[prior.positive], prior.scales)
    return x


def positive_columns(mechanism: Mechanism, tens: Array) -> tuple[NDArray[np.int64], Array]:
    """Zero-based indices (c,), in ascending order, among a mechanism's parameters (in the order of its
    `parameter_names`), of the c parameters of drives that must be positive (rotor inertias, viscous and Coulomb
    friction), and their rough sizes (c,), SI units, a pair. The size of a rotor inertia is a tenth of the links' mean
    moment of inertia, at least 1e-6 kg m^2; other sizes are 1. `tens` (N, 10) are the ten inertial parameters, m, mc_x,
    mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz in SI units, of the N links that are not massless. Nothing is
    checked."""
    first = 10 * len(mechanism.description.bodies)
    drives = mechanism.description.drive_parameters
    own = [first + k for k, (_, kind) in enumerate(drives) if kind not in MAY_BE_NEGATIVE]
    inertia = float(np.mean(np.trace(tens[:, [[4, 5, 7], [5, 6, 8], [7, 8, 9]]], axis1=1, axis2=2))) / 3.0
    rotor = {first + k for k, (_, kind) in enumerate(drives) if kind is DriveParameter.ROTOR_INERTIA}
    return np.array(own), np.array([max(ROTOR * inertia, 1e-6) if c in rotor else 1.0 for c in own])
