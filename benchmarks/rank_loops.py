"""Four- and five-bars of the exact oracle, closed by the intersection of two circles."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from adaptctl.description import Closure, ClosureKind, Loops, Pose
from benchmarks.rank_field import FIELD, residue


@dataclass
class FiveBar:
    """Cranks l1 at the origin and l2 at (base, 0), or none there; rods l3 on the one, l4 on the other, that meet.

    Links from `first` on: crank 1, rod 3, then crank 2, if any, and rod 4. Of a parallelogram's two branches the
    parallel one is meant; otherwise both are one.
    """

    first: int
    lengths: tuple[Fraction, Fraction, Fraction, Fraction]
    base: Fraction
    cranks: int
    parallel: bool
    reference: dict[str, float]

    def loops(self, scale: float) -> Loops:
        """The closure, with the reference."""
        last = self.first + (3 if self.cranks == 2 else 2)
        ends = [Pose(np.eye(3), np.array([float(x) * scale, 0.0, 0.0])) for x in self.lengths[2:]]
        closure = Closure("loop", f"link{self.first + 2}", f"link{last + 1}", *ends, ClosureKind.POINT)
        free = [f"joint{i + 1}" for i in range(self.first)] + [f"joint{self.first + 1}"]
        free += [f"joint{self.first + 3}"] if self.cranks == 2 else []
        return Loops(tuple(free), (closure,), (), self.reference)

    def closed(self, turns: list[Any], v: list[Any], rng: np.random.Generator) -> tuple[list[Any], list[Any]]:
        """Rods' turns and rates from the cranks'; cranks are drawn anew where the circles do not meet in the field."""
        k, samples = self.first, len(v[0])
        turns, v = list(turns), list(v)
        l1, l2, l3, l4 = map(residue, self.lengths)
        base = residue(self.base)
        rows = [self._one(turns, v, i, (l1, l2, l3, l4, base), rng) for i in range(samples)]
        places = [k, k + 1, k + 2] + ([k + 3] if self.cranks == 2 else [])
        for j, place in enumerate(places):
            turns[place] = tuple(np.array([row[j][m] for row in rows], dtype=object) for m in range(2))
            v[place] = np.array([row[j][2] for row in rows], dtype=object)
        return turns, v

    def _one(
        self, turns: list[Any], v: list[Any], i: int, lengths: tuple[int, ...], rng: np.random.Generator
    ) -> list[Any]:
        l1, l2, l3, l4, base = lengths
        p, k, two = FIELD, self.first, self.cranks == 2
        while True:
            (c1, s1), (c2, s2) = (_one_circle(rng) for _ in range(2))
            w1, w2 = int(v[k][i]), int(v[k + 2][i]) if two else 0
            B = (l1 * c1 % p, l1 * s1 % p)
            C = ((base + l2 * c2) % p, l2 * s2 % p) if two else (base, 0)
            d = ((C[0] - B[0]) % p, (C[1] - B[1]) % p)
            square = (d[0] * d[0] + d[1] * d[1]) % p
            if square == 0:
                continue
            a = (l3 * l3 - l4 * l4 + square) * pow(2 * square, -1, p) % p
            if self.parallel:
                P = ((C[0] + B[0]) % p, (C[1] + B[1]) % p) if two else ((B[0] + base) % p, B[1])
            else:
                height = (l3 * l3 - a * a * square) * pow(square, -1, p) % p
                if height == 0 or pow(height, (p - 1) // 2, p) != 1:
                    continue
                h = pow(height, (p + 1) // 4, p)
                P = ((B[0] + a * d[0] - h * d[1]) % p, (B[1] + a * d[1] + h * d[0]) % p)
            e = [
                ((P[0] - start[0]) * pow(x, -1, p) % p, (P[1] - start[1]) * pow(x, -1, p) % p)
                for start, x in ((B, l3), (C, l4))
            ]
            # l1 w1 n1 + l3 w3 n3 = l2 w2 n2 + l4 w4 n4, n across each bar: two equations for w3 and w4.
            r = [(-l1 * w1 * s1 + l2 * w2 * s2) % p, (l1 * w1 * c1 - l2 * w2 * c2) % p]
            A = [[-l3 * e[0][1], l4 * e[1][1]], [l3 * e[0][0], -l4 * e[1][0]]]
            det = (A[0][0] * A[1][1] - A[0][1] * A[1][0]) % p
            if det == 0:
                continue
            over = pow(det, -1, p)
            w3 = (-r[0] * A[1][1] + r[1] * A[0][1]) * over % p
            w4 = (-A[0][0] * r[1] + A[1][0] * r[0]) * over % p
            rod = (*_less(e[0], (c1, s1)), (w3 - w1) % p)
            if not two:
                return [(c1, s1, w1), rod, (*e[1], w4)]
            return [(c1, s1, w1), rod, (c2, s2, w2), (*_less(e[1], (c2, s2)), (w4 - w2) % p)]


def _one_circle(rng: np.random.Generator) -> tuple[int, int]:
    t = int(rng.integers(1, FIELD))
    over = pow(1 + t * t, -1, FIELD)
    return (1 - t * t) * over % FIELD, 2 * t * over % FIELD


def _less(one: tuple[int, int], other: tuple[int, int]) -> tuple[int, int]:
    """The angle from the other direction to the one."""
    (a, b), (c, d) = one, other
    return (a * c + b * d) % FIELD, (b * c - a * d) % FIELD


def crank(length: float, angle: float) -> complex:
    """The end of a crank."""
    return complex(length * np.exp(1j * angle))


def branch(first: int, bars: tuple[float, ...], base: float, cranks: int, parallel: bool) -> dict[str, float]:
    """Joint angles of the branch that is meant."""
    a1, a2 = 1.1, 2.4 if cranks == 2 else 0.0
    B = crank(bars[0], a1)
    C = base + (crank(bars[1], a2) if cranks == 2 else 0.0)
    d = C - B
    a = (bars[2] ** 2 - bars[3] ** 2 + abs(d) ** 2) / (2 * abs(d) ** 2)
    h = np.sqrt(max(bars[2] ** 2 / abs(d) ** 2 - a * a, 0.0))
    meant = (B + C if cranks == 2 else B + base) if parallel else None
    P = min((B + d * (a + s * 1j * h) for s in (1, -1)), key=lambda z: abs(z - meant) if meant is not None else -z.imag)
    angles = [a1, np.angle((P - B) / np.exp(1j * a1)), a2, np.angle((P - C) / np.exp(1j * a2))]
    if cranks == 1:
        angles = [*angles[:2], angles[3]]
    return {f"joint{first + 1 + i}": float(x) for i, x in enumerate(angles)}
