"""Elimination in symmetric matrices, some rows together, in a machine's loops."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from adaptctl.compilation.loops import Interpreter

ROWS_AT_ONCE = 4
"""Rows that are computed together, since what they share is then read once."""


class Elimination:
    """Rows of U in U' D^-1 U (k, k), with right sides in columns beside it, and inverse pivots."""

    def __init__(self, m: Interpreter, k: int, beside: int) -> None:
        self.m, self.k, self.width = m, k, k + beside
        self.upper, self.inverse, self._smallest = m.scratch(k, self.width), m.scratch(k), m.scratch(k)

    def complete(self, i: Any, shift: Any) -> None:
        """Add to the diagonal of a row whose entries are there."""
        self.upper[i, i] = self.upper[i, i] + shift
        self._smallest[i] = self.k * float(np.finfo(np.float64).eps) * self.upper[i, i]

    def run(self) -> None:
        """Eliminate; pivots that rounding alone may have made positive count as infinite."""
        for rows in groups(self.m, self.k, ROWS_AT_ONCE):
            self._eliminate(rows)

    def solution(self) -> Any:
        """Solution (k + 1,) for the first right side, from the last entry to the first; then zero."""
        m, k = self.m, self.k
        x = m.scratch(k + 1)
        for rows in groups(m, k, ROWS_AT_ONCE, descending=True):
            totals = [m.sum() for _ in rows]
            for j in m.columns(rows[-1] + 1, k):
                known = x[j]
                for i, total in zip(rows, totals, strict=True):
                    total.add(j, self.upper[i, j] * known)
            found: dict[int, Any] = {}
            for c in reversed(range(len(rows))):
                left = self.upper[rows[c], k] - totals[c].value
                for b, entry in found.items():
                    left = left - self.upper[rows[c], rows[b]] * entry
                found[c] = left * self.inverse[rows[c]]
            for c, entry in found.items():
                x[rows[c]] = entry
        return x

    def _eliminate(self, rows: list[Any]) -> None:
        """Rows of U, less those before; row i of L' is row i of U over its pivot."""
        m, upper, count = self.m, self.upper, len(rows)
        factors = m.scratch(count, self.k)
        corner = [[m.variable(upper[i, j]) for j in rows[c:]] for c, i in enumerate(rows)]
        for p in m.range(rows[0]):
            above = [upper[p, j] for j in rows]
            for c, line in enumerate(corner):
                factor = above[c] * self.inverse[p]
                factors[c, p] = factor
                for entry, x in zip(line, above[c:], strict=True):
                    entry.value = entry.value - factor * x
        shares = self._eliminate_corner(rows, corner)
        for j in m.columns(rows[-1] + 1, self.width):
            entries = [m.variable(upper[i, j]) for i in rows]
            for p in m.range(rows[0]):
                x = upper[p, j]
                for c, entry in enumerate(entries):
                    entry.value = entry.value - factors[c, p] * x
            for (c, b), share in shares.items():
                entries[b].value = entries[b].value - share * entries[c].value
            for i, entry in zip(rows, entries, strict=True):
                upper[i, j] = entry.value
        for c, line in enumerate(corner):
            for j, entry in zip(rows[c:], line, strict=True):
                upper[rows[c], j] = entry.value

    def _eliminate_corner(self, rows: list[Any], corner: list[list[Any]]) -> dict[tuple[int, int], Any]:
        """Factors of row c in row b of the group, in order."""
        shares = {}
        for c, i in enumerate(rows):
            inverse = quotient(self.m, 1.0, corner[c][0].value, self._smallest[i])
            self.inverse[i] = inverse
            for b in range(c + 1, len(rows)):
                share = shares[c, b] = corner[c][b - c].value * inverse
                for entry, above in zip(corner[b], corner[c][b - c :], strict=True):
                    entry.value = entry.value - share * above.value
        return shares


def groups(m: Interpreter, count: int, size: int, *, descending: bool = False) -> Iterator[list[Any]]:
    """Numbers from 0 to `count`, some at once, each time ascending."""
    whole = count - count % size
    rest = [list(range(whole, count))] if count % size else []
    yield from rest if descending else ()
    for group in m.range(count // size):
        first = whole - size - size * group if descending else size * group
        yield [first + c for c in range(size)]
    yield from () if descending else rest


def quotient(m: Interpreter, x: Any, y: Any, smallest: Any) -> Any:
    """x/y, and 0 where y is not above the smallest."""
    return m.where_less(smallest, y, x / m.where_less(smallest, y, y, 1.0), 0.0)
