"""Determinants over scalars of any kind."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from adaptctl.scalars import Column, Scalar, absolute, where


def determinant(rows: Iterable[Column]) -> Scalar:
    """Determinant of a square matrix (n, n), given by its n `rows`, each a `Column` (n,), over scalars of any kind
    (floats, arrays, symbolic ones), by elimination with partial pivoting that does not branch on a value. It is in the
    product of the entries' units.

    Rows are exchanged with a change of sign of one, which keeps the determinant. Where a pivot but the last is zero,
    the result is NaN in arrays, and floats raise `ZeroDivisionError`. Rows of different lengths raise `ValueError`.
    """
    left, product = [list(row) for row in rows], 1.0
    while left:
        pivot, *others = left
        for i, row in enumerate(others):
            larger = absolute(row[0]) > absolute(pivot[0])
            others[i] = [where(larger, -x, y) for x, y in zip(pivot, row, strict=True)]
            pivot = [where(larger, y, x) for x, y in zip(pivot, row, strict=True)]
        product = product * pivot[0]
        left = [_eliminated(row, pivot) for row in others]
    return product


def _eliminated(row: list[Any], pivot: list[Any]) -> list[Any]:
    """A row without its first entry, which the pivot's takes away."""
    factor = row[0] / pivot[0]
    return [y - factor * x for x, y in zip(pivot[1:], row[1:], strict=True)]
