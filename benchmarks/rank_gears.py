"""Joints that follow others, and motor shafts that turn with several, of the exact oracle's mechanisms."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from adaptctl.description import Coupling
from adaptctl.description.drive import Drive
from benchmarks.rank_field import FIELD, residue, times, turned_on

RATIOS = tuple(Fraction(x) for x in ("-1", "1", "2", "-3", "1/2", "-1/3", "2/3", "7/5"))
STRAIGHT = (Fraction(1), Fraction(0))


@dataclass(frozen=True)
class Gear:
    """Joint that follows another: by a ratio, ahead by an angle (cosine and sine) or by a length."""

    follower: int
    leader: int
    ratio: Fraction
    angle: tuple[Fraction, Fraction] = STRAIGHT
    length: Fraction = Fraction(0)

    def coupling(self, turns: Sequence[bool], scale: Fraction) -> Coupling:
        """The same in floats, with the unit of length in m."""
        follower, leader = f"joint{self.follower + 1}", f"joint{self.leader + 1}"
        offset = math.atan2(*map(float, self.angle[::-1])) if turns[self.follower] else float(self.length * scale)
        ratio = float(_in_metres(self.ratio, turns[self.follower], turns[self.leader], scale))
        return Coupling(f"gear{self.follower + 1}", follower, leader, ratio, offset)


@dataclass(frozen=True)
class Shaft:
    """Rotor of a joint's motor, whose shaft may turn with other joints too, in ratios."""

    joint: int
    others: tuple[tuple[int, Fraction], ...] = ()

    def drive(self, turns: Sequence[bool], scale: Fraction) -> Drive:
        """The same in floats, with the unit of length in m."""
        pairs = [
            (f"joint{other + 1}", float(_in_metres(ratio, turns[self.joint], turns[other], scale)))
            for other, ratio in self.others
        ]
        return Drive(rotor_inertia=0.1, turns_with=tuple(pairs))


def _in_metres(ratio: Fraction, ahead_turns: bool, behind_turns: bool, scale: Fraction) -> Fraction:
    """A ratio of one joint's motion to another's, of which either may slide."""
    return ratio * (1 if ahead_turns else scale) / (1 if behind_turns else scale)


def draw_shafts(rng: np.random.Generator, links: int) -> tuple[Shaft, ...]:
    """Rotors at some joints, every other one on a shaft shared with one or two joints."""
    out = []
    for i in range(links):
        if rng.random() < 0.4:
            continue
        others = [int(j) for j in rng.permutation(links) if j != i][: int(rng.choice([0, 0, 1, 2]))]
        out.append(Shaft(i, tuple((j, RATIOS[int(rng.integers(len(RATIOS)))]) for j in others)))
    return tuple(out)


def draw_gears(
    rng: np.random.Generator, turns: Sequence[bool], angle: Callable[[], tuple[Fraction, Fraction]]
) -> tuple[Gear, ...]:
    """One follower to three, perhaps of followers; only what nothing follows has an offset."""
    order = [int(i) for i in rng.permutation(len(turns))]
    count = int(rng.integers(1, min(len(turns), 4)))
    leaders = [order[int(rng.integers(k))] for k in range(len(order) - count, len(order))]
    out = []
    for follower, leader in zip(order[-count:], leaders, strict=True):
        ahead = angle() if follower not in leaders else STRAIGHT
        length = Fraction(int(rng.integers(-300, 300)), 1000) if follower not in leaders else Fraction(0)
        out.append(Gear(follower, leader, RATIOS[int(rng.integers(len(RATIOS)))], ahead, length))
    return tuple(out)


def followed(
    gears: Sequence[Gear], circles: Sequence[Any], q: Sequence[Any], v: Sequence[Any]
) -> tuple[list[Any], list[Any], list[Any]]:
    """Cosines and sines, displacements and rates of all joints, with followers where their leaders take them.

    Every joint has an angle and a displacement, neither an algebraic function of the other, for what follows a joint
    that slides may turn. Free angles are multiples of drawn ones, so that all followers' are whole multiples too.
    """
    ahead = {gear.follower: gear for gear in gears}
    ways = [_from_first(i, ahead) for i in range(len(q))]
    parts = math.lcm(*(ratio.denominator for _, ratio in ways))
    turned, moved, rates = [], [], []
    for i, (first, ratio) in enumerate(ways):
        gear = ahead.get(i, Gear(i, i, ratio))
        offset = tuple(map(residue, gear.angle))
        turned.append(turned_on(times(circles[first], int(ratio * parts)), offset))
        moved.append((residue(ratio) * q[first] + residue(gear.length)) % FIELD)
        rates.append(residue(ratio) * v[first] % FIELD)
    return turned, moved, rates


def rotor_energies(shafts: Sequence[Shaft], rates: Sequence[Any]) -> list[Any]:
    """Half of the square of each shaft's speed."""
    out = []
    for shaft in shafts:
        speed = rates[shaft.joint] + sum(residue(ratio) * rates[j] for j, ratio in shaft.others)
        out.append(speed * speed * pow(2, -1, FIELD) % FIELD)
    return out


def _from_first(joint: int, ahead: Mapping[int, Gear]) -> tuple[int, Fraction]:
    """The joint that leads all others, and the ratio to it."""
    ratio = Fraction(1)
    while joint in ahead:
        ratio, joint = ratio * ahead[joint].ratio, ahead[joint].leader
    return joint, ratio
