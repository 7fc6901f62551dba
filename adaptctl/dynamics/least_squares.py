"""Small dense systems over scalars of any kind."""

from __future__ import annotations

from collections.abc import Sequence

from adaptctl.scalars import Column, Scalar, sqrt


class Factored:
    """A = Q R by modified Gram-Schmidt: no pivots to choose, so nothing branches on a value."""

    def __init__(self, columns: Sequence[Column]) -> None:
        self.q: list[Column] = []
        self.r: list[list[Scalar]] = []
        for column in columns:
            above: list[Scalar] = []
            for q in self.q:
                above.append(q @ column)
                column = column - above[-1] * q
            norm = sqrt(column @ column)
            self.q.append((1.0 / norm) * column)
            self.r.append([*above, norm])

    def solve(self, right: Column) -> Column:
        """x with A x = b, by back substitution; b is deflated as the columns were, for accuracy."""
        x: list[Scalar] = []
        for q in self.q:
            x.append(q @ right)
            right = right - x[-1] * q
        for k in reversed(range(len(x))):
            x[k] = x[k] / self.r[k][k]
            for i in range(k):
                x[i] = x[i] - self.r[k][i] * x[k]
        return Column(x)
