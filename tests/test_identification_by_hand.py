"""What identification does, on numbers small enough to be reckoned by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import constants
from synthetic_logs import known

from adaptctl.arrays import Array
from adaptctl.description import JointKind, Limits
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.dynamics import Mechanism
from adaptctl.errors import FileError, InputError
from adaptctl.identification import Validation
from adaptctl.identification.columns import JointLog, joint_log
from adaptctl.identification.drives_file import Drives, MotorEntry, Units
from adaptctl.identification.earlier_motion import earlier_motion
from adaptctl.identification.entropic import EntropicPrior
from adaptctl.identification.least_squares import halves
from adaptctl.identification.loaded_fit import LoadedEquations, loaded_fit
from adaptctl.identification.log_files import table
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.identification.preparation import PreparedLog, prepare
from adaptctl.identification.regular_range import _filling
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


def test_halves_of_a_log_share_torques_that_are_smoothed_and_see_the_motion_by_other_samples() -> None:
    """Torques by 1-2-1 over four: a line stays, and what changes sign with each sample, of which half the rate has
    none, is gone. One half has the even samples, the other the mean of the odd ones beside them."""
    time = np.arange(101) / RATE
    line, by_turns = 3.0 + 2.0 * time, np.where(np.arange(101) % 2 == 0, 1.0, -1.0)
    p = np.random.default_rng(0).normal(size=(101, 1))
    log = PreparedLog("some.csv", RATE, time, p, np.stack([line, by_turns], axis=-1), np.arange(101) > 50)
    own, other = halves(log)
    even = np.searchsorted(time, own.time)
    np.testing.assert_array_equal(even, np.arange(2, 2 + 2 * len(even), 2))
    assert 48 <= len(even) <= 50
    for half in (own, other):
        assert half.rate == 0.5 * RATE
        np.testing.assert_array_equal(half.time, time[even])
        np.testing.assert_array_equal(half.moving, even > 50)
        np.testing.assert_allclose(half.torque, np.stack([line[even], np.zeros(len(even))], axis=-1), atol=1e-14)
    np.testing.assert_array_equal(own.position, p[even])
    np.testing.assert_allclose(other.position, 0.5 * (p[even - 1] + p[even + 1]), rtol=1e-14)


UNITS = {
    "time": {"s": 1.0, "ms": constants.milli, "us": constants.micro, "ns": constants.nano},
    "position": {"rad": 1.0, "deg": constants.degree, "rev": 2.0 * constants.pi, "m": 1.0, "mm": constants.milli},
    "velocity": {
        "rad/s": 1.0,
        "deg/s": constants.degree,
        "rpm": 2.0 * constants.pi / constants.minute,
        "m/s": 1.0,
        "mm/s": constants.milli,
    },
    "torque": {"N m": 1.0, "Nm": 1.0, "mN m": constants.milli, "mNm": constants.milli, "N": 1.0},
}
"""All units that a log may have, in SI units by SciPy's constants."""


@pytest.mark.parametrize(("what", "unit"), [(what, unit) for what, units in UNITS.items() for unit in units])
def test_columns_are_taken_to_si_units_by_their_own_factors(what: str, unit: str) -> None:
    """Through a motor that turns 50 times as fast as its joint: its other columns stay as they are."""
    given = {"time": "s", "position": "rad", "velocity": "rad/s", "torque": "N m"} | {what: unit}
    rng, count = np.random.default_rng(1), 120
    found = dict(zip(("position", "velocity", "torque"), rng.normal(size=(3, count)), strict=True))
    found["time"] = np.cumsum(rng.uniform(0.5, 1.5, count))
    motor = MotorEntry(name="m", position="position", torque="torque", velocity="velocity")
    drives = Drives(("j",), np.array([[50.0]]), np.array([0.3]), (motor,), "time", Units.checked(**given))
    log = joint_log(table("some.csv", found.items()), drives)
    assert log.velocity is not None
    si = {name: values * (UNITS[name][unit] if name == what else 1.0) for name, values in found.items()}
    np.testing.assert_allclose(log.time, si["time"], rtol=1e-14)
    np.testing.assert_allclose(log.position[:, 0], si["position"] / 50.0 + 0.3, rtol=1e-14)
    np.testing.assert_allclose(log.velocity[:, 0], si["velocity"] / 50.0, rtol=1e-14)
    np.testing.assert_allclose(log.torque[:, 0], si["torque"] * 50.0, rtol=1e-14)


@pytest.mark.parametrize("samples", [99, 100])
def test_a_log_has_a_hundred_samples(samples: int) -> None:
    motor = MotorEntry(name="m", position="p", torque="tau")
    drives = Drives(("j",), np.eye(1), np.zeros(1), (motor,), "t", Units(1.0, 1.0, 1.0))
    time = np.arange(samples) / RATE
    log = table("some.csv", {"t": time, "p": np.sin(time), "tau": np.cos(time)}.items())
    if samples < 100:
        with pytest.raises(FileError, match=f"has {samples} samples"):
            joint_log(log, drives)
    else:
        assert len(joint_log(log, drives)) == samples


def limited(**limits: float) -> Mechanism:
    """A chain all of whose joints have these limits, and no others."""
    chain = known(0).guess
    own = Limits(**limits)
    links = tuple(replace(link, joint=replace(link.joint, limits=own)) for link in chain.description.links)
    return Mechanism(replace(chain.description, links=links))


def swinging(amplitude: float = 1.0, torque: float = 1.0, jitter: float = 0.0, rate: float = RATE) -> JointLog:
    """Eight seconds of a sine of 1 rad/s about zero, its torques, and stamps that go to and fro by a share."""
    time = np.arange(round(8.0 * RATE)) / rate
    stamps = time + jitter / rate * np.where(np.arange(len(time)) % 2 == 0, 0.0, 1.0)
    log = log_of(stamps, amplitude * np.sin(time))
    return replace(log, torque=torque * np.tile(np.cos(time)[:, None], 3))


@pytest.mark.parametrize(
    ("limits", "log", "what"),
    [
        ({"velocity": 1.0}, lambda share: swinging(3.0 * share), "moves at"),
        ({"lower": -1.0}, lambda share: swinging(1.25 * share), "moves from"),
        ({"upper": 1.0}, lambda share: swinging(1.25 * share), "moves from"),
        ({"effort": 4.0}, lambda share: swinging(torque=12.0 * share), "has a torque"),
        ({}, lambda share: swinging(rate=1e5 * share), "the sampling rate"),
        ({}, lambda share: swinging(rate=20.0 / share), "the sampling rate"),
    ],
    ids=["speed", "lower", "upper", "effort", "fast", "slow"],
)
def test_logs_pass_up_to_what_is_stated_of_the_robots_limits_and_of_rates(
    limits: dict[str, float], log: Callable[[float], JointLog], what: str
) -> None:
    """Three times speeds and torques, a quarter of a rad beyond a range, 20 Hz and 100 kHz."""
    arm, skip = limited(**limits), ("velocities",)
    prepare(log(0.98), arm, skip)
    with pytest.raises(InputError, match=what):
        prepare(log(1.02), arm, skip)


@pytest.mark.parametrize(("spikes", "passes"), [(4, True), (12, False)])
def test_a_hundredth_of_the_samples_may_be_spikes(spikes: int, passes: bool) -> None:
    log = swinging()
    log.torque[100 : 100 + 20 * spikes : 20] = 50.0
    if passes:
        prepare(log, limited(effort=4.0))
    else:
        with pytest.raises(InputError, match="has a torque of 50 "):
            prepare(log, limited(effort=4.0))


@pytest.mark.parametrize(("moving", "passes"), [(0.2, False), (0.5, True)])
def test_a_log_moves_for_fifty_samples(moving: float, passes: bool) -> None:
    """Half a second at 100 Hz, of which the filter adds a fifth to a motion."""
    time = np.arange(0.0, 4.0, 1.0 / RATE)
    log = log_of(time, np.clip(time - 2.0, 0.0, moving))
    if passes:
        (piece,), _ = prepare(log, limited())
        assert 50 <= np.count_nonzero(piece.moving) < 100
    else:
        with pytest.raises(InputError, match="at rest throughout"):
            prepare(log, limited(), ("velocities",))


@pytest.mark.parametrize(("ratio", "passes"), [(0.92, True), (1.08, True), (0.88, False), (1.12, False)])
def test_velocities_may_be_a_tenth_off(ratio: float, passes: bool) -> None:
    log = swinging()
    log = replace(log, velocity=ratio * np.tile(np.cos(log.time)[:, None], 3))
    if passes:
        prepare(log, limited())
    else:
        with pytest.raises(InputError, match="logged velocities"):
            prepare(log, limited())


@pytest.mark.parametrize(("jitter", "even"), [(0.008, True), (0.015, False)])
def test_stamps_a_hundredth_of_a_period_off_are_even(jitter: float, even: bool) -> None:
    log = swinging(jitter=jitter)
    (piece,), _ = prepare(log, limited())
    assert np.array_equal(piece.time, log.time) is even
    steps = np.diff(piece.time)
    assert bool(np.ptp(steps) < 1e-9 / RATE) is not even
    assert steps.mean() == pytest.approx(1.0 / RATE, rel=1e-3)


def test_turns_are_put_together_again_and_slides_are_left_where_they_are() -> None:
    arm = limited()
    kinds = (JointKind.REVOLUTE, JointKind.PRISMATIC, JointKind.REVOLUTE)
    links = [
        replace(link, joint=replace(link.joint, kind=kind))
        for link, kind in zip(arm.description.links, kinds, strict=True)
    ]
    arm = Mechanism(replace(arm.description, links=tuple(links)))
    time = np.arange(800) / RATE
    whole = 2.0 * time
    log = log_of(time, (whole + math.pi) % (2.0 * math.pi) - math.pi)
    (piece,), steps = prepare(log, arm)
    np.testing.assert_allclose(piece.position[:, [0, 2]], whole[:, None] * np.ones(2), atol=1e-12)
    np.testing.assert_array_equal(piece.position[:, 1], log.position[:, 1])
    jumps = int(np.sum(np.diff(log.position[:, 1]) < -1.0))
    assert next(step.outcome for step in steps if step.name == "unwrap").startswith(f"{2 * jumps} jumps")
    assert jumps == 3


@pytest.mark.parametrize(("samples", "pieces"), [(49, 1), (50, 2)])
def test_fifty_samples_between_gaps_are_a_piece(samples: int, pieces: int) -> None:
    time = np.concatenate([np.arange(300), 400 + np.arange(samples)]) / RATE
    found, _ = prepare(log_of(time, np.sin(5.0 * time)), limited())
    assert [len(piece.time) for piece in found] == [300, samples][:pieces]


@pytest.mark.parametrize(("share", "moves"), [(2.0, True), (0.5, False)])
@pytest.mark.parametrize("greatest", [1.0, 0.01])
def test_an_arm_slower_than_a_hundredth_of_its_speed_or_a_milliradian_rests(
    greatest: float, share: float, moves: bool
) -> None:
    """Two seconds at a steady speed, then three at twice or half the least that counts: a hundredth of 1 rad/s, and a
    milliradian per second after 0.01 rad/s."""
    time = np.arange(0.0, 5.0, 1.0 / RATE)
    slow = share * max(0.01 * greatest, 1e-3)
    log = log_of(time, greatest * np.minimum(time, 2.0) + slow * np.maximum(time - 2.0, 0.0))
    (piece,), _ = prepare(log, limited(), ("resample",))  # whose check takes steps of all speeds for the rate's
    assert bool(piece.moving[time > 2.5].all()) is moves
    assert bool(piece.moving[time > 2.5].any()) is moves
    assert piece.moving[time < 1.9].all()


def mean_of(blocks: list[Array], prior: float, precision: float, weight: float = 1.0) -> tuple[Any, Any]:
    """Evidence and fit of one number from samples of deviation 1 in blocks, and from a prior of it: the number that
    makes sum (x - y)^2 + precision (x - prior)^2 least."""
    count, total = sum(map(len, blocks)), sum(float(block.sum()) for block in blocks)
    x = np.array([(total + precision * prior) / (count + precision)])
    links = SimpleNamespace(
        hold=lambda x, weight: np.array([[precision]]),
        tens=np.zeros(1),
        distance=lambda x: 0.5 * precision / weight * float(x[0] - prior) ** 2,
    )

    def equations(settings: object, chosen: list[int]) -> Any:
        block = blocks[chosen[0]]
        return SimpleNamespace(whitened=lambda deviations: (np.array([[float(len(block))]]), np.array([block.sum()])))

    evidence = SimpleNamespace(
        mechanism=None,
        prior_of=lambda settings: links,
        blocks=len(blocks),
        equations=equations,
        independent=lambda settings: np.array([0]),
    )
    settings = SimpleNamespace(columns=lambda mechanism: np.ones(1), weight=weight, cutoff=10.0)
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


def test_motors_with_little_noise_count_for_more_in_torque_constants() -> None:
    """As weights by the true deviations have it (Gauss and Markov), which nobody gives: residuals tell, in rounds."""
    rng, n, c = np.random.default_rng(2), 300, np.array([1.0, -0.4])
    Y, v = rng.normal(size=(n, 2, 14)), rng.normal(size=(n, 2))
    Y[..., 10:] = 0.0
    for k in range(2):
        Y[:, k, 10 + k], Y[:, k, 12 + k] = v[:, k], np.sign(v[:, k])
    x = np.concatenate([from_center_of_mass(2.0, [0.1, 0.0, 0.2], 0.1 * np.eye(3)), [0.5, 0.5, 0.2, 0.2]])
    column = (Y @ x) * c + np.array([0.002, 0.5]) * rng.normal(size=(n, 2))
    parts = [(Y[:, k].T @ Y[:, k], Y[:, k].T @ column[:, k], column[:, k] @ column[:, k], float(n)) for k in range(2)]
    sums = NormalEquations(*(np.stack(part)[None] for part in zip(*parts, strict=True)))
    guess = from_center_of_mass(3.0, [0.0, 0.1, 0.1], 0.2 * np.eye(3))
    prior = EntropicPrior(guess[None], np.arange(10, 14), np.ones(4))
    friction = np.array([[10, 12], [11, 13]])
    found = loaded_fit(LoadedEquations(sums, prior, (), np.array([1]), np.arange(14), friction))
    rows = np.concatenate([Y[:, 0], c[1] * Y[:, 1]])
    alike = np.linalg.lstsq(rows, np.concatenate(list(column.T)))[0]
    best = np.linalg.lstsq(Y[:, 0], column[:, 0])[0]
    assert np.abs(found.x - x)[:10].max() < 0.02 * np.abs(alike - best)[:10].max()
    assert found.c == pytest.approx(c, rel=0.1)


def test_errors_are_compared_with_themselves_about_their_mean() -> None:
    """Errors that go up and down by turns about 5 N m are opposite at odd lags, however far their mean is from zero."""
    n = 40
    error = 5.0 + np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    measured, errors = np.zeros((n, 2)), np.stack([error, 0.5 * error - 7.0], axis=-1)
    validation = Validation("made up", 10.0, np.arange(n) / RATE, measured, errors)
    expected = [(-1.0) ** k * (n - k) / n for k in range(6)]
    np.testing.assert_allclose(validation.autocorrelation(5), np.stack([expected] * 2, axis=-1), rtol=1e-12)


def test_errors_of_torques_are_roots_of_mean_squares_and_parts_of_what_was_measured() -> None:
    """Errors of 0 and 1 N m in one joint, 1 and -1 in another that was to do nothing."""
    measured, predicted = np.array([[3.0, 0.0], [4.0, 0.0]]), np.array([[3.0, 1.0], [5.0, -1.0]])
    found = Validation("made up", 10.0, np.arange(2.0), measured, predicted)
    np.testing.assert_array_equal(found.error, [[0.0, 1.0], [1.0, -1.0]])
    assert found.rms_error == pytest.approx(math.sqrt(3 / 4), rel=1e-15)
    assert found.relative_error == pytest.approx(math.sqrt(3) / 5, rel=1e-15)
    np.testing.assert_allclose(found.joint_rms_errors, [math.sqrt(1 / 2), 1.0], rtol=1e-15)
    np.testing.assert_allclose(found.joint_relative_errors, [1 / 5, math.inf], rtol=1e-15)


def test_an_earlier_motion_has_fifty_rows_a_second_and_its_derivatives() -> None:
    """Of each log, one after the other."""
    case = known(7, links=2, duration=4.0, rate=200.0)
    p, v, a = (np.split(part, 2) for part in earlier_motion(case.guess, [case.log, case.log]))
    for position, speed, acceleration in zip(p, v, a, strict=True):
        assert 180 < len(position) <= 200
        for values, slope in ((position, speed), (speed, acceleration)):
            off = (np.gradient(values, 0.02, axis=0) - slope)[5:-5]
            assert np.abs(off).max() < 0.03 * np.abs(slope).max()


def test_points_that_fill_a_box_are_on_its_faces_half_the_time() -> None:
    points = _filling(np.random.default_rng(0), 3)
    assert points.shape == (1000, 3)
    shares = [np.mean(points == 0.0), np.mean(points == 1.0), np.mean((points > 0.0) & (points < 1.0))]
    assert shares == pytest.approx([0.25, 0.25, 0.5], abs=0.03)
