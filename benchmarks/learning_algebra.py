"""The dense algebra of a tick of composite learning, against the same in NumPy and LAPACK."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.linalg

from adaptctl.arrays import Array
from adaptctl.compilation import compile_function
from adaptctl.control.adaptation.symmetric import Equation, directional_update, solve
from adaptctl.scalars import Column
from benchmarks.findings import Agreement, Finding, Speedup
from benchmarks.interleaved import Effort, Statement, race

SIZES = {(36, 6): 8.0, (57, 8): 6.0, (97, 12): 3.0, (232, 29): 1.4}
"""Parameters and joints, and how much faster than NumPy is asked."""

FORGOTTEN, LEARNED, FLOOR = 0.01, 0.001, 1e-300


def ours(information: Column, known: Column, rows: Column, slope: Column) -> tuple[Column, Column, Column]:
    """Information and z after r equations of torque 1, and the step along a slope."""
    k, equations = len(known), []
    for first in range(0, len(rows), k):
        row = Column(rows.of[first : first + k])
        equations.append(Equation(row, FORGOTTEN, FLOOR, learned=LEARNED, gained=LEARNED))
    after, learned = directional_update(information, known, equations)
    return after, learned, solve(after, slope, 1.0)


def theirs(information: Array, known: Array, rows: Array, slope: Array) -> tuple[Array, Array, Array]:
    """The same, by products of matrices where there are any, and Cholesky's factors."""
    along, lost = rows @ information, np.zeros(len(rows))
    products = rows @ rows.T
    for q, row in enumerate(rows):
        along[q] += (LEARNED * products[q, :q]) @ rows[:q] - (lost[:q] * (along[:q] @ row)) @ along[:q]
        lost[q] = FORGOTTEN / (along[q] @ row + FLOOR)
        known = known - (lost[q] * (row @ known)) * along[q] + LEARNED * row
    after = information - (lost[:, None] * along).T @ along + LEARNED * (rows.T @ rows)
    shifted = after.copy()
    np.fill_diagonal(shifted, shifted.diagonal() + 1.0)
    factors = scipy.linalg.cho_factor(shifted, overwrite_a=True, check_finite=False)
    return after, known, scipy.linalg.cho_solve(factors, slope, check_finite=False)


def measure(effort: Effort) -> Iterator[Finding]:
    """Information, rows and slope in; information, z and step out."""
    for (k, r), goal in SIZES.items():
        rng = np.random.default_rng(k)
        root, rows, (known, slope) = rng.normal(size=(k, k)), rng.normal(size=(r, k)), rng.normal(size=(2, k))
        A, upper = root @ root.T, np.triu_indices(k)
        entries, flat = A[upper], rows.ravel()
        kernel = compile_function(
            ours, {"information": len(entries), "known": k, "rows": r * k, "slope": k}, name="learn"
        )
        found, expected = kernel(entries, known, flat, slope), theirs(A, known, rows, slope)
        apart = np.concatenate([found[0] - expected[0][upper], found[1] - expected[1], found[2] - expected[2]])
        what = f"algebra of composite learning, {k} parameters of {r} joints"
        yield Agreement(what, "NumPy and LAPACK", float(np.abs(apart).max() / np.abs(A).max()), 1e-10)
        raced = race(
            {
                "ours": Statement("kernel(entries, known, flat, slope)", locals()),
                "theirs": Statement("theirs(A, known, rows, slope)", {**locals(), "theirs": theirs}),
            },
            effort,
        )
        yield Speedup.of(what, "NumPy and LAPACK", raced, "ours", "theirs", goal)
