"""What fits begin at, leave out and are asked for, and what is told of faults, by scripted errors and few rows."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.control.references import Sinusoids
from adaptctl.description import Joint, JointKind, Limits
from adaptctl.description.inertia import inertia_tensor
from adaptctl.errors import AdaptctlError, InputError
from adaptctl.identification import choice, springs, uncertainty
from adaptctl.identification.choice import _each, _worst, contradictory
from adaptctl.identification.entropic import EntropicPrior
from adaptctl.identification.fit import FitSettings, LogEvidence, _started
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.learned_payload import _ball, mass_of_change
from adaptctl.identification.loaded_equations import BALL
from adaptctl.identification.loaded_fit import PRIOR_WEIGHT
from adaptctl.identification.log_checks import _frozen_words
from adaptctl.identification.position_faults import equal_columns, slip_words
from adaptctl.identification.robot_motion import RobotLimits, RobotMotion, _smaller, _validate_poses, write_trajectory
from adaptctl.identification.uncertainty import essential_components
from adaptctl.identification.validation import Validation

SETTINGS = FitSettings(FrictionModel(), 1.0, 9.0)
rng = np.random.default_rng(3)


def nearest(ends: dict[tuple[tuple[int, ...], float], float], blocks: tuple[int, ...], weight: float) -> float | None:
    evidence: Any = SimpleNamespace(_ends=ends)
    return LogEvidence._nearest(evidence, blocks, weight)  # type: ignore[return-value]


def test_a_fit_begins_at_the_end_of_one_on_its_blocks_or_else_of_the_nearest_weight() -> None:
    here, other = (0, 1), (2,)
    ends = {(here, 11.9): 1.0, (other, 1.0): 2.0, (other, 0.5): 3.0, (here, 12.1): 4.0}
    assert nearest(ends, here, 1.0) == 1.0
    assert nearest(ends, (9,), 1.0) == 2.0
    assert nearest(ends, (9,), 0.6) == 3.0
    assert nearest({(here, 12.1): 1.0, (here, 1.0 / 12.1): 2.0}, here, 1.0) is None
    assert nearest({(here, 1.0 / 11.9): 2.0}, here, 1.0) == 2.0


def test_positive_parameters_begin_at_their_sizes_where_a_start_has_none() -> None:
    prior: Any = SimpleNamespace(positive=np.array([1, 2, 3]), scales=np.array([5.0, 6.0, 7.0]))
    found = _started(np.array([-1.0, 2.0, 0.0, 3.0]), prior, np.array([1.0, 1.0, 1.0, 0.0]))
    np.testing.assert_array_equal(found, [-1.0, 2.0, 6.0, 7.0])


def evidence_of(suspects: Sequence[int], ratios: dict[tuple[int, ...], float], dof: int = 4) -> Any:
    """Evidence of which misfit ratios by the joints left out are told."""

    def fit(settings: FitSettings, blocks: range) -> float:
        if settings.left_out not in ratios:
            raise AdaptctlError
        return ratios[settings.left_out]

    mechanism = SimpleNamespace(dof=dof)
    return SimpleNamespace(blocks=3, weighing_otherwise=lambda cutoff: suspects, fit=fit, mechanism=mechanism)


@pytest.mark.parametrize(
    ("suspects", "ratios", "worst"),
    [
        ([1, 2], {(): 1.2, (1,): 1.15, (2,): 1.05}, 2),
        ([1, 2], {(): 1.2, (1,): 1.05, (2,): 1.15}, 1),
        ([1, 2], {(): 1.2, (1,): 1.11, (2,): 1.11}, None),  # no joint takes off half of the excess
        ([1, 2], {(): 1.2, (2,): 1.09}, 2),  # without joint 1 there is no fit
        ([], {(): 1.2}, None),
        ([1], {(): 1.031, (1,): 1.0}, 1),
        ([1], {(): 1.029, (1,): 1.0}, None),  # there is hardly an excess
    ],
)
def test_a_joint_is_left_out_without_which_links_fit_far_better(
    suspects: list[int], ratios: dict[tuple[int, ...], float], worst: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(choice, "misfit_ratio", lambda _, ratio: ratio)
    assert _worst(evidence_of(suspects, ratios), SETTINGS) == worst


def test_joints_are_left_out_one_after_the_other_but_for_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """By fits of the least weight of the prior; a joint that is left out is no suspect."""
    monkeypatch.setattr(choice, "misfit_ratio", lambda _, ratio: ratio)
    ratios = {(): 3.0, (1,): 2.0, (2,): 1.4, (2, 1): 1.1, (2, 1, 0): 1.0, (2, 0): 1.2}
    evidence = evidence_of([0, 1, 2], ratios)
    fit = evidence.fit

    def light(settings: FitSettings, blocks: range) -> float:
        assert settings.weight == choice.WEIGHT_CANDIDATES[0]
        return float(fit(settings, blocks))

    evidence.fit = light
    assert contradictory(evidence, SETTINGS) == (2, 1, 0)
    evidence.mechanism.dof = 3
    assert contradictory(evidence, SETTINGS) == (2, 1)


def test_candidates_are_scored_from_the_last_one_and_what_fails_is_no_candidate() -> None:
    seen: list[float] = []

    def score(settings: FitSettings) -> float:
        seen.append(settings.weight)
        if settings.weight == 2.0:
            raise AdaptctlError
        return np.nan if settings.weight == 3.0 else 10.0 * settings.weight

    tried = [FitSettings(FrictionModel(), weight, 9.0) for weight in (1.0, 2.0, 3.0, 4.0)]
    assert _each(score, tried) == [10.0, np.inf, np.inf, 40.0]
    assert seen == [4.0, 3.0, 2.0, 1.0]


def test_springs_are_left_out_as_untold_the_worst_first_until_a_fifth_of_the_torque(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Torques are root mean squares of the rows that count; without one spring, others may be told."""
    doubts, seen = {(4, 5, 6): [0.3, 0.9, 0.5], (4, 6): [0.21, 0.1], (6,): [0.2]}, []

    def doubted(A: Array, columns: Any, own: list[tuple[int, int]], evidence: Any, cutoff: float, torque: Array) -> Any:
        seen.append((len(columns), torque.tolist(), cutoff))
        return doubts[tuple(place for place, _ in own)]

    mechanism = SimpleNamespace(parameter_names=[f"p{k}" for k in range(7)])
    equations = SimpleNamespace(
        square=np.array([[9.0, 8.0]]), count=np.array([[1.0, 0.0]]), whitened=lambda deviations: (np.eye(7), None)
    )
    evidence: Any = SimpleNamespace(mechanism=mechanism, blocks=1, equations=lambda *_: equations)
    evidence.independent = lambda settings: np.arange(7 - len(settings.untold))
    monkeypatch.setattr(springs, "weighted_least_squares", lambda *_: (None, np.ones(2)))
    monkeypatch.setattr(springs, "_springs", lambda *_: [(4, 0), (5, 0), (6, 1)])
    monkeypatch.setattr(springs, "_doubts", doubted)
    given = FitSettings(FrictionModel(), 1.0, 9.0, untold=())
    assert springs.untold_springs(evidence, given) == ("p5", "p4")
    assert [torque for _, torque, _ in seen] == [[3.0, 8.0**0.5]] * 3


def test_errors_are_of_the_joints_that_are_judged_by_their_units() -> None:
    measured = np.array([[1.0, 2.0, 4.0], [1.0, -2.0, 4.0]])
    units = ("N", "N m", "N m")
    off = np.array([0.5, 0.2, 1.0])
    found = Validation("a", 9.0, np.arange(2.0), measured, measured + off, units)
    assert list(found.rms_errors) == ["N m", "N"]
    assert found.rms_errors["N m"] == pytest.approx(np.sqrt(0.5 * (0.2**2 + 1.0)))
    assert found.relative_errors["N m"] == pytest.approx(np.sqrt((0.2**2 + 1.0) / 20.0))
    assert found.relative_errors["N"] == pytest.approx(0.5)
    left = Validation("a", 9.0, np.arange(2.0), measured, measured + off, units, left_out=(0, 2))
    assert left.rms_errors == {"N m": pytest.approx(0.2)}
    every = Validation("a", 9.0, np.arange(2.0), measured, measured + off, units, left_out=(0, 1, 2))
    assert every.rms_errors == found.rms_errors


@pytest.mark.parametrize(("count", "step"), [(10, 2), (2999, 2), (3000, 3), (5000, 5)])
def test_components_are_fitted_to_some_states_and_judged_on_those_between(
    count: int, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []

    def reduced(*_: Any, **given: Any) -> Any:
        seen.append(given)
        return SimpleNamespace(num_components=7)

    monkeypatch.setattr(uncertainty, "essential_space", reduced)
    monkeypatch.setattr(uncertainty, "reduce", reduced)
    p = np.arange(float(count))[:, None]
    assert essential_components(None, p, -p)[1] == 7  # type: ignore[arg-type]
    first, judged = seen
    np.testing.assert_array_equal(first["states"].p, p[::step])
    np.testing.assert_array_equal(judged["states"].p, p[step // 2 :: step])
    np.testing.assert_array_equal(judged["states"].v, -p[step // 2 :: step])
    assert judged["energy_error"] == 1.0


JOINTS = [Joint("a"), Joint("b", kind=JointKind.PRISMATIC), Joint("c")]


def test_torques_that_freeze_at_once_are_told_together() -> None:
    """To within two rows; those of dead sensors are not."""
    time, position = np.arange(600) / 100.0, 0.01 * np.arange(600.0)
    torque = [np.sin(0.7 * np.arange(600.0) + k) for k in range(4)]
    for k, start in enumerate((200, 202, 205, 200)):
        torque[k][start : start + 100] = 0.25
    joints = [*JOINTS, Joint("d")]
    first, second = _frozen_words(time, [position] * 4, torque, np.array([False, False, False, True]), joints)
    assert first == (
        "the torques of joints 'a', 'b' are frozen at 0.25 N m, 0.25 N from 2 to 2.99 s; cut this stretch out of the "
        "log"
    )
    assert second.startswith("the torque of joint 'c' is frozen at 0.25 N m from 2.05 to 3.04 s")
    torque = [np.sin(0.7 * np.arange(600.0))] * 4
    assert not list(_frozen_words(time, [position] * 4, torque, np.zeros(4, dtype=bool), joints))


def test_a_slip_is_told_with_its_step_and_how_many_follow() -> None:
    time, values = np.arange(5) / 10.0, np.array([0.0, 0.1, 0.35, 0.4, 0.9])
    (one,) = slip_words(time, values, [2], JOINTS[1])
    assert "joint 'b' steps by 0.25 m in row 3, at 0.2 s, and stays there: " in one
    (more,) = slip_words(time, values, [2, 4, 4], JOINTS[0])
    assert "by 0.25 rad in row 3, at 0.2 s, and stays there, and so in 2 more rows: " in more
    assert not list(slip_words(time, values, [], JOINTS[0]))


def test_copies_of_columns_are_told_unless_they_stand_still() -> None:
    one, other, still = np.arange(9.0), np.arange(9.0) + 1.0, np.ones(9)
    (words,) = equal_columns("torques", [one, other, one.copy()], JOINTS)
    assert words.startswith("the torques of joints 'a' and 'c' are equal in all rows")
    assert not list(equal_columns("torques", [still, other, still], JOINTS))


@pytest.mark.parametrize(
    ("told", "measured", "whole", "found"),
    [
        ((16.1, 0.0), (2.0, 0.0), 0.0, (0,)),
        ((-16.1, 0.0), (-2.0, 0.0), 0.0, (0,)),
        ((15.9, 0.0), (2.0, 0.0), 0.0, ()),
        ((16.1, 4.1), (2.0, 0.1), 0.0, (0, 1)),
        ((16.1, 4.0), (2.0, 0.1), 0.0, (0,)),  # a quarter of the largest
        ((16.1, 0.0), (2.0, 0.0), 17.0, ()),  # as swings are by chance
    ],
)
def test_joints_weigh_otherwise_whose_links_take_many_times_the_mean_torque(
    told: tuple[float, float], measured: tuple[float, float], whole: float, found: tuple[int, ...]
) -> None:
    torque = np.full((4, 2), whole)
    rows = {9.0: SimpleNamespace(moved=SimpleNamespace(torque=torque))}
    evidence: Any = SimpleNamespace(rows=rows, file_torques=lambda cutoff: np.array([told, measured]))
    assert LogEvidence.weighing_otherwise(evidence, 9.0) == found


def test_torques_of_a_files_links_and_those_measured_are_means_of_the_moving_rows() -> None:
    Y, torque, tens = rng.normal(size=(5, 2, 12)), rng.normal(size=(5, 2)), rng.normal(size=(1, 10))
    rows = {9.0: SimpleNamespace(moved=SimpleNamespace(regressor=Y, torque=torque))}
    evidence: Any = SimpleNamespace(rows=rows, prior=SimpleNamespace(tens=tens))
    links, measured = LogEvidence.file_torques(evidence, 9.0)
    np.testing.assert_allclose(links, (Y[..., :10] @ tens[0]).mean(axis=0))
    np.testing.assert_allclose(measured, torque.mean(axis=0))


def test_weights_that_are_tried_rise_by_two_to_ten() -> None:
    rise = np.divide(choice.WEIGHT_CANDIDATES[1:], choice.WEIGHT_CANDIDATES[:-1])
    assert rise.min() >= 2.0
    assert rise.max() <= 10.0 + 1e-9
    assert choice.FIRST_WEIGHT in choice.WEIGHT_CANDIDATES


def test_residuals_are_expected_to_be_a_fiftieth_of_each_joints_largest_torque() -> None:
    """And a hundredth of that of the strongest at least."""
    found = uncertainty._expected(np.array([[-50.0, 0.3, 2.0], [20.0, 0.2, -4.0]]))
    np.testing.assert_allclose(found, [1.0, 0.01, 0.08])


def arm_of(torque: float) -> Any:
    joints = [Joint("a", limits=Limits(-1.0, 2.0)), Joint("b", limits=Limits(-3.0, 3.0))]
    return SimpleNamespace(dof=2, primary_joints=joints, inverse_dynamics=lambda p, v, a: torque * p)


@pytest.mark.parametrize(
    ("start", "end", "told"),
    [
        ((-1.0, 3.0), (2.0, -3.0), ""),
        ((-1.1, 0.0), (0.0, 0.0), "start: joint 'a' at -1.1 is outside its range, -1 to 2"),
        ((0.0, 0.0), (0.0, 3.1), "end: joint 'b' at 3.1 is outside its range, -3 to 3"),
        ((0.0, 0.0), (1.9, -3.0), "end: the pose collides"),
    ],
)
def test_poses_are_within_ranges_and_held_and_allowed(
    start: tuple[float, float], end: tuple[float, float], told: str
) -> None:
    given = np.array(start), np.array(end)

    def allowed(p: Array) -> bool:
        return bool(p[0, 0] != 1.9)

    if not told:
        _validate_poses(arm_of(2.0), *given, of_torque(4.0, 6.0), allowed)
        _validate_poses(arm_of(2.0), *given, of_torque(4.0, 6.0), None)
        return
    with pytest.raises(InputError) as refused:
        _validate_poses(arm_of(1.0), *given, of_torque(4.0, 6.0), allowed)
    assert str(refused.value).startswith(told)


@pytest.mark.parametrize(("torques", "joint"), [((3.9, 6.0), "a"), ((4.0, 5.9), "b"), ((3.9, 5.8), "b")])
def test_the_joint_is_named_that_is_furthest_from_holding_a_pose(torques: tuple[float, float], joint: str) -> None:
    with pytest.raises(InputError, match=f"start: joint '{joint}' cannot hold the pose"):
        _validate_poses(arm_of(2.0), np.array([2.0, -3.0]), np.zeros(2), of_torque(*torques), None)


def of_torque(*torques: float) -> RobotLimits:
    free = np.full(2, np.inf)
    return RobotLimits(free, free, free, np.array(torques))


def motion() -> RobotMotion:
    reference = Sinusoids(np.array([1.0, -0.5]), 0.4 * np.ones((1, 2)), np.full((1, 2), 0.5), np.zeros((1, 2)))
    return RobotMotion(reference, np.array([0.2, 0.0]), np.array([0.0, 0.1]), 4.0, 1.0)


def test_a_motion_is_made_smaller_by_quarters_until_it_is_allowed() -> None:
    """About its start."""
    seen: list[float] = []

    def allowed(p: Array) -> bool:
        seen.append(float(np.abs(p).max()))
        return len(seen) > 2

    found = _smaller(motion(), allowed)
    np.testing.assert_allclose(found.reference.center, [0.2 + 0.75**2 * 0.8, -0.5 * 0.75**2])
    np.testing.assert_allclose(found.reference.amplitude, 0.4 * 0.75**2)
    assert seen == sorted(seen, reverse=True)
    whole = motion()
    assert _smaller(whole, None) is whole
    assert _smaller(whole, lambda p: True) is whole
    tried: list[Array] = []

    def refused(p: Array) -> bool:
        tried.append(p)
        return False

    with pytest.raises(InputError, match="no collision-free motion"):
        _smaller(whole, refused)
    assert len(tried) == 13


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
def test_trajectories_are_json_or_lines_that_are_yaml(suffix: str, tmp_path: Path) -> None:
    write_trajectory(path := tmp_path / f"motion{suffix}", motion(), ["a", "b"], 10.0)
    text = path.read_text()
    if suffix == ".json":
        content = json.loads(text)
        points = content["points"]
        assert content["joint_names"] == ["a", "b"]
    else:
        head, lines = text.split("points:\n")
        assert 'joint_names: ["a", "b"]\n' in head
        points = [json.loads(line.removeprefix("- ")) for line in lines.splitlines()]
    assert len(points) == 61
    assert points[0]["positions"] == [0.2, 0.0]
    assert points[-1]["time_from_start"] == {"sec": 6, "nanosec": 0}


@pytest.mark.parametrize("times", [1.0, 1e-2])
def test_the_mass_that_a_change_shows_is_that_of_the_last_links_ten_parameters(times: float) -> None:
    """By least squares beside rotors and friction, which are free, and a ball of 1 kg; None of too little motion."""
    rows, weight, inner = times * rng.normal(size=(400, 2, 14)), np.array([4.0, 9.0]), SimpleNamespace()
    mechanism = SimpleNamespace(is_plain_tree=True, description=SimpleNamespace(body_names=("l",)))
    inner.model = SimpleNamespace(mechanism=mechanism, regrouping=np.eye(14), torque_regressor=lambda p, v, a: rows)
    law = SimpleNamespace(gain=np.arange(1.0, 15.0), covariance=None, prediction_weight=weight)
    inner.adaptation_law = law
    controller, p = SimpleNamespace(inner=inner), np.zeros((400, 2))
    found = mass_of_change(controller, p, p, p, 0.1)
    if times < 1.0:
        assert found is None
        return
    normal = 0.1 * np.einsum("nji,j,njk->ik", rows, weight, rows)
    prior, ball = np.zeros((14, 14)), _ball(1.0)
    prior[:10, :10] = EntropicPrior(ball[None], np.empty(0, dtype=np.int64), np.empty(0)).curvature(ball, PRIOR_WEIGHT)
    assert found is not None
    np.testing.assert_allclose(found, (np.linalg.inv(normal + prior) @ normal)[0], rtol=1e-5, atol=1e-9)
    inner.model.mechanism.is_plain_tree = False
    assert mass_of_change(controller, p, p, p, 0.1) is None


def test_a_ball_has_its_radius() -> None:
    ball = _ball(3.0)
    assert ball[:4].tolist() == [3.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(inertia_tensor(ball), 0.4 * 3.0 * BALL**2 * np.eye(3))
