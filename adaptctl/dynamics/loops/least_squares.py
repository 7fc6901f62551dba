"""Small dense systems over scalars of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from adaptctl.scalars import Column, Scalar


class System(Protocol):
    """Protocol of a linear system A x = b whose matrix A (m, n), m >= n, is ready to be solved for any right side b: an
    implementation gives `solve`."""

    def solve(self, right: Column) -> Column:
        """The solution x (n,) of A x = b, A (m, n) having m rows and n columns, for a right side b (m,), `right`, in
        the unit of b over that of A. An implementation returns the least-squares solution where there are more rows
        than columns, and raises `ValueError` for a b of another length."""
        ...


def factored(columns: Sequence[Column]) -> System:
    """A linear system A x = b ready to be solved for any b, from the n `columns` (m,) of its matrix A (m, n), m >= n: a
    2 x 2 matrix by Cramer's rule (`TwoByTwo`), others by their QR factors (`Factored`). Exactly dependent columns raise
    `ZeroDivisionError` in floats and give infinity or NaN in arrays."""
    if len(columns) == 2 and len(columns[0]) == 2:
        return TwoByTwo(columns)
    return Factored(columns)


class TwoByTwo:
    """A linear system A x = b of a matrix A (2, 2), solved by Cramer's rule with one division. Made of the two
    `columns` (2,) of A. A matrix of determinant zero raises `ZeroDivisionError` in floats and gives infinity or NaN in
    arrays; another number of columns or entries raises `ValueError`."""

    def __init__(self, columns: Sequence[Column]) -> None:
        (a, c), (b, d) = columns
        inverse = 1.0 / (a * d - b * c)
        self.rows = Column((inverse * d, -(inverse * b))), Column((-(inverse * c), inverse * a))

    def solve(self, right: Column) -> Column:
        """The solution x (2,) of A x = b for a right side b (2,), `right`, in the unit of b over that of A. Raises
        `ValueError` for a b of another length."""
        return Column(row @ right for row in self.rows)


class Factored:
    """A QR factorisation A = Q R of a matrix A (m, n), m >= n, by modified Gram-Schmidt without pivoting, so that no
    code branches on a value. Made of the n `columns` (m,) of A.

    The columns of Q are orthogonal but are not made unit vectors, and R has ones on its diagonal: so there are no
    square roots, and one division a column. Exactly dependent columns raise `ZeroDivisionError` in floats and give
    infinity or NaN in arrays; columns of different lengths raise `ValueError`.
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
        """The solution x (n,) of A x = b, A (m, n) having m rows and n columns, for a right side b (m,), `right`, in
        the unit of b over that of A, by the factorisation A = Q R and back substitution; the least-squares solution
        where m > n. For accuracy b is made orthogonal to the columns of Q one after the other, as the columns of A
        were. Raises `ValueError` for a b of another length."""
        x: list[Scalar] = []
        for q, inverse in zip(self.q, self.inverse, strict=True):
            x.append(inverse * (q @ right))
            right = right - x[-1] * q
        for k in reversed(range(len(x))):
            for i in range(k):
                x[i] = x[i] - self.r[k][i] * x[k]
        return Column(x)
