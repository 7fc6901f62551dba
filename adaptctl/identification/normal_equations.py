"""Sums of squares and products of rows by blocks of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.filtered_dynamics import Rows
from adaptctl.identification.momentum_balance import PackedRegressor

# Rows that are gathered at a time, so that they stay in the processor's cache.
ROWS_AT_ONCE = 1024


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of rows torque = Y x, summed over each of B blocks, for each of r joints, with rows' counts."""

    normal: Array
    moment: Array
    square: Array
    count: Array

    @classmethod
    def zero(cls, blocks: int, joints: int, parameters: int) -> NormalEquations:
        """Normal equations of no rows."""
        moment, (square, count) = np.zeros((blocks, joints, parameters)), np.zeros((2, blocks, joints))
        return cls(np.zeros((*moment.shape, parameters)), moment, square, count)

    @classmethod
    def of(cls, rows: Rows, block: NDArray[np.int64], blocks: int, used: NDArray[np.bool_]) -> NormalEquations:
        """Normal equations of those joints' rows that a mask (n, r) has, summed by the blocks that they belong to."""
        found = cls.zero(blocks, *rows.regressor.shape[1:])
        found.add(PackedRegressor.of(rows.regressor), rows.torque, block, used)
        return found

    @classmethod
    def stacked(cls, each: Sequence[NormalEquations]) -> NormalEquations:
        """Normal equations with a block for the sums of each."""
        return cls(*map(np.concatenate, zip(*(own.whole._parts for own in each), strict=True)))

    def add(self, regressor: PackedRegressor, torque: Array, block: NDArray[np.int64], used: NDArray[np.bool_]) -> None:
        """Add those joints' rows that a mask (n, r) has, in place."""
        for j in range(used.shape[1]):
            columns, values = regressor.joint(j)
            for b in np.unique(block[used[:, j]]).tolist():
                here = np.flatnonzero(used[:, j] & (block == b))
                for start in range(0, len(here), ROWS_AT_ONCE):
                    rows = here[start : start + ROWS_AT_ONCE]
                    Y, tau = values[rows], torque[rows, j]
                    self.normal[b, j][np.ix_(columns, columns)] += Y.T @ Y
                    self.moment[b, j, columns] += Y.T @ tau
                    self.square[b, j] += tau @ tau
                self.count[b, j] += len(here)

    def over(self, blocks: NDArray[np.int64] | Sequence[int]) -> NormalEquations:
        """Normal equations of one block: the sums over some blocks."""
        chosen = np.zeros(len(self.count))
        chosen[np.asarray(blocks, dtype=np.int64)] = 1.0
        return self.weighted(chosen)

    def weighted(self, weights: Array) -> NormalEquations:
        """Normal equations of one block: the sums over all, each times its weight (B,)."""
        return NormalEquations(*(np.tensordot(weights, part, 1)[None] for part in self._parts))

    @property
    def whole(self) -> NormalEquations:
        """Normal equations of one block: the sums over all."""
        return self if len(self.count) == 1 else self.over(range(len(self.count)))

    def chosen(self, blocks: NDArray[np.int64] | Sequence[int]) -> NormalEquations:
        """Normal equations of some blocks."""
        which = np.asarray(blocks, dtype=np.int64)
        return NormalEquations(*(part[which] for part in self._parts))

    def plus(self, other: NormalEquations) -> NormalEquations:
        """Normal equations of these rows and others, block by block."""
        return NormalEquations(*map(np.add, self._parts, other._parts))

    def without(self, joints: Sequence[int]) -> NormalEquations:
        """Normal equations without those of some joints."""
        if not joints:
            return self
        kept = np.ones(self.square.shape[1])
        kept[list(joints)] = 0.0
        parts = (self.normal * kept[:, None, None], self.moment * kept[:, None], self.square * kept, self.count * kept)
        return NormalEquations(*parts)

    @property
    def _parts(self) -> tuple[Array, Array, Array, Array]:
        return self.normal, self.moment, self.square, self.count

    def whitened(self, deviations: Array) -> tuple[Array, Array]:
        """Normal matrix (P, P) and moment (P,), each joint's equations divided by its deviation."""
        weight, whole = 1.0 / deviations**2, self.whole
        return np.tensordot(weight, whole.normal[0], 1), weight @ whole.moment[0]

    def misfit(self, x: Array) -> Array:
        """Sums (r,) of squared torque residuals of parameters (P,)."""
        whole = self.whole
        left = (whole.normal[0] @ x - 2.0 * whole.moment[0]) @ x
        return np.maximum(whole.square[0] + left, 0.0)


def block_edges(log: NDArray[np.int64], time: Array, count: int) -> list[tuple[int, float]]:
    """Index of the log and time (s) at which each of about `count` blocks of equally many rows begins."""
    starts = [int(start) for start in np.linspace(0, len(log), count, endpoint=False)]
    firsts = np.flatnonzero(np.diff(log, prepend=-1)).tolist()
    return [(int(log[i]), float(time[i])) for i in sorted({*starts, *firsts})]


def blocks_of(rows: Rows, edges: Sequence[tuple[int, float]]) -> NDArray[np.int64]:
    """Indices (n,) of the blocks that rows belong to, by their edges: a log's first has all rows before its second."""
    found, before = np.zeros(len(rows), dtype=np.int64), -1
    for b, (log, time) in enumerate(edges):
        begun = rows.time >= time if log == before else True
        found[(rows.log > log) | ((rows.log == log) & begun)], before = b, log
    return found
