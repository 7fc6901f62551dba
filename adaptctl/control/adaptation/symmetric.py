"""Dense algebra of symmetric matrices, given by their upper triangles row by row."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation.loops import Interpreter, Shape, Triangle, matrix, vector
from adaptctl.compilation.matrix_operation import MatrixOperation
from adaptctl.control.adaptation.elimination import ROWS_AT_ONCE, Elimination, groups, quotient
from adaptctl.scalars import Column, Scalar


def first_triangle(k: int) -> Array:
    """Upper triangle of the identity, row by row."""
    return np.eye(k)[np.triu_indices(k)]


def from_triangle(entries: Array, k: int) -> Array:
    """Symmetric matrix of an upper triangle's entries."""
    upper = np.zeros((k, k))
    upper[np.triu_indices(k)] = np.reshape(entries, k * (k + 1) // 2)
    return upper + np.triu(upper, 1).T


def symmetric_trace(entries: Column, k: int) -> Scalar:
    """Trace of a symmetric matrix."""
    triangle = Triangle(k)
    diagonal = [entries[triangle.row(i) + i] for i in range(k)]
    return sum(diagonal[1:], diagonal[0])


def symmetric_product(entries: Column, x: Column) -> Column:
    """Product A x of a symmetric matrix and a vector."""
    return _product(len(x))(entries, x)[0]


def rows_product(rows: Sequence[Column], x: Column) -> Column:
    """Product A x of a symmetric matrix, all rows of which are given, and a vector."""
    return _rows_product(len(x))(joined(rows), x)[0]


def solve(entries: Column, right: Column, shift: float = 0.0) -> Column:
    """Solution x of (A + shift 1) x = b, with 0 along pivots that rounding alone may have made positive."""
    return _solver(len(right))(entries, right, Column((shift,)))[0]


def scaled(entries: Column, factor: Scalar) -> Column:
    """Product of a factor and a matrix."""
    return _scaler(len(entries))(entries, Column((factor,)))[0]


def rank_update(entries: Column, rows: Sequence[Column], weights: Column, keep: Scalar, diagonal: Scalar) -> Column:
    """Upper triangle of keep (A + diagonal 1) + W' diag(weights) W, of the rows of W."""
    return _rank_updater(len(rows[0]), len(rows))(entries, joined(rows), weights, Column((keep, diagonal)))[0]


class Equation(NamedTuple):
    """
    Equation row'x = target, and what A loses and gains by it.

    A loses l g g', g = A row, l = forgotten/(row'g + floor), and gains learned row row'. Of a vector z it is
    z - l (row'z - target) g + gained row.
    """

    row: Column
    forgotten: Scalar
    floor: Scalar
    target: Scalar = 0.0
    learned: Scalar = 0.0
    gained: Scalar = 0.0


def directional_update(
    entries: Column, z: Column, equations: Sequence[Equation], keep: Scalar = 1.0
) -> tuple[Column, Column]:
    """keep A and z after equations, one after the other."""
    rows, *shares = zip(*equations, strict=True)
    forgets_only = all(isinstance(one.learned, float) and one.learned == 0.0 for one in equations)
    update = _updater(len(z), len(rows), learns=not forgets_only)
    A, after = update(entries, z, joined(rows), *map(Column, shares), Column((keep,)))
    return A, after


def joined(rows: Sequence[Column]) -> Column:
    """Rows of a matrix, one after the other."""
    return Column(x for row in rows for x in row)


@cache
def _scaler(size: int) -> MatrixOperation:
    def scaled(m: Interpreter, A: Any, factor: Any, out: Any) -> None:
        for j in m.columns(0, size):
            out[j] = factor[0] * A[j]

    return MatrixOperation(scaled, [vector(size), vector(1)], [vector(size)], math.isqrt(2 * size))


@cache
def _product(k: int) -> MatrixOperation:
    def symmetric_product(m: Interpreter, A: Any, x: Any, out: Any) -> None:
        full, right, y = _symmetric(m, A, k, 1.0), copied(m, x, 1, k), m.scratch(1, k)
        _multiply(m, full, right, y, 1, k)
        for j in m.columns(0, k):
            out[j] = y[0, j]

    return MatrixOperation(symmetric_product, [Triangle(k), matrix(1, k)], [vector(k)], k)


@cache
def _rows_product(k: int) -> MatrixOperation:
    def rows_product(m: Interpreter, A: Any, x: Any, out: Any) -> None:
        y = m.scratch(1, k)
        _multiply(m, A, copied(m, x, 1, k), y, 1, k)
        for j in m.columns(0, k):
            out[j] = y[0, j]

    return MatrixOperation(rows_product, [matrix(k, k), matrix(1, k)], [vector(k)], k)


@cache
def _solver(k: int) -> MatrixOperation:
    def symmetric_solve(m: Interpreter, A: Any, b: Any, shift: Any, out: Any) -> None:
        system = Elimination(m, k, 1)
        for i in m.range(k):
            for j in m.columns(i, k):
                system.upper[i, j] = A[i, j]
            system.upper[i, k] = b[i]
            system.complete(i, shift[0])
        system.run()
        x = system.solution()
        for j in m.columns(0, k):
            out[j] = x[j]

    return MatrixOperation(symmetric_solve, [Triangle(k), vector(k), vector(1)], [vector(k)], k)


@cache
def _rank_updater(k: int, r: int) -> MatrixOperation:
    def rank_update(m: Interpreter, A: Any, rows: Any, weights: Any, scales: Any, out: Any) -> None:
        w, gains, line = copied(m, rows, r, k), m.scratch(r), m.scratch(k)
        for i in m.range(k):
            for j in m.columns(i, k):
                line[j] = scales[0] * A[i, j]
            line[i] = scales[0] * (A[i, i] + scales[1])
            for q in m.range(r):
                gains[q] = weights[q] * w[q, i]
            for j in m.columns(i, k):
                entry = m.variable(line[j])
                for q in m.range(r):
                    entry.value = entry.value + gains[q] * w[q, j]
                line[j] = entry.value
            for j in m.columns(i, k):
                out[i, j] = line[j]

    return MatrixOperation(rank_update, [Triangle(k), matrix(r, k), vector(r), vector(2)], [Triangle(k)], k)


@cache
def _updater(k: int, r: int, *, learns: bool) -> MatrixOperation:
    def directional_update(
        m: Interpreter, A: Any, z: Any, rows: Any, forgotten: Any, floor: Any, target: Any, learned: Any, gained: Any,
        keep: Any, A_out: Any, z_out: Any,
    ) -> None:  # fmt: skip
        """All g = A w first of the A before; then each loses and gains what A does by the equations before it."""
        full, w, x = _symmetric(m, A, k, keep[0]), copied(m, rows, r, k), copied(m, z, 1, k)
        g, lost = m.scratch(r, k), m.scratch(r)
        change = Change(m, g, w, m.scratch(ROWS_AT_ONCE, r), m.scratch(ROWS_AT_ONCE, r) if learns else None, learns)
        _multiply(m, full, w, g, r, k)
        for q in m.range(r):
            for p in m.range(q):
                along, *beside = dots(m, [(g, p), (w, p)][: 1 + learns], w, q, k)
                change.losses[0, p] = lost[p] * along
                if learns:
                    change.gains[0, p] = learned[p] * beside[0]
            change.apply(g, [q], q, 0, k)
            power, known = dots(m, [(g, q), (x, 0)], w, q, k)
            lost[q] = forgotten[q] * quotient(m, 1.0, power + floor[q], 0.0)
            excess = lost[q] * (known - target[q])
            for j in m.columns(0, k):
                x[0, j] = x[0, j] - excess * g[q, j] + gained[q] * w[q, j]
        for rows_ in groups(m, k, ROWS_AT_ONCE):
            for q in m.range(r):
                for c, i in enumerate(rows_):
                    change.losses[c, q] = lost[q] * g[q, i]
                    if learns:
                        change.gains[c, q] = learned[q] * w[q, i]
            change.apply(full, rows_, r, rows_[0], k)
        for i in m.range(k):
            for j in m.columns(i, k):
                A_out[i, j] = full[i, j]
        for j in m.columns(0, k):
            z_out[j] = x[0, j]

    given: list[Shape] = [Triangle(k), matrix(1, k), matrix(r, k), *[vector(r)] * 5, vector(1)]
    return MatrixOperation(directional_update, given, [Triangle(k), vector(k)], k)


class Change(NamedTuple):
    """Losses of rows along g and gains along w, by equations."""

    m: Interpreter
    g: Any
    w: Any
    losses: Any
    gains: Any
    learns: bool

    def apply(self, out: Any, rows: list[Any], equations: Any, first: Any, k: int) -> None:
        """Change columns of some rows by the first equations."""
        for j in self.m.columns(first, k):
            entries = [self.m.variable(out[i, j]) for i in rows]
            for q in self.m.range(equations):
                g, w = self.g[q, j], self.w[q, j] if self.learns else None
                for c, entry in enumerate(entries):
                    less = entry.value - self.losses[c, q] * g
                    entry.value = less + self.gains[c, q] * w if self.learns else less
            for i, entry in zip(rows, entries, strict=True):
                out[i, j] = entry.value


def _symmetric(m: Interpreter, A: Any, k: int, keep: Any) -> Any:
    """Whole matrix keep A."""
    full = m.scratch(k, k)
    for i in m.range(k):
        for j in m.columns(i, k):
            full[i, j] = keep * A[i, j]
    for rows in groups(m, k, ROWS_AT_ONCE):  # what they take of a row above lies together
        for j in m.range(rows[-1]):
            for i in rows:
                full[i, j] = full[j, i]
    return full


def copied(m: Interpreter, rows: Any, r: int, k: int) -> Any:
    """Copy (r, k) of an array in scratch memory."""
    copy = m.scratch(r, k)
    for q in m.range(r):
        for j in m.columns(0, k):
            copy[q, j] = rows[q, j]
    return copy


def _multiply(m: Interpreter, full: Any, w: Any, out: Any, r: int, k: int) -> None:
    """Products of a symmetric matrix and rows, each a sum over the matrix's rows in order."""
    for rows in groups(m, r, ROWS_AT_ONCE):
        for j in m.columns(0, k):
            totals = [m.variable(0.0) for _ in rows]
            for i in m.range(k):
                entry = full[i, j]
                for q, total in zip(rows, totals, strict=True):
                    total.value = total.value + w[q, i] * entry
            for q, total in zip(rows, totals, strict=True):
                out[q, j] = total.value


def dots(m: Interpreter, rows: list[tuple[Any, Any]], b: Any, q: Any, k: int) -> list[Any]:
    """Inner products of rows of arrays and row q of b."""
    totals = [m.sum() for _ in rows]
    for j in m.columns(0, k):
        for total, (array, p) in zip(totals, rows, strict=True):
            total.add(j, array[p, j] * b[q, j])
    return [total.value for total in totals]
