"""Identification: known arms found again, deviations that hold, and a real arm predicted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import mostly_at_night, nightly
from random_trees import random_chain
from scipy.optimize import minimize
from synthetic_logs import joint_drives, known, motion

from adaptctl.description.drive import Drive, DriveParameter
from adaptctl.description.inertia import from_center_of_mass, is_physically_consistent, pseudo_inertia
from adaptctl.dynamics import load
from adaptctl.errors import InputError
from adaptctl.identification import Identification, identify
from adaptctl.identification.consistent_estimate import consistent_estimate
from adaptctl.identification.entropic import EntropicPrior
from adaptctl.identification.examples import example
from adaptctl.identification.filtered_dynamics import SmoothMotion
from adaptctl.identification.fit import FitSettings
from adaptctl.identification.friction_model import FrictionModel, with_all_friction
from adaptctl.identification.gathering import gathered
from adaptctl.identification.identify import identified
from adaptctl.identification.least_squares import least_squares
from adaptctl.identification.preparation import DIFFERENCE_MARGIN, derivative, filtered, low_pass, padded, prepare


@cache
def found(seed: int, colour: float) -> tuple[Identification, np.ndarray]:
    """An identification of a known arm, and its true fundamental parameters."""
    case = known(seed, colour=colour)
    result = identified(case.guess, case.drives, [case.log], [case.log], friction=FrictionModel(), cutoff=25.0)
    return result, result.model.regrouping @ case.truth.inertial_parameters


@pytest.mark.parametrize(("colour", "count"), mostly_at_night([(0.9, 3), (0.0, 3), (0.0, 30), (0.9, 30)], (0.9, 3)))
def test_the_truth_is_within_two_deviations(colour: float, count: int) -> None:
    """Over thirty logs: in the first ten even least squares with the noise known is 0.93 of its deviations off."""
    cases = [found(seed, colour) for seed in range(count)]
    z = np.concatenate([(result.estimate - truth) / result.deviations for result, truth in cases])
    assert len(z) > 15 * count
    assert np.mean(np.abs(z) < 2.0) >= 0.93  # 95 %, less a deviation and a half of so many draws
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.25


def test_intervals_are_one_sided_at_zero_and_none_where_logs_tell_nothing() -> None:
    """Ten parameters of a link and three of its drive, of which friction is known to be positive."""
    result, truth = found(1, 0.9)
    wide = 10.0 * np.abs(result.estimate)
    wide[0] = np.inf
    rough = replace(result, interval_deviations=wide)
    assert np.isnan(rough.intervals[0]).all()
    lower = dict(zip(rough.names[1:], rough.intervals[1:, 0].tolist(), strict=True))
    assert lower["joint0.viscous"] == lower["joint2.coulomb"] == 0.0
    assert lower["link2.mc_y"] < 0.0
    inside = (truth >= result.intervals[:, 0]) & (truth <= result.intervals[:, 1])
    told = ~np.isnan(result.intervals[:, 0])
    assert told.mean() >= 0.9
    assert inside[told].mean() >= 0.9


@pytest.mark.parametrize("count", mostly_at_night([3, 10], 3))
def test_what_is_found_is_always_what_bodies_can_have(count: int) -> None:
    for seed in range(count):
        result, _ = found(seed, 0.9)
        assert all(is_physically_consistent(link.inertia) for link in result.mechanism.links)
        drives = [joint.drive for joint in result.mechanism.primary_joints]
        assert all(min(d.rotor_inertia or 0.0, d.viscous or 0.0, d.coulomb or 0.0) >= 0.0 for d in drives)
        assert 1.0 - 1e-9 <= result.misfit_ratio <= 1.03


@nightly
def test_white_residuals_flatter() -> None:
    """Noise that lasts ten samples is not worth as many equations, which the jackknife alone sees."""
    assert found(1, 0.9)[0].deviation_ratio > 1.1 * found(1, 0.0)[0].deviation_ratio


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_newton_finds_the_minimum_of_the_entropic_objective(seed: int) -> None:
    """Against a minimiser that knows nothing of it, over the same links."""
    rng = np.random.default_rng(seed)
    tens = np.stack([link.inertia for link in random_chain(seed, 1).links])
    prior = EntropicPrior(tens, np.array([10]), np.array([0.5]))
    Y = rng.normal(size=(40, 12))
    A, b = Y.T @ Y, Y.T @ rng.normal(size=40)
    x = consistent_estimate(A, b, prior, 2.0)
    assert is_physically_consistent(x[:10])
    assert x[10] > 0.0

    def objective(y: np.ndarray) -> float:
        return float(0.5 * y @ A @ y - b @ y + prior.divergence(y, 2.0))

    gradient = A @ x - b + prior.gradient(x, 2.0)
    scale = np.sqrt(np.diag(A + prior.curvature(x, 2.0)))
    assert np.abs(gradient / scale).max() < 1e-4 * (1.0 + abs(objective(x))) ** 0.5
    other = minimize(objective, prior.start(12), method="Nelder-Mead", options={"maxiter": 400}).fun
    assert objective(x) <= other + 1e-9 * (1.0 + abs(other))


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_divergences_slopes_are_its_derivatives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tens = np.stack([link.inertia for link in random_chain(seed, 2).links])
    prior = EntropicPrior(tens, np.array([20]), np.array([0.7]))
    x = prior.start(21) * rng.uniform(0.9, 1.1)
    step = 1e-6 * np.maximum(np.abs(x), 0.1)
    ends = [(x + e, x - e) for e in np.diag(step)]
    slopes = [(prior.divergence(up, 3.0) - prior.divergence(down, 3.0)) for up, down in ends] / (2.0 * step)
    scale = np.sqrt(np.diag(prior.curvature(x, 3.0)))
    np.testing.assert_allclose(slopes / scale, prior.gradient(x, 3.0) / scale, atol=2e-4, rtol=1e-4)
    bent = [(prior.gradient(up, 3.0) - prior.gradient(down, 3.0)) for up, down in ends] / (2.0 * step[:, None])
    np.testing.assert_allclose(
        bent / np.outer(scale, scale), prior.curvature(x, 3.0) / np.outer(scale, scale), atol=1e-3
    )
    assert prior.distance(prior.start(21)) == pytest.approx(0.0, abs=1e-9)


def test_the_edge_of_the_cone_tells_nothing_of_where_the_truth_is() -> None:
    """The barrier's curvature grows without bound there; what holds links from afar is the prior's own."""
    tens = np.stack([link.inertia for link in random_chain(5, 2).links])
    prior = EntropicPrior(tens, np.arange(0), np.zeros(0))
    thin = np.stack([from_center_of_mass(2.0, [0.1, 0.2, 0.3], 1e-9 * np.eye(3)), tens[1]]).ravel()
    near = prior.hold(tens.ravel(), 3.0)
    np.testing.assert_allclose(near, prior.curvature(tens.ravel(), 3.0), rtol=1e-9)
    assert np.abs(prior.curvature(thin, 3.0)).max() > 1e6 * np.abs(near).max()
    assert np.all(np.linalg.eigvalsh(near - prior.hold(thin, 3.0)) > -1e-9 * np.abs(near).max())


def test_a_heavy_prior_is_kept_and_a_light_one_gives_way() -> None:
    rng = np.random.default_rng(0)
    tens = np.stack([link.inertia for link in random_chain(3, 1).links])
    prior = EntropicPrior(tens, np.arange(0), np.zeros(0))
    true = tens[0] * 1.5
    Y = rng.normal(size=(200, 10))
    A, b = Y.T @ Y, Y.T @ (Y @ true)
    np.testing.assert_allclose(consistent_estimate(A, b, prior, 1e9), tens[0], rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(consistent_estimate(A, b, prior, 1e-9), true, rtol=1e-5, atol=1e-5)


def test_least_squares_is_numpys_and_the_shortest_where_columns_depend() -> None:
    rng = np.random.default_rng(1)
    Y, tau = rng.normal(size=(30, 5)) * [1.0, 10.0, 1e-3, 1.0, 1.0], rng.normal(size=30)
    columns = np.array([0, 1, 2, 4])
    x = least_squares(Y.T @ Y, Y.T @ tau, columns)
    np.testing.assert_allclose(x[columns], np.linalg.lstsq(Y[:, columns], tau)[0], rtol=1e-9)
    assert x[3] == 0.0
    twice = np.column_stack([Y[:, 0], Y[:, 0]])
    assert least_squares(twice.T @ twice, twice.T @ tau, np.arange(2)) == pytest.approx(
        [0.5 * (Y[:, 0] @ tau) / (Y[:, 0] @ Y[:, 0])] * 2
    )


def test_the_filters_keep_phase_and_know_derivatives() -> None:
    rate = 500.0
    time = np.arange(2000) / rate
    for frequency in (1.0, 5.0, 12.0):
        kernel = low_pass(50.0, rate)
        signal = np.sin(2.0 * np.pi * frequency * time)
        inner = time[len(kernel) // 2 + DIFFERENCE_MARGIN : -(len(kernel) // 2) - DIFFERENCE_MARGIN]
        gain = np.sum(kernel * np.cos(2.0 * np.pi * frequency * (np.arange(len(kernel)) - len(kernel) // 2) / rate))
        np.testing.assert_allclose(
            filtered(signal, padded(kernel)), gain * np.sin(2 * np.pi * frequency * inner), atol=1e-9
        )
        omega = 2.0 * np.pi * frequency
        slope = filtered(signal, derivative(kernel, rate))
        np.testing.assert_allclose(slope, gain * omega * np.cos(omega * inner), atol=3e-4 * omega)
        np.testing.assert_array_almost_equal(filtered(signal, kernel)[::7], filtered(signal, kernel, 7), decimal=12)
    assert low_pass(25.0, rate).sum() == pytest.approx(1.0)


def test_a_filter_longer_than_its_signal_is_refused() -> None:
    kernel = low_pass(50.0, 500.0)
    for every in (1, 7):
        assert filtered(np.ones((len(kernel), 2)), kernel, every).shape == (1, 2)
        with pytest.raises(InputError, match=f"signal: expected at least {len(kernel)} samples, .*, got 4"):
            filtered(np.ones((4, 2)), kernel, every)


def test_filtered_equations_hold_for_exact_motions_without_accelerations() -> None:
    """The filtered torques of a known arm are its filtered regressor times its parameters."""
    tree = random_chain(5, 3)
    truth = tree.with_drives(Drive(0.3, 2.0))
    time, p, v, a = motion(3, np.random.default_rng(5), 6.0, 1000.0)
    case = known(5)
    log = replace(case.log, time=time, position=p, torque=truth.inverse_dynamics(p, v, a))
    evidence, _, _ = gathered(case.guess, case.drives, [log])
    full = evidence.mechanism
    values = dict(zip(truth.parameter_names, truth.inertial_parameters, strict=True))
    D = np.array([values.get(name, 0.0) for name in full.parameter_names])
    for rows in evidence.rows.values():
        left = rows.regressor @ D - rows.torque
        assert np.sqrt(np.mean(left**2)) < 2e-3 * np.sqrt(np.mean(rows.torque**2))


def test_wrapped_angles_at_uneven_times_are_unwrapped_before_they_are_resampled() -> None:
    case, rng = known(2), np.random.default_rng(0)
    turns = np.array([j.kind.is_revolute for j in case.guess.primary_joints])
    order = np.sort(rng.choice(len(case.log), int(0.9 * len(case.log)), replace=False))
    angles = 4.0 * case.log.position
    log = replace(
        case.log,
        time=case.log.time[order],
        position=np.where(turns, (angles + np.pi) % (2.0 * np.pi) - np.pi, angles)[order],
        torque=case.log.torque[order],
    )
    (piece,), steps = prepare(log, case.guess, skip=("limits",))
    assert any("resampled" in step.outcome for step in steps)
    true = np.stack([np.interp(piece.time, case.log.time, own) for own in angles.T], axis=-1)
    off = piece.position - true
    np.testing.assert_allclose(off - np.round(off[0] / (2.0 * np.pi)) * 2.0 * np.pi, 0.0, atol=1e-2)


def test_standstill_is_found_and_late_stamps_are_and_turns_unwrapped() -> None:
    case = known(2)
    still = np.concatenate([case.log.position, np.repeat(case.log.position[-1:], 1000, axis=0)])
    time = np.arange(len(still)) / 500.0
    torque = np.concatenate([case.log.torque, np.repeat(case.log.torque[-1:], 1000, axis=0)])
    rng = np.random.default_rng(0)
    jittered = time + rng.uniform(-4e-4, 4e-4, len(time))
    wrapped = np.where(
        [j.kind.is_revolute for j in case.guess.primary_joints], (still + np.pi) % (2 * np.pi) - np.pi, still
    )
    (piece,), steps = prepare(replace(case.log, time=jittered, position=wrapped, torque=torque), case.guess)
    said = {step.name: step.outcome for step in steps}
    assert 0.08 < 1.0 - piece.moving.mean() < 0.1
    assert "even" in said["resample"]
    assert "9." in said["standstill"]
    turns = np.round((piece.position - still) / (2 * np.pi))
    np.testing.assert_allclose(piece.position - 2 * np.pi * turns[:1], still, atol=1e-12)
    assert np.all(np.diff(piece.time) > 0.0)
    (kept,), told = prepare(replace(case.log, position=still[:10000]), case.guess, skip=("standstill", "limits"))
    assert kept.moving.all()
    assert {step.outcome for step in told if step.name in ("standstill", "limits")} == {"skipped"}


def test_friction_is_chosen_by_blocks_left_out() -> None:
    """A square root that is there is found, and none where there is none."""
    tree = random_chain(8, 2)
    for square_root in (0.0, 6.0):
        truth = tree.with_drives(Drive(0.3, 0.5, 1.0, square_root=square_root))
        rng = np.random.default_rng(3)
        time, p, v, a = motion(2, rng, 20.0, 250.0)
        torque = truth.inverse_dynamics(p, v, a)
        log = replace(known(8, 2).log, time=time, position=p, torque=torque + rng.normal(scale=0.1, size=torque.shape))
        result = identified(tree, joint_drives(tree), [log], [log], cutoff=25.0)
        kinds = result.choice.settings.friction.kinds
        assert (DriveParameter.SQUARE_ROOT in kinds) is bool(square_root)


def test_a_part_of_a_part_is_the_part() -> None:
    """Of blocks 2, 3 and 5 those at places 0 and 2 are blocks 2 and 5."""
    case = known(9, 2)
    evidence, _, _ = gathered(case.guess, case.drives, [case.log])
    once, twice = evidence.part([2, 5]), evidence.part([2, 3, 5]).part([0, 2])
    for cutoff in evidence.rows:
        np.testing.assert_array_equal(twice.rows[cutoff].time, once.rows[cutoff].time)
    settings = FitSettings(FrictionModel(), 1.0, evidence.band)
    np.testing.assert_array_equal(twice.fit(settings, [0, 1]).x, once.fit(settings, [0, 1]).x)


def test_a_coupled_drive_is_found_and_is_part_of_the_robot() -> None:
    """A second motor that sits before the first joint, as in a wrist: found with its coupling, and simulated so."""
    tree = random_chain(11, 2)
    names = [joint.name for joint in tree.primary_joints]
    truth = tree.with_drives([Drive(0.3, 1.0, 1.0), Drive(0.2, 1.0, 1.0, turns_with=((names[0], 1.0),))])
    rng = np.random.default_rng(5)
    time, p, v, a = motion(2, rng, 20.0, 250.0)
    torque = truth.inverse_dynamics(p, v, a)
    log = replace(known(11, 2).log, time=time, position=p, torque=torque + rng.normal(scale=0.05, size=torque.shape))
    ratios = np.array([[50.0, 0.0], [30.0, 30.0]])
    result = identified(tree, replace(joint_drives(tree), transmission=ratios), [log], [log], friction=FrictionModel())
    assert result.mechanism.links[1].joint.drive.turns_with == ((names[0], 1.0),)
    again = result.mechanism.inverse_dynamics(p, v, a)
    assert np.sqrt(np.mean((again - torque) ** 2)) < 0.02 * np.sqrt(np.mean(torque**2))
    np.testing.assert_allclose(result.mechanism.forward_dynamics(p[::500], v[::500], again[::500]), a[::500], atol=1e-6)


def test_a_closed_loop_is_identified_too() -> None:
    arm = load("semi_direct_drive")
    rng = np.random.default_rng(6)
    time, p, v, a = motion(arm.dof, rng, 8.0, 200.0)
    middle = np.array([0.5 * (j.limits.lower + j.limits.upper) for j in arm.primary_joints])
    middle = np.where(np.isfinite(middle), middle, 0.0)
    p, v, a = middle + 0.15 * p, 0.15 * v, 0.15 * a
    torque = arm.inverse_dynamics(p, v, a)
    log = replace(known(1).log, time=time, position=p, torque=torque + rng.normal(scale=0.02, size=torque.shape))
    result = identified(arm, joint_drives(arm), [log], [log], friction=FrictionModel(), cutoff=12.5)
    assert result.validation.relative_error < 0.02
    assert result.misfit_ratio < 1.03


@cache
def tx40() -> Identification:
    with example("tx40") as files:
        return identify(files.log, files.robot, files.drives)


def test_the_real_arm_is_predicted_better_than_by_least_squares() -> None:
    result = tx40()
    assert result.validation.rms_error < 1.04
    assert result.validation.relative_error < 0.053
    plain = next(v for name, v in result.alternatives.items() if name.startswith("weighted") and "offset" in name)
    assert result.validation.rms_error < 0.85 * plain.rms_error
    robot_file = result.alternatives["links of the robot file, friction and rotors fitted"]
    assert result.validation.rms_error < robot_file.rms_error
    assert DriveParameter.SQUARE_ROOT in result.choice.settings.friction.kinds
    assert not result.mechanism.description.inconsistent_links
    light = [trial.relative_error for trial in result.choice.trials if trial.what == "weight of the prior"]
    heavy = [trial for trial in result.choice.trials if trial.what.endswith("any misfit") and trial.taken]
    assert 1.03 < result.misfit_ratio < 1.1
    assert heavy[0].relative_error < 0.95 * min(light)
    assert any("of the prior and most at" in step.outcome for step in result.steps)
    assert not any("of the prior and most at" in warning for warning in result.warnings)  # it predicts better
    assert 1.5 < result.deviation_ratio < 5.0
    assert result.mechanism.links[5].joint.drive.turns_with == (("joint_5", 1.0),)
    assert any("link_6" in remark for remark in result.warnings)


@nightly
def test_predictions_use_no_measured_torque() -> None:
    """Torques of the validation log can be anything: what is predicted is the same."""
    case = known(1)
    other = replace(case.log, torque=np.random.default_rng(0).normal(size=case.log.torque.shape))
    first, second = (
        identified(case.guess, case.drives, [case.log], [log], friction=FrictionModel(), cutoff=25.0, prior_weight=1.0)
        for log in (case.log, other)
    )
    np.testing.assert_array_equal(first.validation.predicted, second.validation.predicted)
    np.testing.assert_array_equal(first.validation.time, second.validation.time)
    assert not np.array_equal(first.validation.measured, second.validation.measured)


def test_what_a_log_does_not_excite_is_said() -> None:
    """An arm that turns about a vertical axis alone shows nothing of its weight."""
    tree = random_chain(2, 2)
    rng = np.random.default_rng(7)
    time, p, v, a = motion(2, rng, 10.0, 200.0)
    p[:, 1], v[:, 1], a[:, 1] = 1e-3 * p[:, 1], 1e-3 * v[:, 1], 1e-3 * a[:, 1]
    torque = tree.inverse_dynamics(p, v, a)
    log = replace(known(2, 2).log, time=time, position=p, torque=torque + rng.normal(scale=0.5, size=torque.shape))
    evidence = identified(tree, joint_drives(tree), [log], [log], friction=FrictionModel(), cutoff=12.5)
    assert len(evidence.unexcited) >= 3
    assert evidence.components < evidence.space.rank
    strengths = [c.strength for c in evidence.combinations]
    assert strengths == sorted(strengths)


def test_all_friction_is_in_the_joints_that_are_driven() -> None:
    tree = random_chain(3, 2)
    full = with_all_friction(tree, joint_drives(tree))
    assert len(full.parameter_names) == 20 + 2 * sum(not kind.is_spring for kind in DriveParameter)
    assert FrictionModel.named("coulomb, viscous").words == "viscous, coulomb"
    with pytest.raises(InputError, match=r"friction: expected some of viscous, coulomb, .*, cosine_2, got 'sticky'"):
        FrictionModel.named("viscous,sticky")
    with pytest.raises(InputError, match="got 'load'"):
        FrictionModel.named("viscous,load")


def test_smooth_motion_is_right_in_time() -> None:
    time, p, v, _ = motion(2, np.random.default_rng(1), 4.0, 1000.0)
    (piece,), _ = prepare(replace(known(1, 2).log, time=time, position=p, torque=v), random_chain(1, 2))
    smooth = SmoothMotion.of(piece, 0)
    at = smooth.first + smooth.every * np.arange(len(smooth.position))
    np.testing.assert_allclose(smooth.position, p[at], atol=1e-3)
    np.testing.assert_allclose(smooth.velocity, v[at], atol=1e-2)
    assert np.linalg.eigvalsh(pseudo_inertia(random_chain(1, 2).links[0].inertia))[0] > 0.0
