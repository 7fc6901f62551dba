"""Rates of dependent joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from adaptctl.dynamics.loops.constraint import Closing
from adaptctl.dynamics.recursion.segment import Placement
from adaptctl.scalars import Column, Scalar


class System(Protocol):
    """Linear system A x = b, factored."""

    def solve(self, right: Column) -> Column:
        """Solution x (n,) for a right side b (m,)."""
        ...


def factored(columns: Sequence[Column]) -> System:
    """System A x = b by Cramer's rule or QR."""
    if len(columns) == 2 and len(columns[0]) == 2:
        return TwoByTwo(columns)
    return Factored(columns)


class TwoByTwo:
    """System of two unknowns by Cramer's rule."""

    def __init__(self, columns: Sequence[Column]) -> None:
        (a, c), (b, d) = columns
        inverse = 1.0 / (a * d - b * c)
        self.rows = Column((inverse * d, -(inverse * b))), Column((-(inverse * c), inverse * a))

    def solve(self, right: Column) -> Column:
        """Solution x (2,) of A x = b."""
        return Column(row @ right for row in self.rows)


class Factored:
    """QR factors by modified Gram-Schmidt without branches."""

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
        """Solution x (n,), by least squares for m > n."""
        x: list[Scalar] = []
        for q, inverse in zip(self.q, self.inverse, strict=True):
            x.append(inverse * (q @ right))
            right = right - x[-1] * q
        for k in reversed(range(len(x))):
            for i in range(k):
                x[i] = x[i] - self.r[k][i] * x[k]
        return Column(x)


class Following:
    """Jacobian J (n, r) of all joints by the primary ones."""

    def __init__(self, closing: Closing, slopes: Sequence[Column]) -> None:
        self.closing, self.slopes = closing, slopes

    def tree(self, v: Column) -> Column:
        """Velocities J v (n,) of the tree's joints."""
        follow = v[0] * self.slopes[0]
        for rate, slope in zip(v.of[1:], self.slopes[1:], strict=True):
            follow = follow + rate * slope
        return self.joined(v, follow)

    def primary(self, torque: Sequence[Any] | Column) -> Column:
        """Torques J' tau (r,) equivalent to tau (n,)."""
        follow = Column(torque[d] for d in self.closing.dependent)
        pairs = zip(self.closing.primary, self.slopes, strict=True)
        return Column(torque[i] + slope @ follow for i, slope in pairs)

    def joined(self, first: Column, follow: Column) -> Column:
        """Column (n,) merged from primary and dependent joints."""
        entries = dict(zip(self.closing.primary, first, strict=True))
        entries |= dict(zip(self.closing.dependent, follow, strict=True))
        return Column(entries[i] for i in range(len(entries)))


class Posture(Following):
    """Closed configuration with closure Jacobian and Jacobian J."""

    def __init__(self, closing: Closing, places: Sequence[Placement]) -> None:
        columns = closing.jacobian(places)
        self.places, self.factor = places, factored([columns[d] for d in closing.dependent])
        super().__init__(closing, [self.factor.solve(-columns[i]) for i in closing.primary])

    def bias(self, u: Column, w: Column) -> Column:
        """Velocity terms J_dot v_r (n,) of the accelerations."""
        follow = -self.factor.solve(self.closing.bias(self.places, u, w))
        return self.joined(Column.zeros(len(self.closing.primary)), follow)
