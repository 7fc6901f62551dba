"""Doubt whether missed torques are errors of the model."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

from adaptctl.control.adaptation.composite import residual
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.two_stage_filter import FilteredPrediction
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, absolute, maximum, minimum, where
from adaptctl.scalars.scalar import Condition

MODEL, UNKNOWN, PAYLOAD, CONTACT, RESTARTED = 0.0, 1.0, 2.0, 3.0, 4.0
"""What missed torques are taken for: nothing new, not known yet, a changed load, a push, or a memory begun anew."""
NOISE_LEVEL = 6.0
"""standard deviations of noise, as measured, beyond which a missed torque is none: 1 in 1,000 runs of 20 s passes it"""
KNOWN_LEVEL = 1.1
"""standard deviations of a stated error and of what P leaves unsure: sound runs are within 0.8 of this"""
OPEN_LEVEL, OPEN = 3.5, 15.0
"""standard deviations of what motion has not shown yet: what is unsure beyond so many squared errors"""
SLACK = 10.0
"""deviations of torque noise (3 % of a torque limit) that friction may hold at speeds below `min_speed`"""
REVERSED = 2.0
"""times the learned Coulomb friction by which what acts may differ from what is predicted where a joint turns back"""
CLEAR = 1.0
"""s without a miss that end a doubt"""
PATIENCE = 10.0
"""times as long as what is not known may a contact last"""
YOUTH, NOISE_MEMORY = 2.0, 5.0
"""s of motion in which all misses count as noise; s over which noise is averaged later"""
LEAST_NOISE = 0.1
"""share of a stated squared error that noise has at least"""
MAX_YOUNG_NOISE = 10.0
"""ratio of a squared miss to what is stated and unsure, above which it is ignorance, and counts as this much"""
MAX_NOISE_RISE = 2.0
"""ratio of a squared miss to the noise, above which it counts as this much: a load must not pass for noise"""


class Watch(NamedTuple):
    """Trusted estimate (k,), noise (r,) in N^2 m^2, doubt and motion (r,) in s, age and alarm (1,) in s."""

    trusted: Any
    noise: Any
    doubt: Any
    moving: Any
    age: Any
    alarm: Any
    announced: Any
    decision: Any


class TorqueEquations(NamedTuple):
    """One period's rows (r of k) in both units, torques missed by the trusted estimate, which joints count, and which
    of these do not turn back."""

    rows: list[Column]
    units: list[Column]
    torque: Column
    missed: Column
    weights: Column
    counts: Column
    onwards: Column
    moving: Column


def equations(
    prediction: FilteredPrediction, period: Period, watch: Watch, scale: Column, weights: Column,
    least: tuple[Column, Any],
) -> TorqueEquations:  # fmt: skip
    """Equations of a period, which count above the least speeds (r,) once a joint has moved for some time in s."""
    rows, (speeds, settling) = prediction.rows, least
    slow = (absolute(v) < most for v, most in zip(prediction.speed, speeds, strict=True))
    moving = Column(where(still, 0.0, m + period.period) for still, m in zip(slow, watch.moving, strict=True))
    counts = Column(where(m > settling, period.dt_ratio, 0.0) for m in moving)
    missed = residual(rows, watch.trusted, prediction.torque)
    # Filtered speeds turn back later than friction does.
    ways = zip(prediction.speed, prediction.rubbing, speeds, counts, strict=True)
    onwards = Column(where(where(v < 0.0, -w, w) < most, 0.0, count) for v, w, most, count in ways)
    units = [scale * row for row in rows]
    return TorqueEquations(rows, units, prediction.torque, missed, weights, counts, onwards, moving)


def coulomb_friction(model: ReducedModel, estimate: Column) -> Column:
    """Coulomb friction (r,) of the primary joints in an estimate (k,), 0 where it is no parameter."""
    named = (f"{joint.name}.coulomb" for joint in model.mechanism.primary_joints)
    return Column(estimate[model.names.index(name)] if name in model.names else 0.0 for name in named)


def doubted(
    sample: TorqueEquations, unsure: Column, period: Period, watch: Watch, friction: Column
) -> tuple[Column, Column, Any]:
    """The noise (r,), the doubts (r,) in s, and the age in s, by the Coulomb friction (r,) that is trusted."""
    age = watch.age[0] + period.dt * reduce(maximum, sample.counts)
    old = where(age < YOUTH, 0.0, 1.0)
    pace = period.period / minimum(maximum(0.25 * age, 0.1), NOISE_MEMORY)
    quiet = where(watch.alarm[0] > 0.0, 0.0, 1.0)
    noises, doubts = [], []
    measured = sample.missed, unsure, sample.weights, sample.counts, sample.onwards, friction
    for miss, form, weight, counts, onwards, rub, noise, doubt in zip(*measured, watch.noise, watch.doubt, strict=True):
        square = miss * miss
        open_yet = maximum(form - OPEN / weight, 0.0)
        limit = NOISE_LEVEL**2 * noise + KNOWN_LEVEL**2 * (1.0 / weight + form) + OPEN_LEVEL**2 * open_yet
        loose = limit + where(onwards > 0.5, 0.0, SLACK * SLACK / weight + (REVERSED * rub) * (REVERSED * rub))
        calmer = where(square > limit, doubt, maximum(doubt - period.dt, 0.0))
        doubts.append(old * where(square * period.dt_ratio > loose, CLEAR, calmer))
        most = where(
            old > 0.5, MAX_NOISE_RISE * (noise + LEAST_NOISE / weight), MAX_YOUNG_NOISE * (1.0 / weight + form)
        )
        seen = minimum(square, most)
        takes = quiet * where(old * where(square > limit, 1.0, 0.0) > 0.5, 0.0, pace * counts)
        noises.append(noise + takes * (seen - noise))
    return Column(noises), Column(doubts), age


def calm(noise: Column, weights: Column) -> Any:
    """Share, 0 to 1, by which the noise of every joint stays below what is stated."""
    loudest = reduce(maximum, (seen * weight for seen, weight in zip(noise, weights, strict=True)))
    return maximum(1.0 - loudest, 0.0)


def touched(doubt: Column, beyond: Sequence[Condition], age: Any) -> Column:
    """Doubts (r,) in s, renewed for joints whose external torque is beyond its level."""
    old = where(age < YOUTH, 0.0, CLEAR)
    return Column(where(above, maximum(s, old), s) for above, s in zip(beyond, doubt, strict=True))


class End(NamedTuple):
    """Alarm in s after the period, 0 once it has ended; 1 where it was cleared, and where it lasted too long."""

    alarm: Any
    cleared: Any
    late: Any


def ended(watch: Watch, doubt: Column, payload: Any, time_limit: Any, period: float) -> End:
    """Beginning, going on or end of an alarm. A payload that was found begins it anew, a contact may last longer."""
    worst: Any = reduce(maximum, doubt)
    alarmed = watch.alarm[0] > 0.0
    calm: Any = where(worst > 0.0, 0.0, 1.0)
    passed = where(watch.decision[0] > PAYLOAD, period * (1.0 / PATIENCE), period)
    lasting: Any = where(payload > 0.5, period, watch.alarm[0] + passed)
    over: Any = where(lasting > time_limit, 1.0, calm)
    alarm = where(alarmed, where(over > 0.5, 0.0, lasting), where(worst > 0.0, period, 0.0))
    return End(alarm, where(alarmed, calm, 0.0), where(alarmed, over - calm, 0.0))


def named(payload: Any, contact: Any, before: Any) -> Any:
    """Decision while an alarm lasts: what was said stays said until something else is."""
    said = where(before > CONTACT, UNKNOWN, maximum(before, UNKNOWN))
    return where(payload > 0.5, PAYLOAD, where(contact > 0.5, CONTACT, said))


def remembered(before: Any, age: Any) -> Any:
    """Decision without an alarm: a load is told for the 2 s of motion in which nothing is doubted."""
    return where(absolute(before - PAYLOAD) < 0.5, where(age < YOUTH, PAYLOAD, MODEL), MODEL)
