"""Sums, shares and bounds of adaptation laws against fits and numbers found otherwise."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from every_law import MODEL as CHAIN

from adaptctl.control.adaptation import steady_weight
from adaptctl.control.adaptation.composite_learning import CompositeLearning
from adaptctl.control.adaptation.dead_zone import DeadZone
from adaptctl.control.adaptation.doubt import CONTACT, MODEL, PAYLOAD, RESTARTED, UNKNOWN, YOUTH, Watch
from adaptctl.control.adaptation.leakage import _Leaking
from adaptctl.control.adaptation.natural import moved_bodies
from adaptctl.control.adaptation.payload_test import LineSums, _line
from adaptctl.control.adaptation.restart import bounded
from adaptctl.control.adaptation.steady_weight import WeightSums
from adaptctl.control.adaptation.stored import Stored
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.energy_tank import EnergyTank, opened, trusting
from adaptctl.control.gains.adaptation_ratio import adaptation_ratio
from adaptctl.control.slotine_li import Integral, PassivityIntegral
from adaptctl.scalars import Column, column

T, KEEP = 0.1, 0.9
rng = np.random.default_rng(4)


def test_sums_of_a_line_are_those_of_a_weighted_fit() -> None:
    """Of misses over time, of which older ones count less; the last is now."""
    misses, shares = rng.normal(size=12), rng.uniform(0.5, 2.0, size=12)
    step: Any = SimpleNamespace(period=T)
    sums: Any = tuple(np.zeros(len(LineSums._fields)))
    for k, (miss, share) in enumerate(zip(misses, shares, strict=True)):
        *sums, left = _line((*sums, miss, share), step, KEEP)
        weights, time = shares[: k + 1] * KEEP ** np.arange(k, -1.0, -1.0), T * np.arange(-k, 1.0)
        line = np.polyfit(time, misses[: k + 1], 1, w=np.sqrt(weights)) if k else [0.0, miss]
        expected = weights @ (misses[: k + 1] - np.polyval(line, time)) ** 2
        assert left == pytest.approx(expected, abs=1e-12)
    powers = [
        weights,
        weights * time,
        weights * time**2,
        weights * misses,
        weights * time * misses,
        weights * misses**2,
    ]
    assert sums == pytest.approx([float(np.sum(one)) for one in powers])


def test_what_weights_leave_is_what_a_fit_of_slopes_leaves() -> None:
    """In time since the alarm, of ten seconds at most; the first period after it has none."""
    rows, misses = rng.normal(size=(9, 2, 3)), rng.normal(size=(9, 2))
    shares, keeps = rng.uniform(0.5, 2.0, size=(9, 2)), [0.0] + [KEEP] * 8
    sums, times = (
        WeightSums(column(np.zeros(21)), column(np.zeros(6)), np.array([7.0])),
        np.minimum(2.5 * np.arange(9), 10.0),
    )
    whole = 0.0
    for k in range(9):
        whole = keeps[k] * whole + float(shares[k] @ misses[k] ** 2)
        given = [column(row) for row in rows[k]], column(misses[k]), column(shares[k])
        left, sums = steady_weight.left(*given, (keeps[k], 2.5), whole, sums)
        assert float(sums.time[0]) == times[k]
    roots = np.sqrt(shares * KEEP ** np.arange(8, -1.0, -1.0)[:, None]).ravel()
    lines = np.concatenate([rows, times[:, None, None] * rows], axis=-1).reshape(18, 6)
    weighted = roots[:, None] * lines, roots * misses.ravel()
    x = np.linalg.lstsq(*weighted)[0]
    assert float(left) == pytest.approx(np.sum((weighted[1] - weighted[0] @ x) ** 2), rel=1e-6)
    none = WeightSums(np.zeros(0), np.zeros(0), np.zeros(1))
    assert steady_weight.left([], column([]), column([]), (KEEP, T), 3.0, none) == (3.0, none)


def test_weights_rise_through_two_filters() -> None:
    p, rest, memory = np.array([0.2, -0.4, 0.3]), np.zeros(3), steady_weight.start(CHAIN)
    period: Any = SimpleNamespace(q=Column(p.tolist()), period=1e-3)
    for _ in range(100):
        rows, memory = steady_weight.predicted(CHAIN, period, memory, 10.0)
    weights = CHAIN.torque_regressor(p, rest, rest)
    steady = weights[:, np.abs(weights).max(axis=0) > 1e-9]
    np.testing.assert_allclose([list(row) for row in rows], (1.0 - 2.0 / np.e) * steady, rtol=0.01, atol=1e-9)


@pytest.mark.parametrize("slope", [0.3, -0.3, 0.0])
def test_drives_parameters_move_along_exponentials(slope: float) -> None:
    (found,) = moved_bodies(Column((2.0,)), Column((slope,)), 0)
    assert found == pytest.approx(2.0 * np.exp(-2.0 * slope), rel=1e-4)


def test_what_is_in_quarantine_leaves_it_within_a_third_of_a_second() -> None:
    period: Any = SimpleNamespace(period=1e-3, dt=2e-3)
    stored = Stored(None, None, None, None, Column((1.0, 1.0)))
    quiet, resting, alarmed = (
        stored.flow(period, *given, (0.5, 3.0)) for given in ((False, 1.0), (False, 0.0), (True, 1.0))
    )
    assert quiet.stay**300 == pytest.approx(np.exp(-1.0), rel=0.01)
    assert quiet.leave + quiet.stay == pytest.approx(1.0)
    assert alarmed.stay == quiet.stay
    assert (alarmed.leave, alarmed.keep, alarmed.recall) == (0.0, 1.0, 0.0)
    assert quiet.keep == pytest.approx(np.exp(-0.001), abs=1e-6)
    assert resting.keep == 1.0
    assert (quiet.recall, resting.recall) == pytest.approx((6e-3, 6e-5))  # at rest a hundredth
    cleared = stored.cleared(0.0, 0.5).flow(period, False, 1.0, (0.5, 3.0))
    assert (cleared.keep, cleared.leave + cleared.stay) == (0.0, pytest.approx(0.5))


@pytest.mark.parametrize(
    ("energy", "left", "opening"), [(1.0, 0.85, 1.0), (0.1, -0.05, 0.0), (0.45, 0.3, 0.5), (5.0, 2.4, 1.0)]
)
def test_a_tank_opens_springs_by_what_is_left(energy: float, left: float, opening: float) -> None:
    """After the work of 1.5 N m over 0.1 rad; of springs of 0.4 J, with a reserve of a tenth of the tank's 2 J."""
    one = Column((0.3,))
    tank = EnergyTank(Column((energy,)), one, Column((0.5,)), None, None, None)  # type: ignore[arg-type]
    found = opened(tank, Column((0.4,)), Column((2.0,)), 0.4, 2.0)
    assert float(found.energy[0]) == pytest.approx(left)
    assert float(found.opening[0]) == pytest.approx(opening)
    assert float(found.p[0]) == 0.4


@pytest.mark.parametrize(
    ("calm", "age", "alarm", "announced", "decision", "trusted", "after"),
    [
        (-1.0, YOUTH - 1.0, 0.0, 0.0, MODEL, 1.0, -1.0),  # the first estimate, where the initial one was zero
        (0.0, YOUTH - 1.0, 0.0, 0.0, MODEL, 0.0, 0.0),
        (-1.0, YOUTH, 0.0, 0.0, MODEL, 0.0, 0.5),
        (2.4, YOUTH, 0.0, 0.0, MODEL, 0.0, 2.9),
        (2.6, YOUTH, 0.0, 0.0, MODEL, 0.1, 3.1),  # a tenth of the way in half a second: five seconds
        (2.6, YOUTH, 1.0, 0.0, UNKNOWN, 0.0, 0.0),
        (2.6, YOUTH, 1.0, 1.0, PAYLOAD, 5.0, 0.0),  # what an announced payload is taken for
        (2.6, YOUTH, 1.0, 0.0, PAYLOAD, 0.0, 0.0),
    ],
)
def test_a_tank_trusts_estimates_that_were_not_doubted_for_a_while(
    calm: float, age: float, alarm: float, announced: float, decision: float, trusted: float, after: float
) -> None:
    one, zero = Column((1.0,)), Column((0.0,))
    tank = EnergyTank(one, zero, zero, one, zero, Column((calm,)))
    states = (Column((x,)) for x in (age, alarm, announced, decision))
    watch = Watch(Column((5.0,)), zero, zero, zero, *states)
    found = trusting(tank, one, watch, 0.5)
    assert float(found.trusted[0]) == pytest.approx(trusted)
    assert float(found.calm[0]) == pytest.approx(after)
    learned = trusting(tank, one, None, 0.5)  # by a law without doubts
    assert (float(learned.trusted[0]), float(learned.calm[0])) == (float(calm < 0.0), calm)


@pytest.mark.parametrize(
    ("estimate", "before", "age", "decision", "restarted"),
    [
        ((3.0, 8.0), MODEL, 0.0, MODEL, False),  # at the bound: 3 and 4 units away, which are 5
        ((3.1, 8.0), MODEL, 99.0, MODEL, True),
        ((0.0, 0.0), RESTARTED, YOUTH - 0.1, MODEL, False),
        ((0.0, 0.0), RESTARTED, YOUTH, MODEL, False),
        ((0.0, 0.0), RESTARTED, YOUTH - 0.1, CONTACT, False),
    ],
)
def test_an_estimate_far_from_the_prior_begins_anew(
    estimate: tuple[float, float], before: float, age: float, decision: float, restarted: bool
) -> None:
    """And says so as long as its memory is young."""
    one, prior = Column((1.0,)), Column((0.0, 0.0))
    watch = Watch(Column((7.0, 7.0)), one, one, one, Column((age,)), one, one, Column((decision,)))
    stored = Stored(None, None, None, None, Column((1.0, 1.0)))
    memory: Any = SimpleNamespace(prior=prior, watch=watch, stored=stored, _replace=lambda **given: given)
    after, kept = bounded(5.0, Column((1.0, 2.0)), Column(estimate), memory, before)
    assert list(after) == list(prior if restarted else estimate)
    assert list(kept["watch"].trusted) == list(prior if restarted else (7.0, 7.0))
    assert [float(x[0]) for x in (kept["watch"].noise, kept["watch"].alarm)] == [0.0 if restarted else 1.0] * 2
    assert list(kept["stored"].valid) == [0.0 if restarted else 1.0] * 2
    young = before > CONTACT and age < YOUTH
    told = RESTARTED if restarted else decision if decision > MODEL else RESTARTED if young else MODEL
    assert float(kept["watch"].decision[0]) == told


@pytest.mark.parametrize(("power", "kept"), [(1.0, 1.0), (2.0, 1.0), (4.0, 1.0 / 1.05), (6.0, 1.0 / 1.1)])
def test_memory_is_let_go_by_the_power_of_errors_above_a_level(power: float, kept: float) -> None:
    law: Any = SimpleNamespace(reset_power=2.0, forgetting=0.5)
    assert CompositeLearning._retained(law, power, SimpleNamespace(dt=0.1)) == pytest.approx(kept)  # type: ignore[arg-type]


@pytest.mark.parametrize(("sliding", "learns"), [((1.0, 0.0), False), ((0.0, 2.0), False), ((0.8, 1.4), True)])
def test_a_dead_zone_ends_at_its_widths(sliding: tuple[float, float], learns: bool) -> None:
    law: Any = SimpleNamespace(width=[1.0, 2.0], applied=lambda slope: slope)
    model: Any = SimpleNamespace(mechanism=SimpleNamespace(dof=2))
    period: Any = SimpleNamespace(mean=Column(sliding), integral=Column((3.0, 4.0)), gradient=lambda s: s)
    found, _ = DeadZone.law(law, model, Column((5.0, 5.0)), period, None)  # type: ignore[arg-type]
    assert list(found) == ([2.0, 1.0] if learns else [5.0, 5.0])


def test_a_leak_draws_to_the_prior_however_fast() -> None:
    law: Any = SimpleNamespace(prior=[4.0], applied=lambda slope: slope, _rate=lambda period: period.rate)
    for rate, expected in ((0.0, 1.0), (10.0, 2.5), (1e9, 4.0)):
        period: Any = SimpleNamespace(dt=0.1, rate=rate, integral=Column((1.0,)), gradient=lambda s: s)
        found, _ = _Leaking.law(law, None, Column((2.0,)), period, None)  # type: ignore[arg-type]
        assert float(found[0]) == pytest.approx(expected)


def test_the_ratio_of_adaptation_is_the_greatest_eigenvalue_of_any_posture() -> None:
    Y, damping, gain = rng.normal(size=(5, 2, 4)), np.array([2.0, 0.5]), rng.uniform(0.1, 1.0, size=4)
    each = [np.linalg.eigvals(np.diag(1.0 / damping) @ y @ np.diag(gain) @ y.T).real.max() for y in Y]
    assert adaptation_ratio(Y, damping, gain, 0.01) == pytest.approx(0.01 * max(each))


def test_the_reference_velocity_with_an_integral_has_its_derivative() -> None:
    law: Any = SimpleNamespace(bandwidth=np.array([2.0, 3.0]))
    given, dt = rng.normal(size=(5, 2)), 1e-6

    def at(time: float, memory: Any) -> Any:
        (p, v, a, wanted, speed), t = given, time
        point = ReferencePoint(column(wanted + speed * t), column(speed), column([0.0, 0.0]))
        moved = column(p + v * t + 0.5 * a * t * t), column(v + a * t)
        found = PassivityIntegral.reference_velocity(law, column([]), *moved, point, memory)
        return [np.array(list(x)) for x in found[:2]], found[2]

    start: Any = SimpleNamespace(controller_state=Integral(column([0.3, -0.2]), column([0.0, 0.0])), dt=column([0.0]))
    (before, slope), held = at(0.0, start)
    (after, _), _ = at(dt, SimpleNamespace(controller_state=held, dt=column([dt])))
    np.testing.assert_allclose((after - before) / dt, slope, rtol=1e-4)
