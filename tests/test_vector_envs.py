"""Vector environments: each arm as alone, Gymnasium's rules of beginning again, options and seeds of each arm."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics, RescaleAction
from nightly import at_night, nightly, turn_by_turn
from random_trees import random_tree
from sampled_loops import RANGES, arm, gains, reduced
from vector_envs import (
    ANY,
    LOOP,
    MODES,
    PUMA,
    agree,
    effects,
    followed,
    one_by_one,
    point,
    pushes,
    rows,
    vector,
)

from adaptctl.control import ComputedTorque, MinimumJerk, Sinusoids, SlotineLi, adaptation_gain
from adaptctl.envs import Payload, TrackingEnv
from adaptctl.envs.many.episodes import DRAWN_ROWS, ArmStreams
from adaptctl.simulation.effects import (
    Encoder,
)


@pytest.mark.parametrize("settings", [at_night({}), {"effects": effects()}])
@pytest.mark.parametrize(
    ("name", "robot", "payload"),
    [
        at_night((PUMA, "puma560", 1.5)),
        (LOOP, "semi_direct_drive", {"mass": 2.0, "center": [0.1, 0, 0]}),
        (ANY, None, 0.5),
    ],
)
def test_arms_are_as_each_alone(name: str, robot: str | None, payload: Any, settings: Any) -> None:
    mechanism = random_tree(3, 3) if robot is None else arm(robot)
    settings = settings | {"robot": mechanism}
    ours, theirs = vector(name, 3, **settings), one_by_one(name, 3, **settings)
    law = ComputedTorque(mechanism, 6.0)
    steps, options = 120, {"payload": payload}
    told, _ = ours.reset(seed=3, options=options)
    theirs.reset(seed=3, options=options)
    state = law.init(*point(told, ours)[:2])
    for k, push in enumerate(pushes(ours, steps, 0.03)):
        torque, state = law.step(state, *point(told, ours))
        result = ours.step(torque + push)
        agree(result, theirs.step(torque + push), f"step {k}: ")
        told = result[0]
    assert result[4]["time"] == pytest.approx(steps * 1e-3)


@pytest.mark.parametrize(("mode", "name"), turn_by_turn(MODES, [PUMA, LOOP]))
def test_arms_begin_again_as_gymnasiums_do(name: str, mode: AutoresetMode) -> None:
    """Random references and noise after it show that each arm's generator is where it should be."""
    settings: dict[str, Any] = {"duration": 0.09, "error_bound": 0.101, "effects": effects()}
    if name == PUMA:
        settings["reference"] = "random"
    ours = vector(name, 5, autoreset_mode=mode, **settings)
    theirs = one_by_one(name, 5, mode, **settings)
    assert ours.metadata["autoreset_mode"] is mode
    ended = followed(ours, theirs, pushes(ours, 250, 0.8), payload=0.7, initial_error=0.05)
    assert ended > 12


@pytest.mark.parametrize("mode", MODES)
def test_arms_may_all_end_together(mode: AutoresetMode) -> None:
    """What is told of an end is not of the beginning after it."""
    ours, theirs = vector(PUMA, 2, autoreset_mode=mode, duration=3e-3), one_by_one(PUMA, 2, mode, duration=3e-3)
    assert followed(ours, theirs, pushes(ours, 8, 0.1)) == 4


def test_autoreset_disabled_waits_for_a_reset() -> None:
    settings = {"duration": 0.06, "error_bound": 0.101, "effects": [Encoder(noise=1e-4)], "reference": None}
    ours = vector(PUMA, 4, autoreset_mode="Disabled", **settings)
    theirs = one_by_one(PUMA, 4, AutoresetMode.DISABLED, **settings)
    agree(ours.reset(seed=1), theirs.reset(seed=1))
    partial = 0
    for action in pushes(ours, 120, 0.8):
        result = ours.step(action)
        agree(result, theirs.step(action))
        over = result[2] | result[3]
        if over.any():
            with pytest.raises(ResetNeeded, match=f"the episode of arm {over.argmax()} is over"):
                ours.step(action)
            partial += not over.all()
            options = {"payload": 1.0}
            again = ours.reset(options=options | {"reset_mask": over.copy()})
            agree(again, theirs.reset(options=options | {"reset_mask": over.copy()}))
            result[0][:], again[0][:] = 7.0, 7.0  # what is returned is the caller's
    assert partial > 1


@pytest.mark.parametrize("arms", [1, 3, 17])
def test_any_number_of_arms_and_seeds(arms: int) -> None:
    """The first, one in the middle and the last, which has a register's rest to itself."""
    settings = {"duration": 0.02, "error_bound": np.inf, "robot": arm("puma560_measured")}
    few = sorted({0, arms // 2, arms - 1})
    ours, theirs = vector(ANY, arms, **settings), one_by_one(ANY, len(few), **settings)
    for seed in (11, [5 * k for k in range(arms)], None):
        seeds = [11 + k for k in few] if seed == 11 else None if seed is None else [5 * k for k in few]
        agree(rows(ours.reset(seed=seed), few), theirs.reset(seed=seeds), "reset")
        for k, action in enumerate(pushes(ours, 30, 0.2)):
            agree(rows(ours.step(action), few), theirs.step(action[few]), f"step {k}: ")


@nightly
def test_loops_end_where_they_may_not_work() -> None:
    settings = {"error_bound": np.inf, "duration": 1.0}
    ours, theirs = vector(LOOP, 4, **settings), one_by_one(LOOP, 4, **settings)
    assert followed(ours, theirs, pushes(ours, 400, 1.0, seed=2)) >= 3


def test_options_and_references_of_each_arm() -> None:
    mechanism = arm("puma560_measured")
    rng = np.random.default_rng(0)
    scales = rng.uniform(0.7, 1.3, 4)[:, None] * mechanism.inertial_parameters
    two = Sinusoids(np.zeros(6), *rng.uniform(0.1, 0.3, (3, 2, 6)), start_time=0.0)
    each = {
        "parameters": scales,
        "payload": [0.0, 2.0, Payload(1.0, np.array([0.1, 0.0, 0.0])), {"mass": 3.0}],
        "trajectory": [two, 3, "random", Sinusoids(np.ones(6), np.full(6, 0.2), np.full(6, 0.3))],
        "initial_error": rng.uniform(-0.1, 0.1, (4, 6)),
    }
    ours = vector(ANY, 4, robot=mechanism, error_bound=np.inf)
    alone = [TrackingEnv(mechanism, error_bound=np.inf) for _ in range(4)]
    told, info = ours.reset(seed=20, options=each)
    for k, env in enumerate(alone):
        expected, own = env.reset(seed=20 + k, options={name: values[k] for name, values in each.items()})
        np.testing.assert_allclose(told[k], expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(info["parameters"][k], own["parameters"])
    for action in pushes(ours, 40, 0.1):
        told, reward, *_ = ours.step(action)
        for k, env in enumerate(alone):
            expected, paid, *_ = env.step(action[k])
            np.testing.assert_allclose(told[k], expected, rtol=1e-9, atol=1e-9)
            assert reward[k] == pytest.approx(paid, rel=1e-9)


def test_what_arms_begin_again_with_can_be_set() -> None:
    masses = np.array([0.0, 1.0, 2.0])
    ours = vector(PUMA, 3, duration=0.01, reset_options={"payload": masses}, autoreset_mode="SameStep")
    added = ours.reset()[1]["parameters"][:, 50] - ours.single.mechanism.inertial_parameters[50]
    np.testing.assert_allclose(added, masses)
    added = ours.reset(options={"payload": 5.0})[1]["parameters"][:, 50] - ours.single.mechanism.inertial_parameters[50]
    np.testing.assert_allclose(added, 5.0)
    for _ in range(10):
        info = ours.step(np.zeros((3, 6)))[4]
    final = info["final_info"]["parameters"][:, 50] - ours.single.mechanism.inertial_parameters[50]
    np.testing.assert_allclose(final, 5.0)
    np.testing.assert_allclose(info["parameters"][:, 50] - ours.single.mechanism.inertial_parameters[50], masses)


def test_references_without_numbers_are_sampled() -> None:
    """A path shared by arms at other times, one of an arm's own, and the way to sinusoids and back."""
    path = MinimumJerk(np.array([np.zeros(6), np.full(6, 0.4), np.zeros(6)]), np.array([0.0, 0.08, 0.2]))
    settings = {"reference": path, "duration": 0.1, "error_bound": 0.05}
    ours, theirs = vector(PUMA, 4, **settings), one_by_one(PUMA, 4, **settings)
    assert followed(ours, theirs, pushes(ours, 250, 0.5), initial_error=0.0) > 8
    assert followed(ours, theirs, pushes(ours, 50, 0.5), trajectory=2, initial_error=0.0) > 0
    assert followed(ours, theirs, pushes(ours, 120, 0.5), trajectory=2, initial_error=0.0) > 4


def test_thousands_of_arms() -> None:
    ours = vector(PUMA, 16_384)
    errors = np.random.default_rng(0).uniform(-0.1, 0.1, (16_384, 6))
    told, _ = ours.reset(seed=0, options={"initial_error": errors})
    assert told.shape == (16_384, 42)
    single, chosen = gymnasium.make(PUMA), 12_345
    expected, _ = single.reset(seed=chosen, options={"initial_error": errors[chosen]})
    for action in np.random.default_rng(0).uniform(-5.0, 5.0, (3, 16_384, 6)):
        told, reward, *_ = ours.step(action)
        expected, paid, *_ = single.step(action[chosen])
        np.testing.assert_allclose(told[chosen], expected, rtol=1e-12, atol=1e-12)
        assert reward[chosen] == pytest.approx(paid, rel=1e-12)


@pytest.mark.parametrize("mode", MODES)
def test_an_arm_that_ends_disturbs_no_other(mode: AutoresetMode) -> None:
    settings = {"autoreset_mode": mode, "error_bound": 0.05, "initial_error": 0.0}
    quiet, wild = vector(PUMA, 9, **settings), vector(PUMA, 9, **settings)
    quiet.reset(seed=0), wild.reset(seed=0)
    others, ended = np.arange(9) != 4, 0
    for action in pushes(quiet, 60, 0.02):
        thrown = action.copy()
        thrown[4] = quiet.action_space.high[4]  # type: ignore[attr-defined]
        one, other = quiet.step(action), wild.step(thrown)
        ended += int(other[2][4])
        for ours, theirs in zip(one[:4], other[:4], strict=True):
            np.testing.assert_array_equal(ours[others], theirs[others])
    assert ended > 0


def test_many_arms_learn_from_one_law() -> None:
    """Arms with other payloads each: everyone's error falls, and they learn other parameters."""
    mechanism, model = arm("puma560"), reduced("puma560")
    law = SlotineLi(model, 8.0, gains("puma560").damping, adaptation_gain(model, RANGES, 1.0))
    ours = vector(PUMA, 16, robot=mechanism)
    told, _ = ours.reset(seed=0, options={"payload": np.linspace(0.0, 2.0, 16)})
    state, errors = law.init(*point(told, ours)[:2]), []
    for _ in range(1500):
        torque, state = law.step(state, *point(told, ours))
        told, _, terminated, _, _ = ours.step(torque)
        p, _, goal = point(told, ours)
        errors.append(np.abs(p - goal.p).max(axis=1))
        assert not terminated.any()
    assert np.all(np.max(errors[-300:], axis=0) < 0.4 * np.max(errors[:300], axis=0))
    assert np.ptp(state.estimate, axis=0).max() > 0.1


def test_loops_that_begin_again_elsewhere_are_followed() -> None:
    """What a law remembers of an arm's loops is of no use after a jump: it starts anew."""
    mechanism = arm("semi_direct_drive")
    ours = vector(LOOP, 6, robot=mechanism, duration=0.05, autoreset_mode="SameStep")
    starts = [Sinusoids(np.array([0.0, -1.57 + off, -3.14 - off]), np.zeros(3), np.zeros(3)) for off in (-0.2, 0.2)]
    law = ComputedTorque(mechanism, 8.0)
    told, _ = ours.reset(options={"trajectory": starts * 3})
    state, beginnings = law.init(*point(told, ours)[:2]), 0
    for _ in range(120):
        torque, state = law.step(state, *point(told, ours))
        told, _, terminated, _, info = ours.step(torque)
        assert not terminated.any()
        p, v, _ = point(told, ours)
        again = info["time"] == 0.0
        state = law.reset(state, again, p, v)
        if again.any():
            np.testing.assert_allclose(state.q[again], mechanism.configuration(p[again]), atol=1e-9)
        beginnings += int(again.sum())
    assert beginnings == 12


def test_gymnasiums_wrappers_fit() -> None:
    ours = RecordEpisodeStatistics(RescaleAction(vector(PUMA, 3, duration=0.02), -1.0, 1.0))
    ours.reset(seed=0)
    for _ in range(20):
        _, _, _, truncated, info = ours.step(np.zeros((3, 6)))
    assert truncated.all()
    np.testing.assert_array_equal(info["episode"]["l"], 20)


def test_images_are_those_of_each() -> None:
    ours, single = vector(PUMA, 1, render_mode="rgb_array"), gymnasium.make(PUMA, render_mode="rgb_array")
    ours.reset(seed=0), single.reset(seed=0)
    action = np.full((1, 6), 20.0)
    ours.step(action), single.step(action[0])
    images = ours.render()
    assert images is not None
    np.testing.assert_array_equal(images, [single.render()])


def test_draws_in_blocks_are_draws_one_by_one() -> None:
    streams, rng = ArmStreams(2, 3), np.random.default_rng
    for arm_number in (0, 1):
        streams.seed(arm_number, 7 + arm_number)
    plain = [gymnasium.utils.seeding.np_random(7 + k)[0] for k in (0, 1)]
    both, draws = np.array([0, 1]), rng(0).integers(0, 2 * DRAWN_ROWS, 6)
    for count in draws.tolist():
        for _ in range(count):
            np.testing.assert_array_equal(streams.normal(both), [one.standard_normal(3) for one in plain])
        assert streams.generator(1).random() == plain[1].random()
