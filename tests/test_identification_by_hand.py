"""What identification does, on numbers small enough to be reckoned by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from synthetic_logs import known

from adaptctl.arrays import Array
from adaptctl.identification import Validation
from adaptctl.identification.columns import JointLog
from adaptctl.identification.drives_file import Units
from adaptctl.identification.preparation import prepare
from adaptctl.identification.torque_constants import _solved
from adaptctl.identification.uncertainty import uncertainty

RATE = 100.0


def log_of(time: Array, position: Array) -> JointLog:
    """A log of three joints that move alike."""
    return JointLog("some.csv", time, np.tile(position[:, None], 3), np.ones((len(time), 3)))


def pausing(pause: float) -> JointLog:
    """Two seconds of steady motion, a pause, and two more."""
    time = np.arange(0.0, 4.0 + pause, 1.0 / RATE)
    return log_of(time, 0.5 * (np.minimum(time, 2.0) + np.maximum(time - 2.0 - pause, 0.0)))


@pytest.mark.parametrize(("pause", "dropped"), [(0.05, False), (0.5, True), (0.8, True), (1.5, True)])
def test_pauses_of_a_tenth_of_a_second_or_more_are_dropped(pause: float, dropped: bool) -> None:
    """All but their ends, where the filter still sees the motion."""
    (piece,), _ = prepare(pausing(pause), known(0).guess)
    resting = np.count_nonzero(~piece.moving) / RATE
    if dropped:
        assert pause - 0.25 <= resting <= pause
        assert not piece.moving[np.searchsorted(piece.time, 2.0 + 0.5 * pause)]
    else:
        assert resting == 0.0


@pytest.mark.parametrize(("periods", "pieces"), [(7, 1), (9, 2), (20, 2), (60, 2), (200, 2)])
def test_a_step_of_more_than_eight_periods_is_a_hole(periods: int, pieces: int) -> None:
    time = np.concatenate([np.arange(200), 199 + periods + np.arange(200)]) / RATE
    found, _ = prepare(log_of(time, np.sin(time)), known(0).guess)
    assert [len(piece.time) for piece in found] == [400 // pieces] * pieces


def test_a_revolution_is_a_whole_turn_at_which_ever_unit() -> None:
    turns, degrees = Units.checked("s", "rev", "N m", "rpm"), Units.checked("s", "deg", "N m", "deg/s")
    assert turns.position == pytest.approx(360.0 * degrees.position, rel=1e-15)
    assert turns.velocity == pytest.approx(turns.position / 60.0, rel=1e-15)
    assert math.cos(turns.position) == pytest.approx(1.0, abs=1e-15)
    assert math.cos(0.5 * turns.position) == pytest.approx(-1.0, abs=1e-15)


def mean_of(blocks: list[Array], prior: float, precision: float, weight: float = 1.0) -> tuple[Any, Any]:
    """Evidence and fit of one number from samples of deviation 1 in blocks, and from a prior of it: the number that
    makes sum (x - y)^2 + precision (x - prior)^2 least."""
    count, total = sum(map(len, blocks)), sum(float(block.sum()) for block in blocks)
    x = np.array([(total + precision * prior) / (count + precision)])
    links = SimpleNamespace(
        curvature=lambda x, weight: np.array([[precision]]),
        tens=np.zeros(1),
        distance=lambda x: 0.5 * precision / weight * float(x[0] - prior) ** 2,
    )

    def equations(cutoff: float, chosen: list[int], load: object) -> Any:
        block = blocks[chosen[0]]
        return SimpleNamespace(whitened=lambda deviations: (np.array([[float(len(block))]]), np.array([block.sum()])))

    evidence = SimpleNamespace(
        mask=lambda friction: np.ones(1),
        prior_of=lambda friction: links,
        blocks=len(blocks),
        load_from=lambda settings, blocks: None,
        equations=equations,
    )
    settings = SimpleNamespace(friction=None, weight=weight, cutoff=10.0)
    return evidence, SimpleNamespace(settings=settings, x=x, curvature=np.array([[float(count)]]), deviations=None)


def blocks_of(sizes: list[int]) -> list[Array]:
    rng = np.random.default_rng(4)
    return [3.0 + rng.normal() + rng.normal(size=size) for size in sizes]


def test_the_deviation_of_a_mean_is_its_standard_error_over_blocks() -> None:
    """s/sqrt(n) of the n blocks' means, of which the textbooks say what it is, and not 1/sqrt of the samples."""
    blocks = blocks_of([10] * 5)
    evidence, fit = mean_of(blocks, 0.0, 0.0)
    found = uncertainty(evidence, fit)
    means = np.array([block.mean() for block in blocks])
    assert found.covariance[0, 0] == pytest.approx(means.var(ddof=1) / 5, rel=1e-12)
    assert found.nominal[0, 0] == pytest.approx(1.0 / 50, rel=1e-12)


@pytest.mark.parametrize("sizes", [[10] * 5, [3, 20, 8], [1, 1, 30, 2]])
def test_estimates_without_each_block_in_turn_vary_about_their_own_mean(sizes: list[int]) -> None:
    """The jackknife by its definition: the estimate is made anew without each block."""
    blocks, prior, precision, weight = blocks_of(sizes), 1.0, 20.0, 0.5
    evidence, fit = mean_of(blocks, prior, precision, weight)
    left = [np.concatenate([other for other in blocks if other is not block]) for block in blocks]
    without = np.array([(y.sum() + precision * prior) / (len(y) + precision) for y in left])
    n, H = len(blocks), sum(sizes) + precision
    sampled = (n - 1) / n * np.square(without - without.mean()).sum()
    # The prior's pull moves the estimate by precision (prior - truth)/H, and a truth that is as far from the prior as
    # the estimate says by `misfit`, in the prior's own deviations, makes this the square of it.
    misfit = (precision / weight) * float(fit.x[0] - prior) ** 2
    deviation = misfit * weight / precision
    biased = (precision / H) ** 2 * deviation
    assert uncertainty(evidence, fit).covariance[0, 0] == pytest.approx(sampled + biased, rel=1e-12)


def test_the_bias_of_a_firm_prior_is_in_the_deviation() -> None:
    """What 30 samples about 2 say of a number that the prior takes to be 0: the estimate is off by more than noise, and
    says so."""
    block = 2.0 + 0.01 * np.random.default_rng(0).normal(size=10)
    evidence, fit = mean_of([block, block, block], 0.0, 3.0)
    off = 2.0 - float(fit.x[0])
    assert off == pytest.approx(2.0 / 11, rel=0.02)
    assert uncertainty(evidence, fit).of(np.eye(1))[0] == pytest.approx(off, rel=0.1)


def test_joints_with_little_noise_count_for_more_in_torque_constants() -> None:
    """As weights by the true deviations have it (Gauss and Markov), which nobody gives: residuals tell, in rounds."""
    rng, n, constant, beta = np.random.default_rng(2), 300, 1.7, 0.6
    Y, W = rng.normal(size=(n, 2, 1)), rng.normal(size=(n, 2, 1))
    deviations = np.array([0.002, 0.5])
    wanted = Y[..., 0] * beta - W[..., 0] * constant + deviations * rng.normal(size=(n, 2))

    def fitted(weights: Array) -> float:
        rows = (np.concatenate([Y, -W], axis=-1) * weights[:, None]).reshape(-1, 2)
        return float(np.linalg.lstsq(rows, (wanted * weights).ravel())[0][1])

    best, alike = fitted(1.0 / deviations), fitted(np.ones(2))
    found = float(_solved(Y, W, wanted)[0])
    assert abs(best - constant) < 4 * 0.002 / math.sqrt(n)
    assert abs(alike - best) > 0.005
    assert abs(found - best) < 1e-3 * abs(alike - best)


def test_errors_are_compared_with_themselves_about_their_mean() -> None:
    """Errors that go up and down by turns about 5 N m are opposite at odd lags, however far their mean is from zero."""
    n = 40
    error = 5.0 + np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    measured, errors = np.zeros((n, 2)), np.stack([error, 0.5 * error - 7.0], axis=-1)
    validation = Validation("made up", 10.0, np.arange(n) / RATE, measured, errors)
    expected = [(-1.0) ** k * (n - k) / n for k in range(6)]
    np.testing.assert_allclose(validation.autocorrelation(5), np.stack([expected] * 2, axis=-1), rtol=1e-12)
