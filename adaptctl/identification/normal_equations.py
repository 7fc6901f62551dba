"""Sums of squares and products of rows by blocks of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.filtered_dynamics import Rows


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of rows torque = Y x, summed over each of B blocks, for each of r joints."""

    normal: Array
    moment: Array
    square: Array
    count: Array

    @classmethod
    def of(cls, rows: Rows, block: NDArray[np.int64]) -> NormalEquations:
        """Normal equations of rows, summed by the blocks that they belong to."""
        parts = [_sums(rows.regressor[block == b], rows.torque[block == b]) for b in range(int(block.max()) + 1)]
        return cls(*(np.stack(part) for part in zip(*parts, strict=True)))

    def over(self, blocks: NDArray[np.int64] | Sequence[int]) -> NormalEquations:
        """Normal equations of one block: the sums over some blocks."""
        which = np.asarray(blocks, dtype=np.int64)
        parts = (self.normal, self.moment, self.square, self.count)
        return NormalEquations(*(part[which].sum(axis=0, keepdims=True) for part in parts))

    def with_columns(self, rows: Rows, more: Array) -> NormalEquations:
        """Normal equations on more parameters, the new ones last, whose regressor (n, r, c) is `more`."""
        Y, L = rows.regressor.transpose(1, 0, 2), more.transpose(1, 0, 2)
        across, own = Y.mT @ L, L.mT @ L
        moment = np.concatenate([self.moment[0], (L.mT @ rows.torque.T[..., None])[..., 0]], axis=-1)
        normal = np.block([[self.normal[0], across], [across.mT, own]])
        return NormalEquations(normal[None], moment[None], self.square, self.count)

    def with_blank_columns(self, count: int) -> NormalEquations:
        """Normal equations on more parameters whose regressor is zero."""
        wider = (0, count)
        normal = np.pad(self.normal, ((0, 0), (0, 0), wider, wider))
        return NormalEquations(normal, np.pad(self.moment, ((0, 0), (0, 0), wider)), self.square, self.count)

    def whitened(self, deviations: Array) -> tuple[Array, Array]:
        """Normal matrix (P, P) and moment (P,), each joint's equations divided by its deviation."""
        weight = 1.0 / deviations**2
        return np.einsum("brij,r->ij", self.normal, weight), np.einsum("bri,r->i", self.moment, weight)

    def misfit(self, x: Array) -> Array:
        """Sums (r,) of squared torque residuals of parameters (P,)."""
        normal, moment = self.normal.sum(axis=0), self.moment.sum(axis=0)
        return np.maximum(self.square.sum(axis=0) - 2.0 * moment @ x + (normal @ x) @ x, 0.0)

    def rms(self, x: Array) -> float:
        """Root mean square residual in N m (N) of parameters (P,) over all joints and instants."""
        return float(np.sqrt(self.misfit(x).sum() / (self.count.sum() * self.square.shape[1])))


def _sums(Y: Array, torque: Array) -> tuple[Array, Array, Array, Array]:
    joints = Y.transpose(1, 0, 2)
    moment = (joints.mT @ torque.T[..., None])[..., 0]
    return joints.mT @ joints, moment, np.square(torque).sum(axis=0), np.asarray(float(len(Y)))


def block_edges(rows: Rows, count: int) -> list[tuple[int, float]]:
    """Index of the log and time (s) at which each of about `count` blocks of equally many rows begins."""
    starts = [int(start) for start in np.linspace(0, len(rows), count, endpoint=False)]
    firsts = np.flatnonzero(np.diff(rows.log, prepend=-1)).tolist()
    return [(int(rows.log[i]), float(rows.time[i])) for i in sorted({*starts, *firsts})]


def blocks_of(rows: Rows, edges: Sequence[tuple[int, float]]) -> NDArray[np.int64]:
    """Indices (n,) of the blocks that rows belong to, by their edges."""
    keys = np.array(edges)
    found = np.zeros(len(rows), dtype=np.int64)
    for b, (log, time) in enumerate(keys.tolist()):
        found[(rows.log > log) | ((rows.log == log) & (rows.time >= time))] = b
    return found
