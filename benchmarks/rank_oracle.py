"""Random mechanisms whose ranks are known exactly, by another way than the package's.

Everything is drawn in fractions: a mechanism's links stand at rational places, turned by rational angles. Its energies
are those of pseudo-inertias, (tr(T' J T'^T) - 2 g T J e4) / 2 with T (4, 4), over the prime field of 2^61 - 1, at
random states; loops are closed by the intersection of two circles. Nothing of the package's equations is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from adaptctl.description import Description, Joint, JointKind, Link, Loops, Pose
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism
from benchmarks.rank_field import FIELD, circle, residue
from benchmarks.rank_gears import Gear, Shaft, followed, rotor_energies
from benchmarks.rank_loops import FiveBar, branch, crank

Matrix = list[list[Fraction]]
RIGHT = (Fraction(0), Fraction(1))
"""Cosine and sine of a right angle."""


def turned(half_tangent: Fraction) -> tuple[Fraction, Fraction]:
    """Cosine and sine."""
    t = half_tangent * half_tangent
    return (1 - t) / (1 + t), 2 * half_tangent / (1 + t)


def about(axis: int, angle: tuple[Fraction, Fraction]) -> Matrix:
    """4x4 of a turn about x, y or z."""
    c, s = angle
    out = [[Fraction(i == j) for j in range(4)] for i in range(4)]
    j, k = (axis + 1) % 3, (axis + 2) % 3
    out[j][j], out[j][k], out[k][j], out[k][k] = c, -s, s, c
    return out


def shifted(x: Any, y: Any, z: Any) -> Matrix:
    """4x4 of a shift."""
    out = [[Fraction(i == j) for j in range(4)] for i in range(4)]
    for i, value in enumerate((x, y, z)):
        out[i][3] = Fraction(value)
    return out


def times(*matrices: Matrix) -> Matrix:
    """Product of 4 by 4 matrices of fractions."""
    out, *rest = matrices
    for B in rest:
        out = [[sum((a[k] * B[k][j] for k in range(4)), Fraction(0)) for j in range(4)] for a in out]
    return out


def pose(matrix: Matrix) -> Pose:
    """The nearest floats."""
    floats = np.array([[float(x) for x in row] for row in matrix])
    return Pose(floats[:3, :3], floats[:3, 3])


def residues(matrix: Matrix) -> Any:
    """Modulo the prime (4, 4), as objects."""
    return np.array([[residue(x) for x in row] for row in matrix], dtype=object)


@dataclass
class ExactLink:
    """A link behind a joint about or along z."""

    parent: int
    turns: bool
    near: Matrix
    far: Matrix


@dataclass
class Case:
    """A mechanism with what is known of it."""

    kind: str
    links: list[ExactLink]
    gravity: tuple[int, int, int]
    loop: FiveBar | None = None
    miss: float = 0.0
    """rad or of a length, by which it is nearly special; 0 where it is not."""
    scale: Fraction = Fraction(1)
    """m of the unit of length."""
    gears: tuple[Gear, ...] = ()
    shafts: tuple[Shaft, ...] = ()

    def mechanism(self) -> Mechanism:
        """The mechanism in floats."""
        turns = [link.turns for link in self.links]
        drives = {shaft.joint: shaft.drive(turns, self.scale) for shaft in self.shafts}
        links = tuple(
            Link(
                f"link{i + 1}",
                link.parent,
                self._joint(i, drives.get(i, Drive())),
                self._pose(link.near),
                self._pose(link.far),
                np.array([1.0, 0, 0, 0, 1, 0, 1, 0, 0, 1]),
            )
            for i, link in enumerate(self.links)
        )
        loops = None if self.loop is None else self.loop.loops(float(self.scale))
        if self.gears:
            couplings = tuple(gear.coupling(turns, self.scale) for gear in self.gears)
            followers = {c.follower for c in couplings}
            free = tuple(link.joint.name for link in links if link.joint.name not in followers)
            loops = Loops(free, couplings=couplings)
        return Mechanism(Description(self.kind, links, np.array(self.gravity) * 9.81, loops=loops))

    def _joint(self, i: int, drive: Drive) -> Joint:
        kind = JointKind.REVOLUTE if self.links[i].turns else JointKind.PRISMATIC
        return Joint(f"joint{i + 1}", kind, drive=drive)

    def _pose(self, matrix: Matrix) -> Pose:
        return pose(
            [[x * self.scale if j == 3 and i < 3 else x for j, x in enumerate(row)] for i, row in enumerate(matrix)]
        )

    def differences(self, seed: int) -> Any:
        """H (samples, P) modulo the prime, as objects."""
        rng = np.random.default_rng([seed, 61])
        samples = 10 * len(self.links) + len(self.shafts) + 4
        # An angle is no algebraic function of a displacement, which may follow it.
        half_tangents, v, q = (_random_columns(rng, samples, len(self.links)) for _ in range(3))
        turns = [circle(x) for x in half_tangents]
        rates = v
        if self.loop is not None:
            turns, rates = self.loop.closed(turns, v, rng)
        turns, q, rates = followed(self.gears, turns, q, rates)
        E = _energies(self.links, turns, q, rates, self.gravity)
        E = np.column_stack([E, *rotor_energies(self.shafts, rates)])
        return (E[1:] - E[:1]) % FIELD


def independent(matrix: Any, order: Sequence[int]) -> list[int]:
    """Columns that are independent of those before them in the order."""
    left, found = matrix.copy(), list[int]()
    for column in order:
        rows = np.flatnonzero(left[:, column] != 0)
        if not len(rows):
            continue
        row = left[rows[0]] * pow(int(left[rows[0], column]), -1, FIELD) % FIELD
        left = np.delete(left, rows[0], axis=0)
        left = (left - left[:, column, None] * row) % FIELD
        found.append(column)
    return found


def _random_columns(rng: np.random.Generator, samples: int, columns: int) -> list[Any]:
    return [np.array([int(x) for x in rng.integers(1, FIELD, samples)], dtype=object) for _ in range(columns)]


def _energies(
    links: Sequence[ExactLink], turns: Sequence[Any], q: Sequence[Any], v: Sequence[Any], gravity: Sequence[int]
) -> Any:
    """(samples, 10 N) of the ten in link frames: over pseudo-inertias, and then over the ten."""
    samples = len(v[0])
    placed: list[tuple[Any, Any]] = []
    columns = []
    for i, link in enumerate(links):
        M, dM = _joint(link.turns, turns[i], q[i], v[i], samples)
        near, far = residues(link.near), residues(link.far)
        A, dA = near @ M @ far % FIELD, near @ dM @ far % FIELD
        if link.parent >= 0:
            B, dB = placed[link.parent]
            A, dA = (B @ A) % FIELD, (dB @ A + B @ dA) % FIELD
        placed.append((A, dA))
        G = np.swapaxes(dA, 1, 2) @ dA % FIELD  # <G, J>/2, J = sum x x' dm
        fall = np.array(gravity, dtype=object) @ A[:, :3, :]
        half = pow(2, -1, FIELD)
        xx, yy, zz = (G[:, k, k] * half for k in range(3))
        # Second moments are (I_yy + I_zz - I_xx)/2 and so on, products of inertia their negatives.
        columns += [
            G[:, 3, 3] * half - fall[:, 3],
            *(G[:, k, 3] - fall[:, k] for k in range(3)),
            (yy + zz - xx) * half, -G[:, 0, 1], (xx + zz - yy) * half, -G[:, 0, 2], -G[:, 1, 2], (xx + yy - zz) * half,
        ]  # fmt: skip
    return np.stack(columns, axis=1) % FIELD


def _joint(turns: bool, circle: tuple[Any, Any], q: Any, v: Any, samples: int) -> tuple[Any, Any]:
    M, dM = np.zeros((samples, 4, 4), dtype=object), np.zeros((samples, 4, 4), dtype=object)
    M[:, 2, 2] = M[:, 3, 3] = 1
    if not turns:
        M[:, 0, 0] = M[:, 1, 1] = 1
        M[:, 2, 3], dM[:, 2, 3] = q, v
        return M, dM
    c, s = circle
    M[:, 0, 0], M[:, 0, 1], M[:, 1, 0], M[:, 1, 1] = c, -s, s, c
    dM[:, 0, 0], dM[:, 0, 1], dM[:, 1, 0], dM[:, 1, 1] = -s * v, -c * v, c * v, -s * v
    return M, dM


def length(rng: np.random.Generator) -> Fraction:
    """A length about one, of few digits, as files have them."""
    return Fraction(int(rng.integers(50, 900)), 1000) * int(rng.choice([-1, 1]))


def angle(rng: np.random.Generator) -> tuple[Fraction, Fraction]:
    """A generic angle."""
    return turned(Fraction(int(rng.integers(15, 85)), 100) * int(rng.choice([-1, 1])))


def twist(rng: np.random.Generator) -> tuple[Fraction, Fraction]:
    """0, 90, -90, 180 degrees, or a generic one."""
    pick = int(rng.integers(6))
    fixed = [(Fraction(1), Fraction(0)), RIGHT, (Fraction(0), Fraction(-1)), (Fraction(-1), Fraction(0))]
    return fixed[pick] if pick < 4 else angle(rng)


def tree(rng: np.random.Generator, links: int, branched: bool) -> Case:
    """Joints that are parallel, at right angles, or askew, that meet or do not; frames at either end, or anywhere."""
    parallel = rng.random() < 0.25
    style = int(rng.integers(3))
    prismatic = 0.5 if rng.random() < 0.15 else 0.2
    out = []
    for i in range(links):
        a, d = (length(rng) if rng.random() < 0.6 else Fraction(0) for _ in range(2))
        step = about(0, (Fraction(1), Fraction(0)) if parallel and i > 0 else twist(rng))
        step = times(shifted(a, 0, d), about(2, twist(rng)), step)
        parent = i - 1
        while branched and parent >= 0 and rng.random() < 0.35:
            parent = out[parent].parent
        anywhere = times(about(0, angle(rng)), about(1, angle(rng)), shifted(length(rng), length(rng), length(rng)))
        far = {0: shifted(0, 0, 0), 1: times(about(0, twist(rng)), shifted(length(rng), 0, 0)), 2: anywhere}[style]
        # The same joints, whatever the frame of the link that carries them.
        near = step if parent < 0 else times(_inverted(out[parent].far), step)
        out.append(ExactLink(parent, rng.random() > prismatic, near, far))
    gravity = [(0, 0, -1), (0, -1, 0), (0, 0, 0), (1, 2, -3)][int(rng.choice(4, p=[0.6, 0.2, 0.05, 0.15]))]
    return Case("tree" if branched else "chain", out, gravity)


def bent(rng: np.random.Generator, links: int) -> Case:
    """A chain with one angle, or one offset, that is nearly special, by more than round-off."""
    case = tree(rng, links, False)
    case.kind, case.miss = "near", float(10.0 ** rng.uniform(-10.5, -3.2))
    which = int(rng.integers(1, links))
    if rng.random() < 0.7:
        small = about(0, turned(Fraction(case.miss / 2)))
        case.links[which].near = times(case.links[which].near, small)
    else:
        case.miss = max(case.miss / 10.0, 1e-10)
        case.links[which].near = times(shifted(Fraction(case.miss), 0, 0), case.links[which].near)
    return case


def _inverted(matrix: Matrix) -> Matrix:
    rotation = [[matrix[j][i] for j in range(3)] for i in range(3)]
    origin = [-sum((rotation[i][k] * matrix[k][3] for k in range(3)), Fraction(0)) for i in range(3)]
    return [*([*rotation[i], origin[i]] for i in range(3)), [Fraction(0), Fraction(0), Fraction(0), Fraction(1)]]


def five_bar(rng: np.random.Generator, near: bool = False) -> Case:
    """A four- or five-bar, perhaps a parallelogram, on the ground or on a turntable, upright or lying."""
    parallel, cranks = bool(rng.random() < 0.4), int(rng.integers(1, 3))
    l1, l2 = (Fraction(int(rng.integers(300, 500)), 1000) for _ in range(2))
    l3, l4 = (Fraction(int(rng.integers(600, 800)), 1000) for _ in range(2))
    base = Fraction(int(rng.integers(250, 400)), 1000)
    if parallel and cranks == 2:
        base, l3, l4 = Fraction(0), l2, l1
    elif parallel:
        l3, l4 = base, l1
    apart = abs(crank(float(l1), 1.1) - float(base) - (crank(float(l2), 2.4) if cranks == 2 else 0.0))
    if not float(abs(l3 - l4)) + 0.05 < apart < float(l3 + l4) - 0.05:
        return five_bar(rng, near)  # It does not close where its reference is.
    miss = float(10.0 ** rng.uniform(-9.0, -4.2)) if near and parallel else 0.0
    l4 += Fraction(miss)
    table, upright = bool(rng.random() < 0.5), bool(rng.random() < 0.7)
    first = int(table)
    plane = about(0, RIGHT) if upright else about(0, (Fraction(1), Fraction(0)))
    flat = shifted(0, 0, 0)
    links = [ExactLink(-1, True, flat, flat)] if table else []
    ground = first - 1
    links.append(ExactLink(ground, True, plane, flat))
    links.append(ExactLink(first, True, shifted(l1, 0, 0), flat))
    second = times(plane, shifted(base, 0, 0))
    links.append(ExactLink(ground, True, second, flat))
    if cranks == 2:
        links.append(ExactLink(first + 2, True, shifted(l2, 0, 0), flat))
    reference = branch(first, tuple(map(float, (l1, l2, l3, l4))), float(base), cranks, parallel)
    bar = FiveBar(first, (l1, l2, l3, l4), base, cranks, parallel and not miss, reference)
    return Case("near loop" if miss else "loop", links, (0, 0, -1), bar, miss)
