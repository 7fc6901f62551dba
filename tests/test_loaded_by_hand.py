"""Fits of loads, errors that last, and regressors made in parts, on numbers that are reckoned otherwise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter
from synthetic_logs import known

from adaptctl.arrays import Array
from adaptctl.identification import delay, filtered_dynamics, lasting_errors, loaded_equations, loaded_fit
from adaptctl.identification.autoregression import autoregression
from adaptctl.identification.entropic import EntropicPrior
from adaptctl.identification.filtered_dynamics import RowFilter, SmoothMotion
from adaptctl.identification.fit import FitSettings
from adaptctl.identification.held_out import _predicted
from adaptctl.identification.lasting_errors import with_lasting_errors
from adaptctl.identification.learned_payload import _ball
from adaptctl.identification.loaded_fit import KnownValue, LoadedEquations, LoadedFit, _halved, _minimum
from adaptctl.identification.momentum_balance import MomentumBalance, PackedRegressor
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.preparation import prepare
from adaptctl.identification.uncertainty import Student, Uncertainty

rng = np.random.default_rng(7)


def test_steps_are_halved_until_no_constant_changes_its_sign() -> None:
    problem: Any = SimpleNamespace(unknown=np.array([0, 2]))
    x, c, dx = np.zeros(2), np.array([1.0, 2.0, -1.0]), np.array([8.0, -16.0])
    found = list(_halved(problem, x, c, dx, np.array([-3.0, 4.0])))
    assert len(found) == 30 - 3  # the third halving makes the last constant 0
    np.testing.assert_allclose(found[0][0], [1.0, -2.0])
    np.testing.assert_allclose(found[0][1], [0.625, 2.0, -0.5])
    np.testing.assert_allclose(found[1][0], [0.5, -1.0])


@pytest.mark.parametrize(
    ("least", "factor", "unknown", "steps"),
    [
        (1.0, 3.0, [0], 15),  # the value falls by less than 1e-7 of it
        (0.0, 3.0, [0], 18),  # the constant changes by less than 1e-5
        (1.0, 3.0, [], 1),
        (1.0, -1.0, [0], 1),  # no step leads downhill
    ],
)
def test_a_minimum_is_searched_by_steps_that_lead_downhill(
    least: float, factor: float, unknown: list[int], steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By three times the way, of which half is the first that does: each step leaves half of the error."""
    at, taken = [np.array([0.0]), np.array([1.0])], []

    def value(x: Array, c: Array, deviations: Array) -> float:
        return least + float((x[0] - 3.0) ** 2 + (c[0] - 2.0) ** 2 * len(unknown))

    def linearised(equations: Any, x: Array, c: Array, deviations: Array) -> tuple[Array, Array]:
        at[:] = x, c
        return np.eye(2), np.zeros(2)

    def estimate(A: Array, b: Array, prior: Any, weight: float, start: Array) -> Array:
        np.testing.assert_array_equal(start, [*at[0], *[0.0] * len(unknown)])
        taken.append(start)
        return np.array([at[0][0] + factor * (3.0 - at[0][0]), *(factor * (2.0 - at[1]))[: len(unknown)]])

    monkeypatch.setattr(loaded_fit, "consistent_estimate", estimate)
    problem: Any = SimpleNamespace(unknown=np.array(unknown, dtype=int), value=value, linearised=linearised)
    problem.equations, problem.prior, problem.pinned = None, None, lambda A, b: (A, b)
    x, c = _minimum(problem, *at, np.ones(1))  # type: ignore[arg-type]
    assert len(taken) == steps
    moved = steps if factor > 0.0 else 0
    assert x[0] == pytest.approx(3.0 - 3.0 * (-0.5) ** moved)
    assert c[0] == pytest.approx(2.0 - (-0.5) ** moved if unknown else 1.0)


def test_fits_are_weighted_by_what_the_one_before_left(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[float] = []
    monkeypatch.setattr(loaded_fit, "_minimum", lambda _, x, c, deviations: seen.append(deviations[0]) or (x + 1.0, c))
    monkeypatch.setattr(loaded_fit, "_covariance", lambda _, x, c, deviations: np.diag([x[0], deviations[0]]))
    problem: Any = SimpleNamespace(
        started=lambda: (np.zeros(1), np.ones(1)),
        deviations=lambda x, c: x + 10.0,
        equations=SimpleNamespace(count=np.zeros((7, 2))),
    )
    found = loaded_fit.loaded_fit(problem)
    assert seen == [10.0, 11.0, 12.0, 13.0]
    assert (found.x[0], found.student) == (4.0, Student(7))
    np.testing.assert_array_equal(np.diag(found.covariance), [4.0, 14.0])


def test_deviations_of_combinations_are_students() -> None:
    A, own = rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    covariance = A @ A.T
    found = LoadedFit(np.zeros(2), np.ones(1), covariance, Student(5)).deviations(own)
    expected = 2.7764451 / 1.959964 * np.sqrt([row @ covariance @ row for row in own])
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_equations_of_motors_are_the_joints_through_the_transmission(monkeypatch: pytest.MonkeyPatch) -> None:
    """Links first, then payloads, then drives; slow rows do not count, by the share of each joint's peak."""
    T, peaks = np.array([[2.0, 0.0], [0.5, -4.0]]), np.array([1.0, 3.0])
    Y, torque = rng.normal(size=(2, 9, 2, 13)), rng.normal(size=(2, 9, 2))
    load, block, used = rng.normal(size=(9, 2, 10)), np.repeat([0, 1, 2], 3), rng.random((2, 9, 2)) < 0.7

    def rows(k: int) -> Any:
        def faster(least: Array) -> Array:
            np.testing.assert_allclose(least, 0.02 * peaks)
            return used[k]

        return SimpleNamespace(regressor=Y[k], torque=torque[k], used=faster)

    monkeypatch.setattr(loaded_equations, "payload_columns", lambda *_: load)
    mechanism = SimpleNamespace(dof=2, description=SimpleNamespace(bodies=(0,)))
    evidence: Any = SimpleNamespace(mechanism=mechanism, drives=SimpleNamespace(transmission=T), blocks=4)
    evidence.parts = lambda cutoff: [(rows(k), None, block, peaks) for k in range(2)]
    found = loaded_equations._of_motors(evidence, 8.0, [None], np.array([10, 12]))  # type: ignore[list-item]
    inverse, whole = np.linalg.inv(T), [np.concatenate([y[..., :10], load, y[..., [10, 12]]], axis=-1) for y in Y]
    for b in range(4):
        for k in range(2):
            pairs = [
                (np.tensordot(inverse[:, k], whole[i][n], (0, 0)), inverse[:, k] @ torque[i, n])
                for i in range(2) for n in np.flatnonzero((block == b) & used[i, :, k])
            ]  # fmt: skip
            normal = sum((np.outer(y, y) for y, _ in pairs), np.zeros((22, 22)))
            np.testing.assert_allclose(found.normal[b, k], normal, atol=1e-12)
            moment = sum((t * y for y, t in pairs), np.zeros(22))
            np.testing.assert_allclose(found.moment[b, k], moment, atol=1e-12)
            assert found.count[b, k] == len(pairs)


def test_columns_beside_a_packed_regressor_are_those_of_the_whole() -> None:
    Y, more = rng.normal(size=(6, 3, 4)), rng.normal(size=(6, 3, 2))
    Y[:, 1, 2:], Y[:, 2, 0] = 0.0, 0.0
    found = PackedRegressor.of(Y).beside(more)
    assert (found.shape, found.values.shape) == ((3, 6), (6, 9 + 6))
    np.testing.assert_array_equal(found.whole, np.concatenate([Y, more], axis=-1))
    for j in range(3):
        columns, values = found.joint(j)
        np.testing.assert_array_equal(values, found.whole[:, j, columns])


@pytest.fixture(scope="module")
def motion() -> SmoothMotion:
    case = known(3, links=2, duration=6.0, rate=250.0)
    (piece,), _ = prepare(case.log, case.truth)
    return SmoothMotion.of(piece, 0, 20.0)


@pytest.mark.parametrize("chunk", [64, 97])
def test_regressors_made_in_chunks_are_those_made_at_once(
    motion: SmoothMotion, chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    mechanism = known(3, links=2).truth
    filters = [RowFilter.of(motion, cutoff) for cutoff in (4.0, 25.0)]
    assert filters[0].every != filters[1].every
    whole = motion.filtered_regressors(MomentumBalance(mechanism), filters)
    monkeypatch.setattr(filtered_dynamics, "CHUNK_SAMPLES", chunk)
    for own, expected in zip(motion.filtered_regressors(MomentumBalance(mechanism), filters), whole, strict=True):
        np.testing.assert_allclose(own.values, expected.values, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("first", "last"), [(0, None), (7, 20), (30, None)])
def test_torques_of_a_robot_are_predicted_at_the_rows_asked_for(
    motion: SmoothMotion, first: int, last: int | None
) -> None:
    mechanism = known(3, links=2).truth
    filters = [RowFilter.of(motion, cutoff) for cutoff in (4.0, 25.0)]
    rows = motion.filtered_rows(MomentumBalance(mechanism), filters)
    asked = {own.cutoff: own.time[first:last] for own in rows}
    found = dict(_predicted(motion, asked, MomentumBalance(mechanism, known=True)))
    for own in rows:
        expected = (own.regressor @ mechanism.inertial_parameters)[first:last]
        np.testing.assert_allclose(found[own.cutoff], expected, rtol=1e-8, atol=1e-8)
    assert not list(_predicted(motion, {}, MomentumBalance(mechanism, known=True)))


@pytest.mark.parametrize(("value", "counts"), [(0.21, True), (-0.21, True), (0.19, False), (-0.19, False)])
def test_a_delay_of_two_deviations_is_an_error_of_the_parameters(
    value: float, counts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And noise that lasts is, by the sums of scores in all rows over those that a fit counts."""
    inverse, scores, effect = np.diag([2.0, 3.0]), rng.normal(size=(2, 2)), np.array([5.0, -7.0])
    seen: list[Array] = []

    def delayed(evidence: Any, fit: Any, own: Array, student: Student) -> Any:
        seen.append(own)
        return SimpleNamespace(value=value, deviation=0.1, effect=effect)

    monkeypatch.setattr(lasting_errors, "inverse_curvature", lambda *_: (inverse, np.arange(2)))
    monkeypatch.setattr(lasting_errors, "_scores", lambda *_: scores)
    monkeypatch.setattr(lasting_errors, "estimated_delay", delayed)
    counted = np.array([[True, True], [True, False]])
    evidence: Any = SimpleNamespace(blocks=2, counted=lambda settings: counted)
    evidence.equations = lambda settings, blocks: SimpleNamespace(count=np.array([[4.0, 5.0]]))
    given = Uncertainty(np.eye(2), 0.5 * np.eye(2), np.eye(2), Student(4), np.eye(2), np.empty(0, dtype=np.int64))
    found = with_lasting_errors(given, evidence, SimpleNamespace(settings=None))  # type: ignore[arg-type]
    np.testing.assert_allclose(seen, [3.0 * inverse])
    np.testing.assert_allclose(found.serial, 3.0 * inverse @ scores @ inverse)
    np.testing.assert_allclose(found.bias, 0.5 * np.eye(2) + counts * value**2 * np.outer(effect, effect))


def test_scores_are_of_the_rows_that_count_over_the_squares_of_deviations(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each joint for itself, with its share of the parameters that are fitted."""
    Y, torque, x, used = rng.normal(size=(8, 3, 4)), rng.normal(size=(8, 3)), rng.normal(size=4), np.ones((8, 3), bool)
    used[:, 1], used[2:4, 0] = False, False
    monkeypatch.setattr(lasting_errors, "lasting_covariance", lambda Z, e, share: share * np.outer(e @ Z, e @ Z))
    rows = SimpleNamespace(regressor=Y, torque=torque)
    evidence: Any = SimpleNamespace(fitted_rows=lambda _: rows, counted=lambda _: used)
    fit: Any = SimpleNamespace(settings=None, x=x, deviations=np.array([0.5, 1.0, 2.0]))
    kept, expected = np.array([0, 3]), np.zeros((4, 4))
    for j, deviation in ((0, 0.5), (2, 2.0)):
        error = (Y[:, j] @ x - torque[:, j]) * used[:, j]
        score = error @ Y[:, j][:, kept] / deviation**2
        expected[np.ix_(kept, kept)] += 2.0 / 3.0 * np.outer(score, score)
    np.testing.assert_allclose(lasting_errors._scores(evidence, fit, kept), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("seed", "a", "case"),
    [(1, 0.3, "low"), (1, 0.4, "raised"), (1, 0.7, "raised"), (0, 0.97, "most"), (5, 0.97, "most")],
)
def test_short_series_persist_by_kendalls_bias_more_than_their_residuals(seed: int, a: float, case: str) -> None:
    """From a sum of coefficients of a fifth on, to 0.98 at most."""
    error = lfilter([1.0], [1.0, -a], np.random.default_rng(seed).normal(size=80))
    products = np.array([error[: 80 - k] @ error[k:] for k in range(5)]) / 80.0
    raw = solve_toeplitz(products[:4], products[1:])
    found, _ = autoregression(error, 0.0)
    whole = raw.sum()
    more = whole + 2.0 * (1.0 + 3.0 * whole) / 80.0
    assert case == ("low" if whole <= 0.2 else "raised" if more < 0.98 else "most")
    expected = {"low": whole, "raised": more, "most": 0.98}[case]
    np.testing.assert_allclose(found, raw * expected / whole, rtol=1e-6, atol=1e-7)


@dataclass(frozen=True)
class Late:
    """Evidence that is advanced by the delay found so far."""

    rows: dict[float, Any]
    by: float = 0.0
    band: float = 4.0
    blocks: int = 7

    @property
    def motions(self) -> list[Any]:
        return [SimpleNamespace(log=SimpleNamespace(rate=rate)) for rate in (200.0, 50.0)]

    @property
    def sampled(self) -> Late:
        return self

    def advanced(self, delay: float) -> Late:
        return replace(self, by=delay)

    def fit(self, settings: FitSettings, blocks: range) -> FitSettings:
        assert (settings.weight, settings.slow, settings.cutoff) == (0.01, 0.05, 4.0)
        return settings


@pytest.mark.parametrize(
    ("share", "late", "value", "deviation", "rounds"),
    [
        (1.0, 0.02, 0.02, 1.3 * 0.003, 2),
        (0.5, -0.02, -0.02, 1.3 * 0.003, 11),
        (0.1, 0.02, 0.02 * (1.0 - 0.9**12), 1.3 * 0.003, 12),
        (1.0, 0.9, 0.5, 0.5, 2),  # two periods of the band
        (1.0, -0.9, -0.5, 0.5, 2),
    ],
)
def test_a_delay_is_measured_until_it_hardly_changes(
    share: float, late: float, value: float, deviation: float, rounds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each time a share of what is left is found, with its deviation."""
    seen: list[float] = []

    def estimated(evidence: Late, fit: Any, inverse: Any, student: Student, lags: bool) -> delay.Delay:
        assert (lags, student) == (True, Student(7))
        seen.append(evidence.by)
        return delay.Delay(share * (late - evidence.by), 0.003, np.array([float(len(seen))]))

    monkeypatch.setattr(delay, "estimated_delay", estimated)
    monkeypatch.setattr(delay, "inverse_curvature", lambda *_: (None, None))
    found = delay.delay_of(Late({4.0: 1, 9.0: 2}))  # type: ignore[arg-type]
    assert found.value == pytest.approx(value, abs=1e-5)
    assert found.deviation == pytest.approx(deviation)
    assert found.least == pytest.approx(0.1 / 50.0)
    assert len(seen) == rounds
    assert found.effect.tolist() == [rounds]


def judged_by(x: float, spread: float, better: float, value: float = 0.03) -> Any:
    """A delay of torques, of which a fit on torques without it leaves a share of what one with it does."""
    ones, off = np.ones((4, 1, 1)), np.array([[1.0], [-1.0], [1.0], [-1.0]])

    def of(error: float, fitted: float) -> Any:
        rows = {4.0: SimpleNamespace(regressor=ones, torque=x + error * off), 9.0: None}
        fit = SimpleNamespace(x=np.array([x]), deviations=np.array([fitted]))
        return SimpleNamespace(rows=rows, band=4.0, blocks=3, fit=lambda settings, blocks: fit)

    as_was, freed = of(1.0, spread), of(better, 1e-3 * spread)  # the deviations of the first fit count
    as_was.advanced = lambda by: freed if by == value else None
    return delay.without_delay(delay.Delay(value, 0.003, np.zeros(1)), as_was, as_was), as_was, freed


@pytest.mark.parametrize(("better", "taken"), [(0.99, True), (1.0, False), (1.01, False)])
def test_a_delay_is_taken_off_where_rows_held_out_are_predicted_better(better: float, taken: bool) -> None:
    found, as_was, freed = judged_by(2.0, 0.5, better)
    assert found.evidence is found.judged is (freed if taken else as_was)
    assert (found.remark is not None) == taken
    if found.remark:
        assert found.remark.startswith("the torques are 30 ms later than the positions (95 % within 24.1 to 35.9 ms)")
        assert "taken as much earlier in fit" in found.remark
    assert found.step.outcome.startswith("the torques are 30 ms later")


def test_a_delay_that_is_in_doubt_stays() -> None:
    found, as_was, _ = judged_by(2.0, 0.5, 0.1, value=0.02)
    assert found.evidence is found.judged is as_was
    earlier, _, freed = judged_by(2.0, 0.5, 0.1, value=-0.03)
    assert earlier.evidence is freed
    assert "taken as much later in fit" in (earlier.remark or "")


def test_the_objective_of_loads_is_of_squares_over_deviations_pins_and_the_prior() -> None:
    """Its slopes along parameters and constants are those of the linearised equations."""
    Y, column, P = rng.normal(size=(2, 30, 13)), rng.normal(size=(2, 30)), 13
    block = np.repeat([0, 1, 2], 10)
    parts = [
        [np.stack([own(k, block == b) for k in range(2)]) for b in range(3)]
        for own in (
            lambda k, here: Y[k, here].T @ Y[k, here],
            lambda k, here: Y[k, here].T @ column[k, here],
            lambda k, here: column[k, here] @ column[k, here],
            lambda k, here: np.float64(here.sum()),
        )
    ]
    sums = NormalEquations(*(np.stack(part) for part in parts))
    prior = EntropicPrior(_ball(3.0)[None], np.array([11]), np.array([0.4]))
    known = [KnownValue(0, 2.9, 2.0), KnownValue(12, 0.3, 0.5)]
    problem = LoadedEquations(sums, prior, known, np.array([1]), np.arange(P), np.zeros((2, 2), dtype=np.int64))
    x, c, spread = np.concatenate([_ball(2.5), [0.1, 0.6, 0.3]]), np.array([1.0, -0.4]), np.array([0.5, 2.0])

    def squares(x: Array, c: Array) -> Array:
        return np.array([np.sum((column[k] - c[k] * Y[k] @ x) ** 2) for k in range(2)])

    np.testing.assert_allclose(problem.squares(x, c), squares(x, c), rtol=1e-9)
    np.testing.assert_allclose(problem.deviations(x, c), np.sqrt(squares(x, c) / 30.0), rtol=1e-9)
    pins = ((2.5 - 2.9) / 2e-5) ** 2 + 0.0
    expected = 0.5 * (squares(x, c) @ spread**-2.0 + pins) + prior.divergence(x, 0.1)
    assert problem.value(x, c, spread) == pytest.approx(expected, rel=1e-9)
    A, b = problem.linearised(sums, x, c, spread)
    slope = A @ np.append(x, 0.0) - b
    for k in range(P + 1):
        step = 1e-6 * np.eye(P + 1)[k]
        both = [squares(x + s * step[:P], c + s * np.array([0.0, step[P]])) @ spread**-2.0 for s in (0.5, -0.5)]
        assert slope[k] == pytest.approx(0.5 * (both[0] - both[1]) / 1e-6, rel=1e-5, abs=1e-5)
    np.testing.assert_allclose(A, A.T)
    pinned, moved = problem.pinned(A.copy(), b.copy())
    np.testing.assert_allclose(np.diag(pinned - A)[[0, 12]], [2e-5**-2, 5e-6**-2])
    np.testing.assert_allclose((moved - b)[[0, 12]], [2.9 / 2e-5**2, 0.3 / 5e-6**2])
    assert np.count_nonzero(pinned - A) == np.count_nonzero(moved - b) == 2
