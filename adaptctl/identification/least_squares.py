"""Weighted least squares on columns that are independent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from adaptctl.arrays import Array
from adaptctl.identification.filtered_dynamics import Rows
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.preparation import PreparedLog

NEGLIGIBLE = 1e-10
"""Of the largest eigenvalue of the scaled normal matrix: what lies below is not determined, and stays zero."""
ROUNDS = 3


def least_squares(A: Array, b: Array, columns: NDArray[np.int64]) -> Array:
    """The P parameters x (P,) that minimise x^T A x/2 - b^T x over the c of them of zero-based indices `columns` (c,),
    the others being zero. A (P, P) is a normal matrix, b (P,) a moment, ^T the transpose. A is scaled to a diagonal of
    ones; where eigenvalues of it are below 1e-10 of the largest, x is not unique, and the one of least norm in the
    scaled parameters is taken. Raises `ValueError` for numbers that are not finite, `IndexError` where `columns` is
    empty or has an index of P or more."""
    own, wanted = A[np.ix_(columns, columns)], b[columns]
    size = np.sqrt(np.diag(own))
    size[size == 0.0] = 1.0
    values, vectors = eigh(own / np.outer(size, size))
    kept = values > NEGLIGIBLE * values[-1]
    x = np.zeros(len(b))
    x[columns] = vectors[:, kept] @ ((vectors[:, kept].T @ (wanted / size)) / values[kept]) / size
    return x


def weighted_least_squares(equations: NormalEquations, columns: NDArray[np.int64]) -> tuple[Array, Array]:
    """The parameters (P,), SI units, of a weighted least-squares fit and the standard deviations (r,), N m (N for a
    prismatic joint), of the torque residuals of r joints, a pair. Only the c parameters of zero-based indices `columns`
    (c,) are fitted, the others being zero; the joints' equations are weighted by the inverse squares of these
    deviations (Gautier 1997).

    `equations` are normal equations on P parameters. Weights and parameters are found in three rounds. Raises
    `ValueError` for numbers that are not finite, as for equations of no instants, `IndexError` where `columns` is empty
    or has an index of P or more.
    """
    deviations = np.sqrt(equations.square.sum(axis=0) / equations.count.sum())
    x = np.zeros(equations.moment.shape[-1])
    for _ in range(ROUNDS):
        x = least_squares(*equations.whitened(deviations), columns)
        deviations = np.maximum(np.sqrt(equations.misfit(x) / equations.count.sum()), 1e-6 * deviations.max())
    return x, deviations


WEAKEST = 1e-8


def halves(log: PreparedLog) -> tuple[PreparedLog, PreparedLog]:
    """Two halves of a prepared `log` of n samples, each a `PreparedLog` of (n - 3)//2 samples at half its rate, of the
    same motion but with independent encoder noise. The first has the positions of the even samples, the second those of
    the odd ones, brought to the same times by the mean of two neighbours. Torques, the same in both, are weighted means
    of all samples. The log must have at least five samples, which is not checked."""
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
    """Rows of low-pass filtered equations of motion, a `Rows`: a copy of `rows`, n instants of r joints, whose
    regressor (n, r, P) is replaced by its fitted values from a linear regression on the regressor of `instruments`.
    This is the first stage of two-stage least squares, for each joint by itself: each of the P columns is projected
    onto the column space of the joint's (n, P) regressor in `instruments`. As these are rows of the same instants with
    independent noise, the fitted values are free of the noise of `rows`. Regressors are in N m (N for a prismatic
    joint) per SI unit of each of P parameters. Raises `ValueError` for instruments of another number of instants,
    `IndexError` for fewer joints, NumPy's `LinAlgError` where their regressor is infinite; NaN is not refused."""
    parts = [_regressed(rows.regressor[:, j], instruments.regressor[:, j]) for j in range(rows.regressor.shape[1])]
    return replace(rows, regressor=np.stack(parts, axis=1))


def joined_first_stage(rows: Sequence[Rows], instruments: Sequence[Rows]) -> list[Rows]:
    """Rows of filtered equations, a list with a `Rows` for each cut-off of the low-pass filter: those of `rows`, each
    joint's regressor replaced by its fitted values from a linear regression on that of the `instruments` of the same
    index in their list, rows of the same instants with other noise. Raises `ValueError` for instruments of another
    number of cut-offs or instants, `IndexError` for fewer joints."""
    return [first_stage(own, other) for own, other in zip(rows, instruments, strict=True)]


def _regressed(Y: Array, Z: Array) -> Array:
    """Z (Z'Z)^+ Z'Y, in Z's column space as far as it is clear of round-off."""
    size = np.linalg.norm(Z, axis=0)
    U, values, _ = np.linalg.svd(Z[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    U = U[:, values > WEAKEST * values[0]] if len(values) else U
    return np.asarray(U @ (U.T @ Y))
