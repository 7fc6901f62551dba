"""Weighted least squares on columns that are independent."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.filtered_dynamics import Rows
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.preparation import PreparedLog

# Share of the largest eigenvalue of the scaled normal matrix below which a direction is not determined.
MIN_EIGENVALUE_RATIO = 1e-10
# Least share of a column that those before it leave, from which on all directions are determined.
CLEARLY_DETERMINED = 1e-3
WEIGHTING_ROUNDS = 3


def least_squares(A: Array, b: Array, columns: NDArray[np.int64]) -> Array:
    """Parameters (P,) that minimise x^T A x/2 - b^T x over some columns, the others zero."""
    x = np.zeros(len(b))
    (x[columns],) = _scaled_solutions(A[None, columns[:, None], columns], b[None, columns])
    return x


def _scaled_solutions(A: Array, b: Array) -> Array:
    """Solutions (B, c) of normal equations, whose columns are scaled to a diagonal of ones before."""
    size = np.sqrt(np.diagonal(A, axis1=1, axis2=2))
    size = np.where(size == 0.0, 1.0, size)
    scaled, wanted = A / (size[:, :, None] * size[:, None]), b / size
    with suppress(np.linalg.LinAlgError):
        if np.diagonal(np.linalg.cholesky(scaled), axis1=1, axis2=2).min(initial=1.0) > CLEARLY_DETERMINED:
            return np.asarray(np.linalg.solve(scaled, wanted[..., None])[..., 0] / size)
    return np.stack([_solution(*each) for each in zip(scaled, wanted, strict=True)]) / size


def _solution(scaled: Array, wanted: Array) -> Array:
    """Solution (c,) of scaled normal equations without directions that are not determined."""
    values, vectors = np.linalg.eigh(scaled)
    kept = values > MIN_EIGENVALUE_RATIO * values[-1]
    return np.asarray(vectors[:, kept] @ ((vectors[:, kept].T @ wanted) / values[kept]))


def explained_squares(A: Array, b: Array) -> Array:
    """Squares (k,) that least squares explain of several moments (k, c) of one normal matrix (c, c)."""
    size = np.sqrt(np.where(np.diag(A) > 0.0, np.diag(A), 1.0))
    scaled, wanted = A / np.outer(size, size), b / size
    return np.asarray(np.sum(wanted.T * np.linalg.lstsq(scaled, wanted.T, MIN_EIGENVALUE_RATIO)[0], axis=0))


def weighted_least_squares(equations: NormalEquations, columns: NDArray[np.int64]) -> tuple[Array, Array]:
    """Parameters (P,) and residual deviations (r,) of joints, weighted by their inverse squares (Gautier 1997)."""
    (x,), (deviations,) = each_weighted(equations.whole, columns)
    return x, deviations


def each_weighted(equations: NormalEquations, columns: NDArray[np.int64]) -> tuple[Array, Array]:
    """Parameters (B, P) and deviations (B, r) of each block for itself, weighted likewise."""
    normal, moment = equations.normal[..., columns[:, None], columns], equations.moment[..., columns]
    square, count = equations.square, np.maximum(equations.count, 1.0)
    deviations = np.sqrt(square / count)
    deviations = np.where(deviations > 0.0, deviations, np.maximum(deviations.max(axis=1, keepdims=True), 1.0))
    least = 1e-6 * deviations
    for _ in range(WEIGHTING_ROUNDS):
        weight = deviations[:, None] ** -2
        A = (weight @ normal.reshape(*normal.shape[:2], -1)).reshape(-1, *normal.shape[2:])
        own = _scaled_solutions(A, (weight @ moment)[:, 0])
        left = ((normal @ own[:, None, :, None])[..., 0] - 2.0 * moment) * own[:, None]
        deviations = np.maximum(np.sqrt(np.maximum(square + left.sum(axis=-1), 0.0) / count), least)
    x = np.zeros((len(own), equations.moment.shape[-1]))
    x[:, columns] = own
    return x, deviations


MIN_INSTRUMENT_RATIO = 1e-8


def halves(log: PreparedLog) -> tuple[PreparedLog, PreparedLog]:
    """Two logs of half the rate: the same motion, from even and from odd samples, with independent noise."""
    count = (len(log.time) - 3) // 2
    even = slice(2, 2 + 2 * count, 2)
    before, after = log.position[1 : 1 + 2 * count : 2], log.position[3 : 3 + 2 * count : 2]
    torque = (log.torque[1 : 1 + 2 * count : 2] + 2.0 * log.torque[even] + log.torque[3 : 3 + 2 * count : 2]) / 4.0
    own = replace(
        log,
        rate=0.5 * log.rate,
        time=log.time[even],
        position=log.position[even],
        torque=torque,
        moving=log.moving[even],
    )
    return own, replace(own, position=0.5 * (before + after))


def first_stage(rows: Rows, instruments: Rows) -> Rows:
    """Rows whose regressor is its projection on the instruments', joint by joint (two-stage least squares)."""
    parts = [_regressed(rows.regressor[:, j], instruments.regressor[:, j]) for j in range(rows.regressor.shape[1])]
    return replace(rows, regressor=np.stack(parts, axis=1))


def joined_first_stage(rows: Sequence[Rows], instruments: Sequence[Rows]) -> list[Rows]:
    """Rows of each cut-off, regressors replaced by their projection on the instruments'."""
    return [first_stage(own, other) for own, other in zip(rows, instruments, strict=True)]


def _regressed(Y: Array, Z: Array) -> Array:
    """Z (Z'Z)^+ Z'Y, in Z's column space as far as it is clear of round-off."""
    size = np.linalg.norm(Z, axis=0)
    U, values, _ = np.linalg.svd(Z[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    U = U[:, values > MIN_INSTRUMENT_RATIO * values[0]] if len(values) else U
    return np.asarray(U @ (U.T @ Y))
