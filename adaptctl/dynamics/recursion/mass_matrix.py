"""Mass matrix by composite bodies (Walker and Orin 1982)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from adaptctl.dynamics.recursion.frame_choice import held_parameters
from adaptctl.dynamics.recursion.motion import GROUND
from adaptctl.dynamics.recursion.newton_euler import Wrench, joint_power, lifted
from adaptctl.dynamics.recursion.segment import Placement, symmetric_up
from adaptctl.scalars import Column, Mat, Scalar, Vec, cross


class Body:
    """Rigid body by mass, first moment and inertia tensor."""

    __slots__ = ("inertia", "mass", "moment")

    def __init__(self, mass: Scalar, moment: Vec, inertia: Mat) -> None:
        self.mass, self.moment, self.inertia = mass, moment, inertia

    def __add__(self, other: Body) -> Body:
        return Body(self.mass + other.mass, self.moment + other.moment, self.inertia + other.inertia)


def body(ten: Sequence[Scalar]) -> Body:
    """Rigid body from ten inertial parameters."""
    m, x, y, z, xx, xy, yy, xz, yz, zz = ten
    return Body(m, Vec(x, y, z), Mat(Vec(xx, xy, xz), Vec(xy, yy, yz), Vec(xz, yz, zz)))


def raised(place: Placement, link: Body) -> Body:
    """Rigid body in the parent link's frame."""
    at_joint = moved_origin(link, place.shift)
    turned = Body(link.mass, place.up(at_joint.moment), symmetric_up(place, at_joint.inertia))
    return moved_origin(turned, place.near)


def moved_origin(link: Body, offset: Vec) -> Body:
    """Rigid body about another point."""
    half = link.moment + (0.5 * link.mass) * offset
    twice = 2.0 * half
    spread = Vec(offset.x * twice.x, offset.y * twice.y, offset.z * twice.z)

    def product(i: str, j: str) -> Scalar:
        return getattr(offset, i) * getattr(half, j) + getattr(offset, j) * getattr(half, i)

    xy, xz, yz = product("x", "y"), product("x", "z"), product("y", "z")
    a = link.inertia
    inertia = Mat(
        Vec(a.x.x + spread.y + spread.z, a.x.y - xy, a.x.z - xz),
        Vec(a.x.y - xy, a.y.y + spread.x + spread.z, a.y.z - yz),
        Vec(a.x.z - xz, a.y.z - yz, a.z.z + spread.x + spread.y),
    )
    return Body(link.mass, link.moment + link.mass * offset, inertia)


def mass_matrix(places: Sequence[Placement], parameters: Column) -> list[list[Scalar]]:
    """Mass matrix (n, n) by composite rigid bodies."""
    n = len(places)
    composite = [body(held_parameters(places[i], parameters.of[10 * i : 10 * i + 10])) for i in range(n)]
    rows: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    for i in reversed(range(n)):
        for j, entry in _column(places, i, composite[i]):
            rows[i][j] = rows[j][i] = entry
        parent = places[i].segment.parent
        if parent != GROUND:
            composite[parent] += raised(places[i], composite[i])
    return rows


def _column(places: Sequence[Placement], i: int, outboard: Body) -> list[tuple[int, Scalar]]:
    load = _unit_load(places[i], outboard)
    entries, j = [(i, joint_power(places[i], load))], i
    while (parent := places[j].segment.parent) != GROUND:
        load = lifted(places[j], load)
        j = parent
        entries.append((j, joint_power(places[j], load)))
    return entries


def _unit_load(place: Placement, outboard: Body) -> Wrench:
    z = place.segment.axis
    if not place.segment.turns:
        return Wrench(outboard.mass * z, cross(outboard.moment, z))
    acc = cross(z, place.shift)
    return Wrench(outboard.mass * acc + cross(z, outboard.moment), outboard.inertia @ z + cross(outboard.moment, acc))


def solve_symmetric(rows: Sequence[Sequence[Scalar]], right: Column) -> Column:
    """Solution x (n,) of M x = b, M positive definite."""
    return factorised(rows).solved(right)


class Factors(NamedTuple):
    """Factors of M = L' D L."""

    lower: Sequence[Sequence[Scalar]]
    inverse: Sequence[Scalar]
    pivots: Sequence[Scalar]

    def solved(self, right: Column) -> Column:
        """Solution x (n,) of M x = b."""
        n, x, lower = len(right), list(right), self.lower
        for k in reversed(range(n)):
            for i in range(k):
                x[i] = x[i] - lower[k][i] * x[k]
        x = [entry * d for entry, d in zip(x, self.inverse, strict=True)]
        for k in range(n):
            for i in range(k):
                x[k] = x[k] - lower[k][i] * x[i]
        return Column(x)


def factorised(rows: Sequence[Sequence[Scalar]]) -> Factors:
    """Factors of a positive definite matrix M = L' D L."""
    n = len(rows)
    m = [list(row) for row in rows]
    inverse: list[Scalar] = [0.0] * n
    lower: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    for k in reversed(range(n)):
        inverse[k] = 1.0 / m[k][k]
        for i in range(k):
            lower[k][i] = m[k][i] * inverse[k]
            for j in range(i + 1):
                m[i][j] = m[i][j] - lower[k][i] * m[k][j]
    return Factors(lower, inverse, [m[k][k] for k in range(n)])
