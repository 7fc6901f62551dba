"""Ranks and independent columns over the prime field, by Gaussian elimination."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptctl.identifiability.proof.prime_field import PRIME, Residues, inverse


def independent_columns(matrix: Residues, order: Sequence[int]) -> tuple[int, ...]:
    """The zero-based indices of those columns of a `matrix` (m, n) of m rows and n columns that are independent of the
    columns before them in an `order` of column indices, given in that order. The matrix is of residues modulo the prime
    2^31 - 1, int64 in 0..2^31 - 2; with all n in the order the indices are as many as the rank. Raises `IndexError` for
    an index of n or more."""
    left = matrix[:, list(order)]
    found: list[int] = []
    for place, column in enumerate(order):
        pivot = np.flatnonzero(left[:, place])[:1]
        if len(pivot):
            left = _eliminated(left, int(pivot[0]), place)
            found.append(column)
        if not len(left):
            break
    return tuple(found)


def rank(matrix: Residues) -> int:
    """The rank, over the field of residues modulo the prime 2^31 - 1, of a `matrix` (m, n) of m rows and n columns of
    these, int64 in 0..2^31 - 2, by Gaussian elimination. Nothing is checked."""
    return len(independent_columns(matrix, range(matrix.shape[1])))


def _eliminated(left: Residues, pivot: int, place: int) -> Residues:
    """The other rows, less as much of the pivot's that their entries from its column on lose that column."""
    row = left[pivot] * inverse(int(left[pivot, place])) % PRIME
    left[pivot] = left[0]
    rest = left[1:]
    rest[:, place:] = (rest[:, place:] - rest[:, place, None] * row[place:]) % PRIME
    return rest


def ranks(matrices: Residues) -> tuple[int, ...]:
    """The ranks (N,), over the field of residues modulo the prime 2^31 - 1, of N small `matrices` (N, m, n), of m rows
    and n columns each, of these, int64 in 0..2^31 - 2, by Gaussian elimination of all at once. Nothing is checked."""
    left, many = matrices.copy(), np.arange(len(matrices))
    found = np.zeros(len(matrices), dtype=np.int64)
    for place in range(matrices.shape[2]):
        candidates = (left[:, :, place] != 0) & (np.arange(matrices.shape[1]) >= found[:, None])
        pivot = candidates.argmax(axis=1)
        has = candidates[many, pivot]
        top = np.minimum(found, matrices.shape[1] - 1)
        row = left[many, pivot]
        left[many, pivot] = np.where(has[:, None], left[many, top], row)
        scaled = row * inverse(np.where(has, row[:, place], 1))[:, None] % PRIME
        left[many, top] = np.where(has[:, None], scaled, left[many, top])
        below = np.where(np.arange(matrices.shape[1]) > top[:, None], left[:, :, place], 0) * has[:, None]
        left = (left - below[:, :, None] * scaled[:, None, :]) % PRIME
        found += has
    return tuple(found.tolist())
