"""Excitation: what a motion tells of the parameters, and references made to tell more."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from nightly import nightly
from random_trees import random_chain

from adaptctl.arrays import Array
from adaptctl.control import (
    ComputedTorque,
    ExcitationTrajectory,
    MotionLimits,
    Sinusoids,
    excitation_trajectory,
    persistent_excitation,
    torque_uncertainty,
)
from adaptctl.control.excitation.excitation_trajectory import SAMPLES_PER_PERIOD, FourierSearch, _gram
from adaptctl.control.excitation.measure import BLOCKS_PER_WINDOW, regressor_of, scaled_regressor
from adaptctl.description import Description, JointKind, Limits
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import rollout


@cache
def model(name: str) -> ReducedModel:
    mechanism = load(name)
    return ReducedModel(mechanism)


def exactly(reference: Sinusoids, duration: float, period: float = 0.01) -> SimpleNamespace:
    """A run that follows a reference without error."""
    p, v, a = reference(np.arange(round(duration / period)) * period)
    return SimpleNamespace(p=p, v=v, reference_p=p, reference_v=v, reference_a=a, sample_time=period)


def swings(model: ReducedModel, seed: int = 0) -> Sinusoids:
    rng = np.random.default_rng(seed)
    r = model.mechanism.dof
    return Sinusoids(rng.normal(size=r), rng.uniform(0.3, 1.0, (3, r)), rng.uniform(0.1, 1.0, (3, r)), start_time=0.0)


@pytest.mark.parametrize("name", ["puma560_friction", "semi_direct_drive"])
def test_the_compiled_regressor_is_the_models(name: str) -> None:
    of = model(name)
    rng, r = np.random.default_rng(0), of.mechanism.dof
    p = of.mechanism.neutral_configuration + 0.05 * rng.normal(size=(5, r))
    v, v_r, a_r = rng.normal(size=(3, 5, r))
    np.testing.assert_allclose(regressor_of(of)(p, v, v_r, a_r), of.slotine_li_regressor(p, v, v_r, a_r), atol=1e-11)


def test_eigenvalues_are_those_of_the_gram_matrix() -> None:
    of = model("puma560_geared")
    run = exactly(swings(of), 6.0)
    found = persistent_excitation(of, run, 1.6)
    rows = scaled_regressor(of, run.p, run.v, run.v, run.reference_a)
    assert found.window == pytest.approx(1.6)
    for end, smallest, largest in list(
        zip(found.time, found.smallest_eigenvalue, found.largest_eigenvalue, strict=True)
    )[::10]:
        stop = round(end / 0.01)
        Y = rows[stop - 160 : stop].reshape(-1, rows.shape[-1])
        values = np.linalg.eigvalsh(0.01 * Y.T @ Y)
        assert largest == pytest.approx(values[-1], rel=1e-9)
        assert smallest == pytest.approx(values[0], rel=1e-5, abs=1e-13 * values[-1])
    assert found.min_eigenvalue == found.smallest_eigenvalue.min()
    np.testing.assert_allclose(found.condition, np.sqrt(found.largest_eigenvalue / found.smallest_eigenvalue))


def test_an_arm_at_rest_tells_next_to_nothing_and_longer_windows_tell_more() -> None:
    of = model("puma560_geared")
    still = Sinusoids(np.zeros(6), np.zeros((1, 6)), np.ones((1, 6)), start_time=0.0)
    assert persistent_excitation(of, exactly(still, 3.0), 2.0).min_eigenvalue < 1e-20
    run = exactly(swings(of), 8.0)
    levels = [persistent_excitation(of, run, window).min_eigenvalue for window in (1.0, 2.0, 4.0)]
    assert 0.0 < levels[0] < levels[1] < levels[2]


def test_redundant_parameters_are_never_excited() -> None:
    """All 66: whatever the motion, the Gram matrix has the rank of the essential space."""
    of = ReducedModel.full(load("puma560_geared"))
    found = persistent_excitation(of, exactly(swings(of), 4.0), 4.0, scale=1.0)
    assert found.min_eigenvalue < 1e-20 * found.largest_eigenvalue.max()
    run = exactly(swings(of), 4.0)
    rows = scaled_regressor(of, run.p, run.v, run.v, run.reference_a, 1.0)
    assert np.abs(rows @ found.weakest_direction).max() < 1e-9 * np.abs(rows).max()


def test_the_weakest_direction_is_learned_as_slowly_as_the_smallest_eigenvalue_says() -> None:
    """Of a slow gradient estimator, error' = -gamma Y'Y error, the square shrinks by 2 gamma times it, no more."""
    chain = random_chain(4, 2).with_drives(Drive(rotor_inertia=0.3))
    of = ReducedModel(chain)
    run = exactly(swings(of), 4.0, 1e-3)
    found = persistent_excitation(of, run, 4.0)
    rows = scaled_regressor(of, run.p, run.v, run.v, run.reference_a)
    gain = 1e-2 * found.min_eigenvalue / found.largest_eigenvalue[0] ** 2
    rng = np.random.default_rng(0)
    for start, slowest in ((found.weakest_direction, True), (rng.normal(size=len(found.weakest_direction)), False)):
        error = start / np.linalg.norm(start)
        for Y in rows:
            error = error - 1e-3 * gain * Y.T @ (Y @ error)
        shrunk = -np.expm1(2.0 * np.log(np.linalg.norm(error)))
        assert shrunk >= 0.98 * 2.0 * gain * found.min_eigenvalue
        assert (shrunk < 1.02 * 2.0 * gain * found.min_eigenvalue) == slowest


def test_a_rollout_is_measured_along_what_its_law_wants() -> None:
    of = model("puma560_geared")
    env = TrackingEnv(of.mechanism, 1, duration=1.0, initial_error=0.2)
    run = rollout(env, ComputedTorque(of.mechanism, 5.0), seed=0)
    wanted = persistent_excitation(of, run, 0.48, bandwidth=5.0)
    plain = persistent_excitation(of, run, 0.48)
    v_r = run.reference_v - 5.0 * run.error
    a_r = run.reference_a - 5.0 * run.velocity_error
    rows = scaled_regressor(of, run.p, run.v, v_r, a_r)[:480].reshape(-1, len(of.columns))
    assert wanted.largest_eigenvalue[0] == pytest.approx(np.linalg.norm(rows, 2) ** 2 * 1e-3, rel=1e-9)
    assert wanted.largest_eigenvalue[0] != plain.largest_eigenvalue[0]


@pytest.mark.parametrize("window", [0.0, 0.01 * (BLOCKS_PER_WINDOW - 1), 100.0, np.nan])
def test_windows_that_do_not_fit_are_refused(window: float) -> None:
    of = model("puma560_geared")
    with pytest.raises(InputError, match=r"window: expected a time from 0\.16 s to the run's 1 s"):
        persistent_excitation(of, exactly(swings(of), 1.0), window)


def assert_within(of: ReducedModel, reference: Sinusoids, allowed: MotionLimits) -> None:
    """Limits hold at the samples of the search, to round-off; between them a curve passes its samples by no more than
    an eighth of the square of their distance times its greatest second derivative."""
    omega, swing = 2.0 * np.pi * reference.frequency, np.abs(reference.amplitude)
    period = 1.0 / float(reference.frequency[0, 0])
    step = period / (SAMPLES_PER_PERIOD * len(swing))
    p, v, a = reference(step * np.arange(SAMPLES_PER_PERIOD * len(swing)))
    torque = of.inverse_dynamics(p, v, a)
    assert np.all((p >= allowed.lower - 1e-9) & (p <= allowed.upper + 1e-9))
    assert np.all(np.abs(v) <= (1.0 + 1e-9) * allowed.velocity)
    assert np.all(np.abs(torque) <= (1.0 + 1e-9) * allowed.torque)
    p, v, a = reference(np.linspace(0.0, period, 5001))
    beyond = step**2 / 8.0 * (omega**2 * swing).sum(axis=0)
    assert np.all((p >= allowed.lower - beyond) & (p <= allowed.upper + beyond))
    assert np.all(np.abs(v) <= allowed.velocity + step**2 / 8.0 * (omega**3 * swing).sum(axis=0) + 1e-9)


@pytest.fixture(scope="module")
def found() -> ExcitationTrajectory:
    return excitation_trajectory(model("puma560_geared"), iterations=40, seed=1)


@nightly
def test_an_exciting_reference_is_better_conditioned_than_random_ones(found: ExcitationTrajectory) -> None:
    """Ten random ones of the same band within the same limits: 0.44 of the best of them, and within 0.05 of that
    when every cost is changed by 1e-10 of itself, as if by another processor."""
    assert found.condition < 0.7 * found.random_conditions.min()
    assert found.random_conditions.shape == (10,)
    assert found.condition_improvement > 2.0


@nightly
def test_its_condition_is_that_of_the_stacked_regressor(found: ExcitationTrajectory) -> None:
    of = model("puma560_geared")
    run = exactly(found.reference, 10.0)  # a whole period
    rows = scaled_regressor(of, run.p, run.v, run.v, run.reference_a)
    assert np.linalg.cond(rows.reshape(-1, rows.shape[-1])) == pytest.approx(found.condition, rel=1e-3)


def test_with_an_earlier_motion_the_condition_is_that_of_both_by_their_time() -> None:
    """Four seconds of one joint, 50 rows a second, and a period of ten seconds of 400 rows."""
    of, time = model("two_link"), np.arange(0.0, 4.0, 0.02)[:, None]
    wave = np.array([0.3, 0.0])
    earlier = wave * np.sin(3.0 * time), 3.0 * wave * np.cos(3.0 * time), -9.0 * wave * np.sin(3.0 * time)
    found = excitation_trajectory(of, earlier=earlier, iterations=2)
    step = 10.0 / (SAMPLES_PER_PERIOD * 5)
    new = found.reference(step * np.arange(SAMPLES_PER_PERIOD * 5))
    rows = [
        np.sqrt(seconds) * scaled_regressor(of, p, v, v, a).reshape(-1, len(of.columns))
        for (p, v, a), seconds in ((new, step), (earlier, 0.02))
    ]
    assert found.condition == pytest.approx(np.linalg.cond(np.concatenate(rows)), rel=1e-6)
    assert found.condition != pytest.approx(np.linalg.cond(rows[0]), rel=0.05)


def test_it_stays_within_the_limits(found: ExcitationTrajectory) -> None:
    of = model("puma560_geared")
    assert_within(of, found.reference, MotionLimits.from_model(of, 0.8))


def test_torques_and_speeds_that_are_tight_are_kept() -> None:
    of = model("puma560_geared")
    own = MotionLimits.from_model(of, 0.8)
    tight = MotionLimits(own.lower, own.upper, np.full(6, 1.0), np.array([8.0, 70.0, 25.0, 1.0, 1.0, 0.6]))
    found = excitation_trajectory(of, limits=tight, iterations=3, seed=0)
    assert_within(of, found.reference, tight)
    assert found.torque_share <= 1.0


def test_equal_seeds_find_equal_references_and_progress_is_told() -> None:
    of, told = model("puma560_geared"), []
    first, again, other = (
        excitation_trajectory(of, iterations=2, seed=seed, progress=told.append) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(first.reference.amplitude, again.reference.amplitude)
    assert first.condition == again.condition != other.condition
    assert told == [0.5 * k for run in (first, again, other) for k in range(1, run.iterations + 1)]
    assert first.complete


def test_an_interruption_keeps_the_best_so_far() -> None:
    of = model("puma560_geared")

    def interrupt(share: float) -> None:
        raise KeyboardInterrupt

    found = excitation_trajectory(of, iterations=50, seed=1, progress=interrupt)
    assert (found.complete, found.iterations) == (False, 1)
    assert found.condition < found.random_conditions.min()


def test_joints_without_limits_move_half_a_turn() -> None:
    chain = random_chain(2, 3)
    allowed = MotionLimits.from_model(ReducedModel.full(chain), 1.0)
    turning = [joint.kind.is_revolute for joint in chain.primary_joints]
    np.testing.assert_allclose(allowed.upper - allowed.lower, np.where(turning, 2.0 * np.pi, 2.0), rtol=1e-12)


def test_a_share_of_the_limits_is_about_their_middle() -> None:
    of = model("puma560_geared")
    whole, part = MotionLimits.from_model(of, 1.0), MotionLimits.from_model(of, 0.4)
    limits = [joint.limits for joint in of.mechanism.primary_joints]
    np.testing.assert_allclose(whole.lower, [each.lower for each in limits], atol=1e-12)
    np.testing.assert_allclose(whole.upper, [each.upper for each in limits], atol=1e-12)
    np.testing.assert_array_equal(whole.velocity, [each.velocity for each in limits])
    np.testing.assert_array_equal(whole.torque, of.mechanism.effort_limits)
    np.testing.assert_allclose(part.upper - part.lower, 0.4 * (whole.upper - whole.lower), rtol=1e-12)
    np.testing.assert_allclose(part.upper + part.lower, whole.upper + whole.lower, atol=1e-12)
    np.testing.assert_allclose((part.velocity, part.torque), (0.4 * whole.velocity, 0.4 * whole.torque), rtol=1e-12)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"frequency": 0.0}, "frequency: expected a positive one in Hz, got 0"),
        ({"harmonics": 0}, "harmonics: expected a whole number of at least 1"),
        ({"limit_share": 1.5}, "limit_share: expected a share of the limits above 0 and up to 1, got 1.5"),
        ({"scale": [1.0, 2.0]}, r"scale: expected shape \(40,\), got \(2,\)"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        excitation_trajectory(model("puma560_geared"), **settings)  # type: ignore[arg-type]


def test_an_arm_that_cannot_hold_itself_is_refused() -> None:
    of = model("puma560_geared")
    own = MotionLimits.from_model(of, 0.8)
    with pytest.raises(InputError, match="even at rest torques pass their limits"):
        excitation_trajectory(of, limits=MotionLimits(own.lower, own.upper, own.velocity, np.full(6, 1e-3)))


def test_mechanisms_with_loops_can_be_excited() -> None:
    of = model("semi_direct_drive")
    middle = of.mechanism.neutral_configuration
    near = MotionLimits(middle - 0.3, middle + 0.3, np.full(3, 3.0), np.full(3, 1e3))
    found = excitation_trajectory(of, limits=near, harmonics=2, iterations=3)
    assert found.condition <= found.random_conditions.min()  # the best of them is where the search begins
    assert_within(of, found.reference, near)


@given(shares=arrays(np.float64, (12,), elements=st.floats(-1e300, 1e300)), seed=st.integers(0, 9))
@settings(max_examples=15, deadline=None)
def test_a_search_may_walk_however_far(shares: Array, seed: int) -> None:
    """Its line searches step where an exponential would overflow: the motion is finite and within limits there too."""
    of = model("puma560_geared")
    allowed = MotionLimits.from_model(of, 0.8)
    search = FourierSearch(of, allowed, 0.1, 2, np.ones(len(of.columns)))
    x = search.random(np.random.default_rng(seed))
    x[-12:] = shares
    p, v, _ = search.motion(x)
    room = 1e-9 * (allowed.upper - allowed.lower)
    assert np.all((p >= allowed.lower - room) & (p <= allowed.upper + room))
    assert np.all(np.abs(v) <= (1.0 + 1e-9) * allowed.velocity)
    assert np.isfinite(search.cost(x))


@pytest.mark.parametrize(
    ("lower", "upper", "expected"),
    [
        (-np.inf, 1.0, (1.0 - 2.0 * np.pi, 1.0)),
        (-np.inf, 4.0, (-np.pi, 4.0)),
        (-1.0, np.inf, (-1.0, 2.0 * np.pi - 1.0)),
        (-4.0, np.inf, (-4.0, np.pi)),
    ],
)
def test_a_joint_with_one_limit_has_a_turn_of_room(lower: float, upper: float, expected: tuple[float, float]) -> None:
    (link,) = random_chain(1, 1).links
    joint = replace(link.joint, kind=JointKind.REVOLUTE, limits=Limits(lower, upper))
    one = Mechanism(Description("one", (replace(link, joint=joint),)))
    limits = MotionLimits.from_model(ReducedModel.full(one), 1.0)
    np.testing.assert_allclose((limits.lower[0], limits.upper[0]), expected, atol=1e-12)


@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 2, 4), (500, 6, 4), (1000, 3, 40), (1001, 3, 40)])
def test_gram_matrices_are_sums_over_all_samples(shape: tuple[int, int, int]) -> None:
    Y = np.random.default_rng(0).normal(size=shape)
    flat = Y.reshape(-1, shape[-1])
    np.testing.assert_allclose(_gram(Y), flat.T @ flat, rtol=1e-12, atol=1e-12 * shape[0])


def test_equal_coefficients_make_harmonics_that_fall_as_one_over_their_order() -> None:
    of = model("puma560_geared")
    search = FourierSearch(of, MotionLimits.from_model(of, 0.5), 0.1, 3, np.ones(len(of.columns)))
    x = np.concatenate((np.full(18, 0.3), np.full(18, -0.4), np.zeros(12)))
    found = search.reference(x)
    amplitude, phase = np.asarray(found.amplitude), np.asarray(found.phase)
    np.testing.assert_allclose(amplitude * np.arange(1.0, 4.0)[:, None], amplitude[:1].repeat(3, 0), rtol=1e-12)
    np.testing.assert_allclose(phase, np.full((3, 6), np.arctan2(-0.4, 0.3)), rtol=1e-12)


def test_a_run_recorded_every_few_periods_tells_about_the_same_as_one_recorded_in_each() -> None:
    of = model("puma560_geared")
    env = TrackingEnv(of.mechanism, 1, duration=1.0)
    often = rollout(env, ComputedTorque(of.mechanism, 5.0), seed=0)
    fifth = {
        name: getattr(often, name)[::5] for name in ("time", *["p", "v", "reference_p", "reference_v", "reference_a"])
    }
    seldom = replace(often, every=5, **fifth)
    for run in (often, seldom):
        assert persistent_excitation(of, run, 0.48).window == pytest.approx(0.48)
    limits = of.mechanism.effort_limits
    np.testing.assert_allclose(torque_uncertainty(of, seldom, limits), torque_uncertainty(of, often, limits), rtol=0.05)


def test_uncertain_torques_are_those_that_least_squares_leaves_where_noise_is_drawn() -> None:
    """Of 2,000 fits to torques that are wrong for a second each, the spread of a parameter's torques elsewhere."""
    of = model("two_link")
    run = exactly(swings(of), 20.0, 1.0)
    limits = np.array([40.0, 10.0])
    Y = (of.slotine_li_regressor(run.p, run.v, run.v, run.reference_a) / limits[:, None]).reshape(40, -1)
    fits = np.linalg.pinv(Y) @ np.random.default_rng(0).normal(scale=3e-3, size=(40, 2000))
    rng = np.random.default_rng(1)
    v, a = (np.sqrt((x**2).mean(axis=0)) * rng.choice([-1.0, 1.0], (4000, 2)) for x in (run.v, run.reference_a))
    p = rng.uniform(-np.pi, np.pi, (4000, 2))
    elsewhere = np.sqrt(((of.slotine_li_regressor(p, v, v, a) / limits[:, None]) ** 2).sum(axis=1).mean(axis=0))
    np.testing.assert_allclose(torque_uncertainty(of, run, limits), fits.std(axis=1) * elsewhere, rtol=0.15)


def test_rest_leaves_inertias_open() -> None:
    of = model("two_link")
    run = exactly(swings(of), 5.0)
    run.p[:] = run.p[0]
    run.v[:] = run.reference_a[:] = 0.0
    found = torque_uncertainty(of, run, [40.0, 10.0])
    unknown = {name for name, value in zip(of.names, found, strict=True) if value == np.inf}
    assert unknown >= {"upper.I_zz", "lower.I_zz"}
    with pytest.raises(InputError, match=r"torque_limits: expected 2 positive numbers"):
        torque_uncertainty(of, run, [1.0, -1.0])
