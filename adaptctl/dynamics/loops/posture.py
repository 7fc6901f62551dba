"""Rates of dependent joints by primary ones at a closed configuration, and the small systems that give them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from adaptctl.dynamics.loops.constraint import Closing
from adaptctl.dynamics.recursion.segment import Placement
from adaptctl.scalars import Column, Scalar


class System(Protocol):
    """Protocol of a linear system A x = b whose matrix A (m, n), m >= n, is ready to be solved for any right side b."""

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
    """A linear system A x = b of a matrix A (2, 2), solved by Cramer's rule with one division."""

    def __init__(self, columns: Sequence[Column]) -> None:
        (a, c), (b, d) = columns
        inverse = 1.0 / (a * d - b * c)
        self.rows = Column((inverse * d, -(inverse * b))), Column((-(inverse * c), inverse * a))

    def solve(self, right: Column) -> Column:
        """The solution x (2,) of A x = b for a right side b (2,), `right`, in the unit of b over that of A."""
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


class Following:
    """The Jacobian J (n, r) of a tree's n joint positions with respect to the r primary ones at a closed configuration
    of its loops, with methods that map velocities and torques by it.

    Made of `closing`, which has the indices of primary and dependent joints, and `slopes`, for each primary joint a
    `Column` (n - r,) of the derivatives of the dependent joints by it, rad or m per rad or m. Nothing is checked.
    """

    def __init__(self, closing: Closing, slopes: Sequence[Column]) -> None:
        self.closing, self.slopes = closing, slopes

    def tree(self, v: Column) -> Column:
        """Velocities J v (n,) of the tree's joints, from those of the r primary ones, v (r,)."""
        follow = v[0] * self.slopes[0]
        for rate, slope in zip(v.of[1:], self.slopes[1:], strict=True):
            follow = follow + rate * slope
        return self.joined(v, follow)

    def primary(self, torque: Sequence[Any] | Column) -> Column:
        """Torques J' tau (r,) of the r primary (independent) joints, N m (N if prismatic), that do the same work as
        torques tau (n,), `torque`, of all n joints of the spanning tree. J' is the transpose of the Jacobian J (n, r)
        of the joints' positions with respect to the primary ones. Arguments are not checked: too short a tau raises
        `IndexError`."""
        follow = Column(torque[d] for d in self.closing.dependent)
        pairs = zip(self.closing.primary, self.slopes, strict=True)
        return Column(torque[i] + slope @ follow for i, slope in pairs)

    def joined(self, first: Column, follow: Column) -> Column:
        """A `Column` (n,) of one entry for each of the n joints of the spanning tree, in the tree's order, merged from
        those of the r primary joints, `first` (r,), and of the dependent ones, `follow` (n - r,). Each is in the order
        of the joints' indices in this object's `closing`. Raises `ValueError` for another number of either."""
        entries = dict(zip(self.closing.primary, first, strict=True))
        entries |= dict(zip(self.closing.dependent, follow, strict=True))
        return Column(entries[i] for i in range(len(entries)))


class Posture(Following):
    """A closed configuration of a tree with loops, with the closure Jacobian with respect to the dependent joints
    factored once, and the Jacobian J (n, r) of all n joints with respect to the r primary ones.

    Made of `closing`, the closure conditions, and `places`, the n links' placements at that configuration. At an exact
    singularity of the loops, where the primary joints do not determine the others, it raises `ZeroDivisionError` in
    floats and has infinity or NaN in arrays.
    """

    def __init__(self, closing: Closing, places: Sequence[Placement]) -> None:
        columns = closing.jacobian(places)
        self.places, self.factor = places, factored([columns[d] for d in closing.dependent])
        super().__init__(closing, [self.factor.solve(-columns[i]) for i in closing.primary])

    def bias(self, u: Column, w: Column) -> Column:
        """The velocity terms J_dot v_r (n,) of the accelerations of the tree's joints, zero for the r primary ones."""
        follow = -self.factor.solve(self.closing.bias(self.places, u, w))
        return self.joined(Column.zeros(len(self.closing.primary)), follow)
