"""Small dense systems over scalars of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from adaptctl.scalars import Column, Scalar


class System(Protocol):
    """Protocol of a linear system with a matrix A, ready to be solved."""

    def solve(self, right: Column) -> Column:
        """The solution x (n,) of A x = b, or the nearest where there is none."""
        ...


def factored(columns: Sequence[Column]) -> System:
    """The linear system of a matrix's columns: two by two by its determinant, others by their QR factors."""
    if len(columns) == 2 and len(columns[0]) == 2:
        return TwoByTwo(columns)
    return Factored(columns)


class TwoByTwo:
    """A linear system of two rows and columns, solved by Cramer's rule: one division."""

    def __init__(self, columns: Sequence[Column]) -> None:
        (a, c), (b, d) = columns
        inverse = 1.0 / (a * d - b * c)
        self.rows = Column((inverse * d, -(inverse * b))), Column((-(inverse * c), inverse * a))

    def solve(self, right: Column) -> Column:
        """The solution x (2,) of A x = b."""
        return Column(row @ right for row in self.rows)


class Factored:
    """A QR factorisation A = Q R by modified Gram-Schmidt: no pivots to choose, so nothing branches on a value.

    Q's columns are orthogonal and keep their lengths, R has ones on its diagonal: so there are no roots, and one
    division a column.
    """

    def __init__(self, columns: Sequence[Column]) -> None:
        self.q: list[Column] = []
        self.r: list[list[Scalar]] = []
        self.inverse: list[Scalar] = []
        for column in columns:
            above: list[Scalar] = []
            for q, inverse in zip(self.q, self.inverse, strict=True):
                above.append(inverse * (q @ column))
                column = column - above[-1] * q
            self.q.append(column)
            self.r.append(above)
            self.inverse.append(1.0 / (column @ column))

    def solve(self, right: Column) -> Column:
        """The solution x (n,) of A x = b by back substitution; b is deflated as the columns were, for accuracy."""
        x: list[Scalar] = []
        for q, inverse in zip(self.q, self.inverse, strict=True):
            x.append(inverse * (q @ right))
            right = right - x[-1] * q
        for k in reversed(range(len(x))):
            for i in range(k):
                x[i] = x[i] - self.r[k][i] * x[k]
        return Column(x)
