"""Sums of squares and products of rows by blocks of time: every fit, on whatever blocks and columns, needs no more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.filtered_dynamics import Rows


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of rows torque = Y x with P parameters x (P,), summed over each of B blocks of time, for each of
    r joints; Y^T is the transpose of Y. `normal` (B, r, P, P) are the sums of Y^T Y, (N m)^2 per SI units of two
    parameters; `moment` (B, r, P) those of Y^T torque, (N m)^2 per SI unit of each; `square` (B, r) those of torque^2,
    (N m)^2 (N for N m if a joint is prismatic); and `count` (B,) the numbers of instants. Nothing is checked at
    construction."""

    normal: Array
    moment: Array
    square: Array
    count: Array

    @classmethod
    def of(cls, rows: Rows, block: NDArray[np.int64]) -> NormalEquations:
        """Normal equations, a `NormalEquations`, of `rows` of low-pass filtered equations of motion at n instants,
        summed by blocks of time: `block` (n,) are the zero-based indices of the blocks that the rows belong to. Raises
        `ValueError` for rows of no instants, `IndexError` for another number of indices than instants."""
        parts = [_sums(rows.regressor[block == b], rows.torque[block == b]) for b in range(int(block.max()) + 1)]
        return cls(*(np.stack(part) for part in zip(*parts, strict=True)))

    def over(self, blocks: NDArray[np.int64] | Sequence[int]) -> NormalEquations:
        """Normal equations, a `NormalEquations` of one block: the sums over some of these `blocks` of time, given by
        their zero-based indices; a repeated index counts repeatedly. Raises `IndexError` for a block that does not
        exist."""
        which = np.asarray(blocks, dtype=np.int64)
        parts = (self.normal, self.moment, self.square, self.count)
        return NormalEquations(*(part[which].sum(axis=0, keepdims=True) for part in parts))

    def with_columns(self, rows: Rows, more: Array) -> NormalEquations:
        """These normal equations of r joints, of one block of time, on c more parameters, a `NormalEquations`, the new
        ones last. `rows` are the n rows of low-pass filtered equations of motion whose sums they are, and `more` (n, r,
        c), N m (N for a prismatic joint) per unit of each parameter, is the regressor of the new ones. Raises
        `ValueError` for arrays of unlike n or r."""
        Y, L = rows.regressor.transpose(1, 0, 2), more.transpose(1, 0, 2)
        across, own = Y.mT @ L, L.mT @ L
        moment = np.concatenate([self.moment[0], (L.mT @ rows.torque.T[..., None])[..., 0]], axis=-1)
        normal = np.block([[self.normal[0], across], [across.mT, own]])
        return NormalEquations(normal[None], moment[None], self.square, self.count)

    def with_blank_columns(self, count: int) -> NormalEquations:
        """These normal equations on `count` more parameters, a `NormalEquations`: the new ones come last, and their
        regressor is zero. Raises `ValueError` for a count below zero."""
        wider = (0, count)
        normal = np.pad(self.normal, ((0, 0), (0, 0), wider, wider))
        return NormalEquations(normal, np.pad(self.moment, ((0, 0), (0, 0), wider)), self.square, self.count)

    def whitened(self, deviations: Array) -> tuple[Array, Array]:
        """The normal matrix A (P, P) and the moment b (P,) of weighted least squares on P parameters, a pair, summed
        over all blocks of time and r joints. Each joint's equations are divided by its standard deviation in
        `deviations` (r,), N m (N for a prismatic joint). The weighted residuals' sum of squares is least at the
        parameters x where x^T A x/2 - b^T x is, ^T being the transpose. Deviations must be above zero, which is not
        checked. Raises `ValueError` for another number of them than r."""
        weight = 1.0 / deviations**2
        return np.einsum("brij,r->ij", self.normal, weight), np.einsum("bri,r->i", self.moment, weight)

    def misfit(self, x: Array) -> Array:
        """Sums (r,) of the squared torque residuals of P parameters `x` (P,), SI units, in the order of
        `parameter_names`, over all blocks of time, for each of r joints, (N m)^2 (N^2 for a prismatic joint); at least
        0. Raises `ValueError` for another number of parameters."""
        normal, moment = self.normal.sum(axis=0), self.moment.sum(axis=0)
        return np.maximum(self.square.sum(axis=0) - 2.0 * moment @ x + (normal @ x) @ x, 0.0)

    def rms(self, x: Array) -> float:
        """Root mean square, N m (N for prismatic joints), of the torque residuals of P parameters `x` (P,), SI units,
        in the order of `parameter_names`, over all joints and instants. Raises `ValueError` for another number of
        parameters."""
        return float(np.sqrt(self.misfit(x).sum() / (self.count.sum() * self.square.shape[1])))


def _sums(Y: Array, torque: Array) -> tuple[Array, Array, Array, Array]:
    """Y'Y (r, P, P), Y'tau (r, P), tau'tau (r,) and the number of rows, of regressors (n, r, P) and torques (n, r)."""
    joints = Y.transpose(1, 0, 2)
    moment = (joints.mT @ torque.T[..., None])[..., 0]
    return joints.mT @ joints, moment, np.square(torque).sum(axis=0), np.asarray(float(len(Y)))


def block_edges(rows: Rows, count: int) -> list[tuple[int, float]]:
    """Edges of blocks of time of low-pass filtered equations of motion, `rows`: a list, in ascending order, of pairs of
    the zero-based index of a log and the time (s) at which a block begins in it. There are about `count` blocks of
    equally many rows, and each is within one log, so that there are more blocks where there are several logs. Raises
    `IndexError` for rows of no instants."""
    starts = [int(start) for start in np.linspace(0, len(rows), count, endpoint=False)]
    firsts = np.flatnonzero(np.diff(rows.log, prepend=-1)).tolist()
    return [(int(rows.log[i]), float(rows.time[i])) for i in sorted({*starts, *firsts})]


def blocks_of(rows: Rows, edges: Sequence[tuple[int, float]]) -> NDArray[np.int64]:
    """Zero-based indices (n,) of the blocks of time that n `rows` of low-pass filtered equations of motion belong to.
    `edges`, one for each block in ascending order, are pairs of the zero-based index of a log and the time (s) at which
    the block begins in it; a row at that very time is in the block. Rows before the first edge are in block 0. Nothing
    is checked."""
    keys = np.array(edges)
    found = np.zeros(len(rows), dtype=np.int64)
    for b, (log, time) in enumerate(keys.tolist()):
        found[(rows.log > log) | ((rows.log == log) & (rows.time >= time))] = b
    return found
