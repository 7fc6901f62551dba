"""Parts of identification against closed forms, finite differences and what other libraries reckon."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import freqz, lfilter
from scipy.stats import norm, t

from adaptctl.arrays import Array
from adaptctl.control import Sinusoids
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.dynamics import load
from adaptctl.errors import InputError
from adaptctl.identification.autoregression import autoregression, lasting_covariance
from adaptctl.identification.delay import Delay, _rate, estimated_delay
from adaptctl.identification.entropic import EntropicPrior, _spread_enough
from adaptctl.identification.filtered_dynamics import RowFilter, SmoothMotion, motion_band
from adaptctl.identification.log_checks import _clipped, _frozen, _impossible, _quantum, _spiked
from adaptctl.identification.logged_velocities import _explained
from adaptctl.identification.long_logs import Stretches
from adaptctl.identification.position_faults import slips
from adaptctl.identification.preparation import (
    PreparedLog,
    _turns_off,
    derivative,
    filtered,
    low_pass,
    padded,
)
from adaptctl.identification.robot_motion import RobotLimits, RobotMotion
from adaptctl.identification.student import student_quantile
from adaptctl.identification.uncertainty import Student, Uncertainty, _words, combinations, scaled_inverse
from adaptctl.identification.workspace import ReachableSpace

ARM = load("two_link")
RATE = 100.0


@pytest.mark.parametrize("cutoff", [2.0, 5.0, 12.0])
def test_a_low_pass_passes_rest_halves_its_cutoff_and_delays_nothing(cutoff: float) -> None:
    kernel = low_pass(cutoff, RATE)
    assert kernel.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(kernel, kernel[::-1], atol=1e-15)
    assert len(kernel) / RATE == pytest.approx(2.0 / cutoff, abs=2.0 / RATE)
    _, response = freqz(kernel, worN=[cutoff, 3.0 * cutoff], fs=RATE)
    assert abs(response[0]) == pytest.approx(0.5, abs=0.01)
    assert abs(response[1]) < 0.01
    assert padded(kernel).tolist() == [0.0, 0.0, *kernel.tolist(), 0.0, 0.0]


@given(st.lists(st.floats(-3.0, 3.0), min_size=5, max_size=5))
def test_differences_of_a_polynomial_of_fourth_order_are_its_derivative(coefficients: list[float]) -> None:
    time = np.linspace(-0.5, 0.5, 101)
    polynomial = np.polynomial.Polynomial(coefficients)
    slope = filtered(polynomial(time), derivative(np.ones(1), RATE))
    np.testing.assert_allclose(slope, polynomial.deriv()(time[2:-2]), atol=1e-9)


@given(st.integers(1, 40), st.integers(0, 60), st.integers(1, 9), st.integers(1, 3))
def test_a_thinned_convolution_is_every_so_manieth_of_the_whole(taps: int, more: int, every: int, width: int) -> None:
    rng = np.random.default_rng(taps)
    signal, kernel = rng.normal(size=(taps + more, width)), rng.normal(size=taps)
    whole = np.stack([np.convolve(column, kernel, mode="valid") for column in signal.T], axis=-1)
    np.testing.assert_allclose(filtered(signal, kernel, every), whole[::every], atol=1e-9)


def _turned(position: Array) -> list[float]:
    return _turns_off(position.min(axis=0), position.max(axis=0), ARM).tolist()


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 2])
def test_angles_are_brought_back_by_whole_turns(turns: int) -> None:
    swing = np.stack([np.linspace(-1.0, 1.0, 9), np.linspace(0.0, 0.5, 9)], axis=-1)
    assert _turned(swing + 2.0 * np.pi * np.array([turns, 0])) == [-turns, 0.0]


def test_a_quarter_rad_beyond_a_range_is_no_turn() -> None:
    high = np.deg2rad(170.0)
    for beyond, turns in ((0.24, 0.0), (0.26, -1.0)):
        position = np.stack([np.linspace(high + 0.2, high + beyond, 5), np.zeros(5)], axis=-1)
        assert _turned(position) == [turns, 0.0]


@pytest.mark.parametrize(
    ("ratio", "told"),
    [
        (180.0 / np.pi, "deg/s"), (np.pi / 180.0, "positions in deg taken for rad"), (1e3, "s taken for ms"),
        (1e-3, "ms taken for s"), (1e6, "s taken for us"), (1e-6, "us taken for s"), (60.0 / (2.0 * np.pi), "in rpm"),
        (2.0 * np.pi / 60.0, "taken for rpm"), (-1.0, "wrong sign"), (-180.0 / np.pi, "deg/s"),
    ],
)  # fmt: skip
def test_a_ratio_of_units_is_named(ratio: float, told: str) -> None:
    assert told in _explained(1.08 * ratio)
    assert _explained(3.0) == ""


def prior(links: int = 2) -> EntropicPrior:
    rng = np.random.default_rng(1)
    tens = [from_center_of_mass(1.0 + i, rng.normal(size=3) / 5, np.diag([0.3, 0.4, 0.5])) for i in range(links)]
    return EntropicPrior(np.array(tens), np.array([10 * links + 1]), np.array([0.7]))


def test_the_divergence_of_a_prior_has_its_gradient_and_curvature_and_no_unit() -> None:
    own, rng = prior(), np.random.default_rng(2)
    x = own.start(23) * (1.0 + 0.05 * rng.normal(size=23))
    x[22] = 5.0  # of no part in it
    steps = 1e-6 * np.eye(23)
    slope = [(own.divergence(x + step, 0.3) - own.divergence(x - step, 0.3)) / 2e-6 for step in steps]
    np.testing.assert_allclose(own.gradient(x, 0.3), slope, rtol=1e-5, atol=1e-7)
    bent = [(own.gradient(x + step, 0.3) - own.gradient(x - step, 0.3)) / 2e-6 for step in steps]
    np.testing.assert_allclose(own.curvature(x, 0.3), bent, rtol=1e-4, atol=1e-5)
    start = own.start(23)
    assert own.distance(start) == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(own.gradient(start, 0.3), 0.0, atol=1e-12)
    assert start[21] == 0.7
    # twice the mass everywhere: tr - log det - 4 of 2 I in four dimensions, for each link
    assert own.distance(2.0 * start) == pytest.approx(2 * (8.0 - 4.0 * np.log(2.0) - 4.0))
    twice = start.copy()
    twice[21] *= 2.0
    assert own.divergence(twice, 0.3) - own.divergence(start, 0.3) == pytest.approx(0.01 * (1.0 - np.log(2.0)))
    for k, value in ((0, -1.0), (21, -1.0)):
        wrong = start.copy()
        wrong[k] = value
        assert own.divergence(wrong, 0.3) == np.inf


def test_a_link_without_extent_is_a_ball_of_aluminium() -> None:
    mass, center = 3.0, np.array([0.1, -0.2, 0.05])
    point = from_center_of_mass(mass, center, np.zeros((3, 3)))
    radius = (mass / 2700.0 / (4.0 / 3.0 * np.pi)) ** (1.0 / 3.0)
    ball = from_center_of_mass(mass, center, 0.4 * mass * radius**2 * np.eye(3))
    np.testing.assert_allclose(_spread_enough(point), ball)
    np.testing.assert_array_equal(_spread_enough(ball), ball)
    smaller = from_center_of_mass(mass, center, 0.4 * mass * (0.11 * radius) ** 2 * np.eye(3))
    np.testing.assert_array_equal(_spread_enough(smaller), smaller)  # a hundredth of it is possible
    smaller = from_center_of_mass(mass, center, 0.4 * mass * (0.09 * radius) ** 2 * np.eye(3))
    np.testing.assert_allclose(_spread_enough(smaller), ball)


@pytest.mark.parametrize("freedom", [1.0, 2.0, 4.0, 19.0, 1e4])
def test_quantiles_are_those_of_student_s_distribution(freedom: float) -> None:
    for share in (0.6, 0.975, 0.9995):
        assert student_quantile(share, freedom) == pytest.approx(t.ppf(share, freedom), rel=1e-8)


def uncertain(**changes: Any) -> Uncertainty:
    given = {"sampling": np.diag([1.0, 4.0]), "bias": np.diag([0.25, 0.0]), "nominal": np.diag([16.0, 25.0])}
    more = {"student": Student(9), "alone": np.diag([16.0, 25.0]), "untold": np.array([], dtype=np.int64)}
    return Uncertainty(**{**given, **more, **changes})


def test_the_wider_of_blocks_and_noise_counts_beside_bias() -> None:
    """With Student's quantile for the blocks: 2.776 of four degrees of freedom, 1.96 of many."""
    assert Student(5).quantile_ratio == pytest.approx(2.776 / 1.96, rel=1e-3)
    assert Student(10_000).quantile_ratio == pytest.approx(1.0, rel=1e-3)
    found = uncertain(serial=np.diag([9.0, 1.0]))
    ratio = t.ppf(0.975, 8) / norm.ppf(0.975)
    both = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]])
    widths = [9.0 + 0.25, 4.0 * ratio**2, max(5.0 * ratio**2, 10.0) + 0.25]
    np.testing.assert_allclose(found.of(both), np.sqrt(widths))
    np.testing.assert_allclose(found.nominal_of(both), [4.0, 5.0, np.sqrt(41.0)])
    np.testing.assert_array_equal(found.covariance, np.diag([1.25, 4.0]))


@pytest.mark.parametrize(
    ("bias", "alone", "untold", "reach"),
    [
        (1.0, 1e4, [], np.sqrt(2.0)),  # half by the prior: not more
        (8.0, 81.0, [], 3.0),  # rows tell nearly as much by themselves
        (8.0, 81.1, [], 2.0 * np.sqrt(81.1)),  # by rows alone, whose deviations are twice those for white residuals
        (8.0, 81.1, [0], np.inf),
        (8.0, 81.1, [1], 2.0 * np.sqrt(81.1)),
        (8.0, 81.0, [0], 3.0),
    ],
)
def test_intervals_are_of_the_rows_alone_where_the_prior_decides(
    bias: float, alone: float, untold: list[int], reach: float
) -> None:
    each = {"bias": bias, "nominal": 0.25, "serial": 1.0, "sampling": 0.0, "alone": alone}
    found = uncertain(**{name: np.diag([size, 1.0]) for name, size in each.items()}, untold=np.array(untold, int))
    assert found.for_intervals(np.eye(2))[0] == pytest.approx(reach)
    assert found.of(np.eye(2))[0] == pytest.approx(np.sqrt(1.0 + bias))


def test_an_inverse_is_that_of_the_kept_rows_whatever_their_units() -> None:
    rng = np.random.default_rng(3)
    A = rng.normal(size=(6, 4))
    scale = np.array([1e-6, 1.0, 1e5, 1e2])
    whole = (A.T @ A) * np.outer(scale, scale)
    kept = np.array([0, 2, 3])
    found = scaled_inverse(whole, kept)
    expected = np.linalg.inv((A.T @ A)[np.ix_(kept, kept)]) / np.outer(scale, scale)[np.ix_(kept, kept)]
    np.testing.assert_allclose(found[np.ix_(kept, kept)] / expected, 1.0, rtol=1e-8)
    assert not found[1].any()
    assert not found[:, 1].any()


def test_combinations_are_named_by_their_largest_parts() -> None:
    names = ["a.m", "b.m", "c.m", "d.m", "e.m", "f.m"]
    assert _words(np.array([0.1, -0.8, 0.5, 0.0, 0.0, 0.0]), names) == "0.80 b.m -0.50 c.m"
    assert _words(np.array([0.15, -0.8, 0.5, 0.0, 0.0, 0.0]), names) == "0.80 b.m -0.50 c.m ..."
    assert _words(np.full(6, 0.408), names).count("m") == 4
    weakest, strongest = combinations(np.diag([4.0, 9.0]), ["a.viscous", "b.viscous"])
    assert weakest.words.endswith("a.viscous")
    assert strongest.strength / weakest.strength == pytest.approx(1.5)


@pytest.mark.parametrize("a", [0.0, 0.5, 0.9])
def test_noise_that_lasts_is_that_of_an_autoregression(a: float) -> None:
    rng = np.random.default_rng(4)
    n = 200_000
    error = lfilter([1.0], [1.0, -a], 0.3 * rng.normal(size=n))
    found, variance = autoregression(error, 10.0)
    np.testing.assert_allclose(found, [a, 0.0, 0.0, 0.0], atol=0.01)
    assert variance == pytest.approx(0.09, rel=0.01)
    whole = lasting_covariance(np.stack([np.ones(n), 2.0 * np.ones(n)], axis=-1), error, 10.0)
    np.testing.assert_allclose(whole, n * 0.09 / (1.0 - a) ** 2 * np.array([[1.0, 2.0], [2.0, 4.0]]), rtol=0.1)


def test_weighted_sums_of_lasting_errors_vary_as_matrices_say() -> None:
    """Errors are L w of white w, with a lower triangle L: Y'e has the covariance of w times Y'LL'Y."""
    rng = np.random.default_rng(6)
    error, Y = lfilter([1.0], [1.0, -0.7], rng.normal(size=60)), rng.normal(size=(60, 3))
    coefficients, variance = autoregression(error, 2.0)
    before = sum(a * np.eye(60, k=-1 - k) for k, a in enumerate(coefficients))
    L = np.linalg.inv(np.eye(60) - before)
    np.testing.assert_allclose(lasting_covariance(Y, error, 2.0), variance * Y.T @ L @ L.T @ Y, rtol=1e-9)


def smooth(position: Array, rate: float, moving: Array | None = None) -> SmoothMotion:
    time = np.arange(len(position)) / rate
    on = np.ones(len(time), dtype=np.bool_) if moving is None else moving
    return SmoothMotion.of(PreparedLog("log", rate, time, position, np.zeros_like(position), on), 0)


def test_rows_whose_window_reaches_into_rest_do_not_move() -> None:
    """A window of 1/cutoff s on either side."""
    time = np.arange(2000) / 500.0
    motion = smooth(np.sin(time)[:, None], 500.0, (time > 1.0) & (time < 3.0))
    own = RowFilter.of(motion, 4.0)
    at, moving = own.times(motion), own.moving(motion)
    inside = np.minimum(at - 1.0, 3.0 - at)
    assert moving[inside > 0.25 + 0.02].all()
    assert not moving[inside < 0.25 - 0.02].any()


def test_the_band_of_a_motion_is_that_of_nearly_all_of_its_speed_above_the_noise() -> None:
    """A swing at 5 Hz has 2 % of the squared speed, and 0.1 % of the squared position; encoders' noise has most of all
    squared differences."""
    time = np.arange(8000) / 500.0
    swing = np.sin(2.0 * np.pi * time) + np.outer([0.0, 0.03], np.sin(10.0 * np.pi * time))
    noise = 1e-3 * np.random.default_rng(0).normal(size=(8000, 2))
    for j, band in ((0, 1.0), (1, 5.0)):
        for position in (swing.T, swing.T + noise):
            log = PreparedLog("log", 500.0, time, position[:, j : j + 1], noise[:, :1], np.ones(8000, dtype=np.bool_))
            assert motion_band([log]) == pytest.approx(band, abs=0.3)


@pytest.mark.parametrize(("rate", "cutoff"), [(500.0, 50.0), (100.0, 20.0), (40.0, 8.0)])
def test_slow_logs_are_smoothed_below_a_fifth_of_their_rate(rate: float, cutoff: float) -> None:
    assert smooth(np.zeros((400, 1)), rate).cutoff == cutoff


def test_short_series_count_as_more_persistent_and_of_fewer_rows() -> None:
    rng = np.random.default_rng(5)
    error = lfilter([1.0], [1.0, -0.5], rng.normal(size=400))
    plain, few = autoregression(error, 0.0), autoregression(error, 100.0)
    assert few[1] == pytest.approx(plain[1] * 400.0 / 300.0)
    assert autoregression(error, 399.0)[1] == pytest.approx(2.0 * plain[1])  # half of the rows at least
    assert plain[0].sum() > 0.5
    walk = np.cumsum(rng.normal(size=4000))
    assert autoregression(walk, 0.0)[0].sum() <= 0.98 + 1e-9
    assert autoregression(np.zeros(50), 3.0) == (pytest.approx(np.zeros(4)), 0.0)


@pytest.mark.parametrize("late", [0.0, 0.002, -0.003])
def test_a_delay_is_the_shift_of_the_torques(late: float) -> None:
    time = np.arange(2000) / 500.0

    def torque(at: Any) -> Any:
        return np.stack([np.sin(3.0 * at) + 0.3 * np.cos(8.0 * at), 2.0 * np.cos(5.0 * at)], axis=-1)

    measured = torque(time - late)
    change = (torque(time - late + 1e-6) - torque(time - late - 1e-6)) / 2e-6
    rows = SimpleNamespace(regressor=torque(time)[..., None], torque=measured, change=change, time=time)
    whole = {"fitted_rows": lambda settings: rows, "counted": lambda settings: np.ones((2000, 2))}
    evidence: Any = SimpleNamespace(blocks=10, **whole)
    fit: Any = SimpleNamespace(settings=SimpleNamespace(cutoff=5.0), deviations=np.array([1.0, 3.0]), x=np.ones(1))
    found = estimated_delay(evidence, fit, np.zeros((1, 1)), Student(10))
    assert found.value == pytest.approx(late, abs=2e-5)
    assert found.deviation < 1e-4


def test_rates_are_those_of_neighbouring_rows() -> None:
    time = np.array([0.0, 0.1, 0.2, 0.3, 1.0, 1.1, 1.2])
    found = _rate(SimpleNamespace(time=time), 3.0 * np.arange(7.0)[:, None])  # type: ignore[arg-type]
    assert found[:, 0] == pytest.approx([0.0, 30.0, 30.0, 0.0, 0.0, 30.0, 0.0])


@pytest.mark.parametrize(
    ("value", "deviation", "told"),
    [
        (0.0041, 5e-4, "the torques are 4.1 ms later than the positions (95 % within 3.12 to 5.08 ms), but not"),
        (0.003, 3e-4, "the torques are 3 ms later than the positions (95 % within 2.41 to 3.59 ms)"),
        (-0.003, 3e-4, "the torques are 3 ms earlier than the positions (95 % within -3.59 to -2.41 ms)"),
        (0.002, 3e-4, "the torques are 2 ms later than the positions (95 % within 1.41 to 2.59 ms), not beyond doubt"),
        (0.0009, 3e-4, "none: 95 % within 0.312 to 1.49 ms"),
        (0.0009, 5e-5, "none: 95 % within"),
        (0.003, 5e-4, "95 % within 2.02 to 3.98 ms: not determinable to 1 ms"),
    ],
)  # fmt: skip
def test_a_delay_is_told_as_surely_as_it_is_known(value: float, deviation: float, told: str) -> None:
    found = Delay(value, deviation, np.zeros(1))
    assert found.outcome.startswith(told)
    assert found.counts == (abs(value) > max(8.0 * deviation, 1e-3))
    assert found.determinable == (deviation <= 1e-3 / 3.0)


def test_cutoffs_are_longer_than_a_log_and_below_half_its_rate() -> None:
    grids = [SimpleNamespace(rate=rate, samples=n) for rate, n in ((100.0, 50), (80.0, 100))]
    own: Any = SimpleNamespace(_grids=grids)
    for cutoff in (4.01, 39.9):
        Stretches.validate(own, cutoff)
    for cutoff in (3.99, 4.0, 40.0, 40.1):
        with pytest.raises(InputError, match="cutoff: expected between 4 and 40 Hz"):
            Stretches.validate(own, cutoff)


def test_impossible_samples_are_jumps_that_come_back() -> None:
    smooth = 0.01 * np.sin(0.05 * np.arange(400))
    spiked = smooth.copy()
    spiked[100:103] += 1.0
    assert np.flatnonzero(_impossible(spiked)[0]).tolist() == [100, 101, 102]
    stepped = smooth + (np.arange(400) >= 100)
    assert not _impossible(stepped)[0].any()
    assert not _impossible(smooth)[0].any()
    kept = np.r_[0:100, 112:400]
    swing = np.sin(0.05 * kept + 0.75)
    none, periods = np.zeros(len(kept), dtype=np.bool_), np.diff(kept).astype(np.float64)
    assert not _impossible(swing)[0].any()
    assert slips(swing, np.ones(len(periods)), none) == [100]
    assert slips(swing, periods, none) == []
    torque = np.sin(0.05 * np.arange(400))
    torque[200] += 1.5
    assert np.flatnonzero(_spiked(torque)).tolist() == [200]


def test_clipped_and_frozen_torques_are_runs_of_one_value() -> None:
    rng = np.random.default_rng(6)
    torque = np.round(10.0 * np.sin(0.03 * np.arange(2000)) + rng.normal(size=2000), 2)
    assert list(_clipped(torque)) == []
    clipped = np.clip(torque, -8.0, 7.0)
    assert list(_clipped(clipped)) == [(7.0, int((clipped == 7.0).sum())), (-8.0, int((clipped == -8.0).sum()))]
    time = moves = np.arange(2000) / 200.0
    assert _frozen(torque, moves, time) == (0, 0)
    frozen = torque.copy()
    frozen[700:760] = 3.21
    assert _frozen(frozen, moves, time) == (700, 760)
    assert _frozen(frozen, 0.0 * moves, time) == (0, 0)  # at rest a torque may stay
    assert _frozen(frozen, moves, time / 4.0) == (0, 0)  # for less than a tenth of a second
    frozen[700:760] = torque.max() + 1.0
    assert _frozen(frozen, moves, time) == (0, 0)  # a limit


def test_a_quantum_is_the_step_of_an_encoder() -> None:
    fine = np.sin(0.01 * np.arange(3000))
    assert _quantum(fine) == 0.0
    assert _quantum(np.round(fine / 0.01) * 0.01) == pytest.approx(0.01)
    assert _quantum(np.ones(10)) == 0.0


def motion(scale: float = 1.0) -> RobotMotion:
    swing = Sinusoids(
        np.array([0.1, 0.2]), np.array([[0.5, 0.3], [0.1, 0.2]]), np.array([[0.2, 0.2], [0.4, 0.4]]), start_time=0.0
    )
    return RobotMotion(swing, np.array([0.3, -0.2]), np.array([-0.1, 0.4]), period=5.0, fade=2.0, time_scale=scale)


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_a_motion_goes_from_rest_to_rest_with_its_own_derivatives(scale: float) -> None:
    moved = motion(scale)
    assert moved.duration == pytest.approx(9.0 * scale)
    time = np.linspace(0.05, moved.duration - 0.05, 400)
    step = 1e-5
    parts, after, before = moved.at(time), moved.at(time + step), moved.at(time - step)
    for k in range(3):
        slope = (after[k] - before[k]) / (2.0 * step)
        np.testing.assert_allclose(parts[k + 1], slope, rtol=1e-4, atol=1e-5)
    ends = moved.at([0.0, moved.duration])
    np.testing.assert_allclose(ends[0], [[0.3, -0.2], [-0.1, 0.4]], atol=1e-12)
    for k in (1, 2):
        np.testing.assert_allclose(ends[k], 0.0, atol=1e-9)
    inside = np.array([3.0, 5.0, 6.5])  # between the blends, of the slower time
    np.testing.assert_allclose(moved.at(scale * inside)[0], moved.reference(inside - 2.0).p, atol=1e-9)
    sampled = moved.sampled(100.0)
    assert len(sampled[0]) == round(100.0 * moved.duration) + 1
    assert (sampled[0][0], sampled[0][-1]) == (0.0, pytest.approx(moved.duration))


def test_limits_of_a_motion_are_a_share_of_the_arms() -> None:
    found = RobotLimits.of(ARM, 0.5, acceleration=3.0)
    assert found.velocity.tolist() == [3.0, 3.0]
    assert found.torque.tolist() == [30.0, 12.5]
    assert found.acceleration.tolist() == [3.0, 3.0]
    assert np.isinf(found.jerk).all()
    for wrong in (0.0, -1.0, [1.0, 0.0]):
        with pytest.raises(InputError, match="jerk: expected positive numbers"):
            RobotLimits.of(ARM, 0.5, jerk=wrong)


def test_a_workspace_is_a_box_and_what_collides() -> None:
    level = np.zeros((1, 2))  # the elbow at 0.4 m, the tip's frame at 0.7 m
    for reach, inside in ((0.71, True), (0.69, False)):
        space = ReachableSpace(ARM, np.full(3, -1.0), np.array([reach, 1.0, 1.0]), None)
        assert space.allows(level) is inside
    space = ReachableSpace(ARM, np.array([0.1, -1.0, -1.0]), np.full(3, 1.0), None)
    assert space.allows(level) is True
    assert space.allows(np.array([[0.0, 0.0], [np.pi, 0.0]])) is False  # any of the positions
    whole = np.full(3, np.inf)
    hits = ReachableSpace(ARM, -whole, whole, lambda q: q[0] > 1.0)
    assert hits.allows(np.array([[0.5, 0.0], [0.9, 0.0]])) is True
    assert hits.allows(np.array([[0.5, 0.0], [1.1, 0.0]])) is False
