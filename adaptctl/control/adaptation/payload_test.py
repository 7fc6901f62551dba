"""Test of missed torques: a payload of the last link, a contact, or neither."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from operator import add
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.adaptation import steady_weight
from adaptctl.control.adaptation.steady_weight import WeightSums
from adaptctl.control.adaptation.symmetric import rank_update, solve
from adaptctl.description.inertia import PARAMETERS
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, absolute, maximum, minimum, sqrt, where

WINDOW, MIN_TIME = 1.0, 0.45
"""s: time constant of the sums, and the time they hold at least for a verdict, what 0.6 s of a steady stream leave"""
MAX_LEFT, MAX_LEFT_RATIO = 0.1, 0.3
"""what a payload may leave of the squared misses, relative to all and to what a contact leaves"""
MAX_LOSS, SLACK_TIME = 0.95, 0.005
"""share of the last joint's inertia that a payload may take away; s: times the damping, an error that loops stand"""
INERTIA_ERROR, WHOLE = 0.1, 1e-6
"""share of its trace by which a payload's inertia may be negative; singular value, relative to the largest, above which
all ten parameters have an effect"""
COMPACT, RADIUS = 0.1, 0.3
"""share of a point mass's inertia, and m of a radius of gyration, by which a load's inertia may differ from it"""
REACH, LEAST_LOAD = 1.0, 0.01
"""m from the last link's frame to a load at most; kg below which no load is more compact"""
MIN_SPREAD = 1e-12
"""variance of the times, relative to the weight, below which a slope says nothing"""


class LineSums(NamedTuple):
    """Sums (r,) of weight, time, squared time, miss, time times miss, and squared miss; time counts from now."""

    n: Any
    t: Any
    tt: Any
    e: Any
    te: Any
    ee: Any


class PayloadSums(NamedTuple):
    """
    Normal equations of ten payload parameters, sums of lines in time, and those of weights without inertia.

    `valid` (1,) is a factor of all, 1 or 0, which the next period takes into account.
    """

    normal: Any
    right: Any
    lines: LineSums
    weight: WeightSums
    valid: Any

    @classmethod
    def zero(cls, model: ReducedModel) -> PayloadSums:
        """No data."""
        lines = LineSums(*(np.zeros(model.mechanism.dof) for _ in LineSums._fields))
        return cls(np.zeros(55), np.zeros(10), lines, WeightSums.zero(model), np.ones(1))

    def cleared(self, kept: Scalar) -> PayloadSums:
        """The same times a factor."""
        return self._replace(valid=Column((kept,)))


class LoadVerdict(NamedTuple):
    """1 or 0 each for a payload and a contact, the payload's change (k,) of the parameters, and the sums."""

    payload: Scalar
    contact: Scalar
    change: Column
    after: PayloadSums


class JudgedPeriod(NamedTuple):
    """
    Data of a period.

    Length in s; 1 while the test goes on, else 0; 1 for an announced payload; weights (r,) of joints, per s; the
    estimate (k,) before the change; damping (r,) in N m s.
    """

    period: float
    going: Scalar
    announced: Scalar
    weights: Column
    trusted: Column
    damping: Column


@dataclass(frozen=True)
class PayloadTest:
    """
    Least squares of missed torques by ten parameters of a link, against pushes.

    A push makes torques that a line in time follows for each joint, or those of weights without inertia at any links;
    a payload makes those of ten constant parameters. At rest all fit, and neither is said.
    """

    model: ReducedModel
    gain: Any

    @property
    def _effect(self) -> Array:
        """Change (k, 10) of the parameters for each of the last link, zero for those that constraints determine."""
        mechanism = self.model.mechanism
        last = mechanism.links[mechanism.description.bodies[-1]].name
        places = {name: place for place, name in enumerate(mechanism.parameter_names)}
        effect = np.zeros((len(self.model.columns), len(PARAMETERS)))
        for i, parameter in enumerate(PARAMETERS):
            if (place := places.get(f"{last}.{parameter}")) is not None:
                effect[:, i] = self.model.regrouping[:, place]
        return effect

    def judged(
        self,
        rows: Sequence[Column],
        weights: Sequence[Column],
        missed: Column,
        shares: Column,
        noise: Column,
        sums: PayloadSums,
        step: JudgedPeriod,
    ) -> LoadVerdict:
        """Verdict with one more period.

        `weights` are rows of `steady_weight`, `shares` (r,) weigh squared misses, `noise` (r,) is their usual size.
        """
        keep = sums.valid[0] * (step.going / (1.0 + step.period / WINDOW))
        lines = [self._effects(row) for row in rows]
        normal, right = rank_update(sums.normal, lines, shares, keep, 0.0), keep * sums.right
        for line, share, miss in zip(lines, shares, missed, strict=True):
            right = right - (share * miss) * line
        own = solve(normal + self._prior, right)
        fits = list(
            zip(*(_line(one, step, keep) for one in zip(*sums.lines, missed, shares, strict=True)), strict=True)
        )
        after = LineSums(*map(Column, fits[: len(LineSums._fields)]))
        whole, straight = reduce(add, after.ee), reduce(add, fits[-1])
        usual = 2.0 * (after.n @ noise)
        change = self._change(own)
        # A push has no prior, which would count against the load alone.
        prior = reduce(add, (x * x / gain for x, gain in zip(change, self.gain, strict=True)))
        unlike = maximum(whole - own @ right - prior, 0.0)
        left = unlike - usual
        hung, weight = steady_weight.left(weights, missed, shares, (keep, step.period), whole, sums.weight)
        pushed = minimum(straight, hung)
        times = [n / weight for n, weight in zip(after.n, step.weights, strict=True)]
        full = where(reduce(maximum, times) > MIN_TIME, 1.0, 0.0)
        payload = full * where(left < MAX_LEFT * whole, 1.0, 0.0) * self._is_a_body(own, change, step)
        fair = where(pushed < MAX_LEFT_RATIO * unlike, 0.0, 1.0)  # what noise may hide must not favor the load
        better = maximum(where(left < MAX_LEFT_RATIO * pushed, fair, 0.0), step.announced)
        contact = full * where(pushed - usual < MAX_LEFT * whole, 1.0, 0.0) * (1.0 - payload * better)
        taken = self._change(self._compact(own, normal + self._prior, right))
        return LoadVerdict(payload * better, contact, taken, PayloadSums(normal, right, after, weight, Column((1.0,))))

    def _compact(self, own: Column, normal: Column, right: Column) -> Column:
        """Load (10,) that explains the misses about as well as its best fit does, with an inertia near a point mass's.

        Within a second few motions tell inertias, while the weight tells mass and center."""
        if not self._tells_mass:
            return own
        point, weight = _point_mass(own)
        entries, pulled = list(normal), list(right)
        for i, x in enumerate(point, start=4):
            place = 10 * i - i * (i - 1) // 2
            entries[place], pulled[i] = entries[place] + weight, pulled[i] + weight * x
        return solve(Column(entries), Column(pulled))

    @property
    def _tells_mass(self) -> bool:
        """True if the mass has an effect that the other nine have not."""
        sizes = np.maximum(np.abs(self._effect).max(axis=0), 1e-300)
        _, values, rows = np.linalg.svd(self._effect / sizes)
        told = rows[: len(values)][values > WHOLE * values[0], 0]
        return bool(told @ told > 1.0 - WHOLE)

    def _is_a_body(self, own: Column, change: Column, step: JudgedPeriod) -> Scalar:
        """1 if a body can come or go so, else 0: a load that a push or friction feigns has other inertias.

        The last joint keeps a positive inertia, and the inertia that comes or goes is one about all axes."""
        inertia, joint = last_inertia(self.model)
        if not inertia.any():
            return 1.0
        before, gained = _combined(inertia, step.trusted), _combined(inertia, change)
        slack = SLACK_TIME * step.damping[joint]
        left = where(gained > -MAX_LOSS * maximum(before, 0.0) - slack, 1.0, 0.0)
        return left * (_is_an_inertia(own, slack) if self._tells_all else 1.0)

    @property
    def _tells_all(self) -> bool:
        """True if each of the ten parameters has an effect of its own, as at arms of five joints and more."""
        sizes = np.linalg.svd(self._effect / np.maximum(np.abs(self._effect).max(axis=0), 1e-300), compute_uv=False)
        return bool(sizes[-1] > WHOLE * sizes[0])

    def _effects(self, row: Column) -> Column:
        """Torque (10,) of a joint for each parameter of the link."""
        return Column(_combined(column, row) for column in self._effect.T)

    def _change(self, own: Column) -> Column:
        return Column(_combined(row, own) for row in self._effect)

    @property
    def _prior(self) -> Column:
        """Upper triangle of effect' Gamma^-1 effect."""
        inverse, effect = Column(1.0 / x for x in self.gain), self._effect
        pairs = ((i, j) for i in range(10) for j in range(i, 10))
        return Column(_combined(effect[:, i] * effect[:, j], inverse) for i, j in pairs)


def _point_mass(ten: Column) -> tuple[list[Scalar], Scalar]:
    """Inertia (6,) about the frame of a point of ten parameters' mass and center, and its weight in 1/(kg m^2)^2."""
    m, x, y, z = list(ten)[:4]
    square = x * x + y * y + z * z
    size = maximum(maximum(absolute(m), sqrt(square) * (1.0 / REACH)), LEAST_LOAD)
    each = where(m < 0.0, -1.0, 1.0) / size
    inertia = (square - x * x, -(x * y), square - y * y, -(x * z), -(y * z), square - z * z)
    width = (2.0 * COMPACT) * square / size + (RADIUS * RADIUS) * size
    return [each * one for one in inertia], 1.0 / (width * width)


def _is_an_inertia(ten: Column, slack: Scalar) -> Scalar:
    """1 if the inertia among ten parameters is positive about all axes, or negative about all, but for a slack."""
    entries = ten.of[4:]
    trace = entries[0] + entries[2] + entries[5]
    more = slack + INERTIA_ERROR * absolute(trace)
    xx, xy, yy, xz, yz, zz = (where(trace < 0.0, -x, x) for x in entries)
    xx, yy, zz = xx + more, yy + more, zz + more
    plane = xx * yy - xy * xy
    whole = zz * plane - xx * (yz * yz) - yy * (xz * xz) + 2.0 * (xy * (yz * xz))
    return where(minimum(xx, minimum(plane, whole)) > 0.0, 1.0, 0.0)


@lru_cache(maxsize=32)
def last_inertia(model: ReducedModel) -> tuple[Array, int]:
    """Row (k,) of the last link's inertia about its joint, zero if postures change it, and the joint's index."""
    mechanism = model.mechanism
    joint = mechanism.links[mechanism.description.bodies[-1]].joint.name
    names = [one.name for one in mechanism.primary_joints]
    if mechanism.description.loops is not None or joint not in names:
        return np.zeros(len(model.columns)), 0
    place, rest = names.index(joint), np.zeros(mechanism.dof)
    moved = model.torque_regressor(mechanism.neutral_configuration, rest, np.eye(mechanism.dof)[place])
    still = model.torque_regressor(mechanism.neutral_configuration, rest, rest)
    return moved[place] - still[place], place


def _combined(factors: Array, values: Column) -> Scalar:
    """Sum of products without those that are zero."""
    terms = [(x, y) for x, y in zip(factors.tolist(), values, strict=True) if x != 0.0 and not _is_zero(y)]
    return sum((x * y for x, y in terms[1:]), terms[0][0] * terms[0][1]) if terms else 0.0


def _is_zero(value: Any) -> bool:
    return isinstance(value, float) and value == 0.0


def _line(one: tuple[Any, ...], step: JudgedPeriod, keep: Scalar) -> tuple[Any, ...]:
    """Sums of a joint with one more period, and the squared misses that a line leaves."""
    *sums, miss, share = one
    n, t, tt, e, te, ee = (keep * x for x in sums)
    T = step.period
    t, tt, te = t - T * n, tt - (2.0 * T) * t + (T * T) * n, te - T * e
    n, e, ee = n + share, e + share * miss, ee + share * (miss * miss)
    weight = where(n > 0.0, n, 1.0)
    variance, common, own = tt - (t / weight) * t, te - (e / weight) * t, ee - (e / weight) * e
    tells = variance > MIN_SPREAD * weight
    slope = where(tells, common / where(tells, variance, 1.0), 0.0)
    return n, t, tt, e, te, ee, maximum(own - slope * common, 0.0)
