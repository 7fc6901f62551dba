"""Environments for learners: what is seen and done in [-1, 1], gains to move, residuals of many arms, baselines."""

from __future__ import annotations

import copy
import pickle
import warnings
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import adaptctl
from adaptctl.control import SlotineLi
from adaptctl.dynamics import Mechanism
from adaptctl.envs import (
    LearningEnv,
    LearningVectorEnv,
    ResidualEnv,
    ResidualVectorEnv,
    TuningEnv,
    TuningVectorEnv,
    VectorTrackingEnv,
    baselines,
)
from adaptctl.errors import InputError, NonFiniteError, NotFoundError

TASK: dict[str, Any] = {"reference": 2, "duration": 0.6, "control_period": 0.01, "initial_error": 0.05}
MOVED = ("bandwidth", "damping", "adaptation.gain")


@pytest.fixture(scope="module")
def arm() -> adaptctl.Mechanism:
    return adaptctl.load("two_link")


@pytest.fixture(scope="module")
def law(arm: adaptctl.Mechanism) -> SlotineLi:
    tuning = adaptctl.tune(arm, control_period=0.01)
    return tuning.controller(adaptctl.ReducedModel(arm))


def single(arm: adaptctl.Mechanism, **settings: Any) -> gymnasium.Env[Any, Any]:
    return gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", robot=arm, **TASK | settings)


def many(arm: adaptctl.Mechanism, mode: str = "SameStep", **settings: Any) -> VectorTrackingEnv:
    return VectorTrackingEnv(3, robot=arm, autoreset_mode=mode, **TASK | settings)


def run_alone(env: gymnasium.Env[Any, Any], actions: Any, seed: int) -> list[Any]:
    seen = [env.reset(seed=seed)[0]]
    for action in actions:
        observation, _, terminated, truncated, _ = env.step(action)
        seen.append(observation)
        if terminated or truncated:
            break
    return seen


@pytest.mark.parametrize("name", ["Puma560Learning-v0", "Learning-v0"])
def test_defaults_suit_learners(name: str) -> None:
    env = gymnasium.make(f"adaptctl.envs:adaptctl/{name}")
    tracking = env.unwrapped
    assert (tracking.control_period, tracking.steps) == (0.02, 250)  # type: ignore[attr-defined]
    assert env.observation_space.dtype == env.action_space.dtype == np.float32
    assert gymnasium.make(env.spec).observation_space == env.observation_space  # type: ignore[arg-type]
    assert gymnasium.make(f"adaptctl/{name}", duration=1.0).unwrapped.steps == 50  # type: ignore[attr-defined]
    vector = gymnasium.make_vec(f"adaptctl/{name}", num_envs=3)
    assert vector.single_observation_space == env.observation_space
    assert vector.single_action_space == env.action_space
    assert vector.metadata["autoreset_mode"].value == "SameStep"


def test_it_keeps_gymnasiums_rules(arm: adaptctl.Mechanism, law: SlotineLi) -> None:
    inner = single(arm)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*different from the unwrapped")
        for env in (
            LearningEnv(inner),
            LearningEnv(ResidualEnv(inner, law)),
            LearningEnv(TuningEnv(inner, law, MOVED)),
        ):
            check_env(env, skip_render_check=True)


def test_what_is_seen_is_what_the_card_says(arm: adaptctl.Mechanism) -> None:
    inner = single(arm)
    env, places = LearningEnv(inner), inner.unwrapped.observation_slices  # type: ignore[attr-defined]
    raw, seen = inner.reset(seed=0)[0], env.reset(seed=0)[0]
    back = seen / (1.0 - np.abs(seen))  # in units of the scales
    np.testing.assert_allclose(back[:2], (raw[places["p"]] - raw[places["reference_p"]]) / 0.1, rtol=1e-5)
    np.testing.assert_allclose(back[2:4], (raw[places["v"]] - raw[places["reference_v"]]) / 0.5, atol=1e-6)
    np.testing.assert_allclose(back[8:10], raw[places["reference_a"]] / np.pi, rtol=1e-5)
    ahead = raw[places["look_ahead"]] - np.tile(raw[places["reference_p"]], 2)
    np.testing.assert_allclose(back[10:], ahead / 0.1, rtol=1e-4, atol=1e-6)


def test_what_is_seen_is_scaled_by_the_ranges_of_the_joints(arm: adaptctl.Mechanism) -> None:
    links = list(arm.description.links)
    joint = replace(links[1].joint, limits=replace(links[1].joint.limits, lower=0.2, upper=0.6))
    links[1] = replace(links[1], joint=joint)
    narrow = Mechanism(replace(arm.description, links=tuple(links)))
    inner = single(narrow, error_bound=0.5)
    limits = inner.action_space.high  # type: ignore[attr-defined]
    raw = np.array(run_alone(inner, [0.1 * limits] * 5, 0))
    seen = np.array(run_alone(LearningEnv(single(narrow, error_bound=0.5)), [[0.1, 0.1]] * 5, 0), dtype=float)
    back, half = seen / (1.0 - np.abs(seen)), np.array([np.deg2rad(170.0), 0.2])
    error = 0.1 * np.array([0.5, 0.2])  # of the bound, and of half the range
    places = inner.unwrapped.observation_slices  # type: ignore[attr-defined]
    assert back[:, :2] * error == pytest.approx(raw[:, places["p"]] - raw[:, places["reference_p"]], rel=1e-4)
    assert back[:, 4:6] * half == pytest.approx(raw[:, places["p"]] - [0.0, 0.4], rel=1e-4)
    assert back[:, 6:8] * half == pytest.approx(raw[:, places["v"]], rel=1e-4, abs=1e-9)


def test_actions_are_shares_of_the_limits(arm: adaptctl.Mechanism) -> None:
    env = LearningEnv(single(arm))
    env.reset(seed=0)
    *_, info = env.step(np.array([0.5, -0.25], dtype=np.float32))
    limits = env.env.action_space.high  # type: ignore[attr-defined]
    np.testing.assert_allclose(info["applied_torque"], [0.5 * limits[0], -0.25 * limits[1]])


@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
@pytest.mark.parametrize("kind", ["plain", "residual", "tuning"])
def test_many_arms_are_as_each_would_be_alone(arm: adaptctl.Mechanism, law: SlotineLi, kind: str, mode: str) -> None:
    """Over two episodes: the controller forgets the first."""
    wrap: dict[str, Any] = {
        "plain": (lambda env: env, lambda env: env),
        "residual": (lambda env: ResidualEnv(env, law), lambda env: ResidualVectorEnv(env, law)),
        "tuning": (lambda env: TuningEnv(env, law, MOVED), lambda env: TuningVectorEnv(env, law, MOVED)),
    }
    alone, together = wrap[kind]
    vector, one = together(many(arm, mode, error_bound=50.0)), alone(single(arm, error_bound=50.0))
    vector, one = LearningVectorEnv(vector), LearningEnv(one)
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (122, *vector.action_space.shape)).astype(np.float32)
    seen = [vector.reset(seed=5)[0]]
    last: Any = None
    for action in actions:
        observation, _, terminated, truncated, info = vector.step(action)
        if mode == "SameStep" and (terminated | truncated).all() and last is None:
            last = info["final_obs"][1]
        seen.append(observation)
    again = 60 if mode == "SameStep" else 61
    first = run_alone(one, actions[:60, 1], 6)
    np.testing.assert_allclose([*np.array(seen)[:60, 1], last if mode == "SameStep" else seen[60][1]], first, atol=1e-6)
    second = run_alone(one, actions[again : again + 60, 1], 6)
    np.testing.assert_allclose(np.array(seen)[again : again + 60, 1], second[:60], atol=1e-6)


def flat(info: Any) -> Any:
    """What `info` holds, to compare."""
    if isinstance(info, dict):
        return {name: flat(value) for name, value in sorted(info.items())}
    return np.round(np.asarray(info, dtype=np.float64), 9).tolist()


def test_moved_gains_are_those_of_another_controller(arm: adaptctl.Mechanism, law: SlotineLi) -> None:
    env = TuningEnv(single(arm), law, MOVED, max_factor=2.0)
    assert env.action_space.shape == (5,)
    action = np.array([-1.0, 0.5, -0.5, 0.0, 1.0], dtype=np.float32)
    seen = run_alone(env, [action] * 60, 0)
    up = env.range.highest
    factors = {
        "bandwidth": np.array([0.5, up**0.5]),
        "damping": np.array([2.0**-0.5, 1.0]),
        "adaptation.gain": up,
    }
    other = law.tuned({name: law.numbers[name] * factor for name, factor in factors.items()})
    expected = adaptctl.rollout(single(arm), other, seed=0)
    np.testing.assert_allclose(np.array(seen)[:-1, :2], expected.p, atol=1e-10)
    np.testing.assert_allclose(env.step.__self__.range.gains(action)["damping"], other.damping)  # type: ignore[attr-defined]


def test_what_many_arms_are_told_has_masks_as_gymnasium_has_them(arm: adaptctl.Mechanism, law: SlotineLi) -> None:
    """Gymnasium's own vector environment of single ones is the oracle."""
    one: dict[str, tuple[Any, Any]] = {
        "gains": (lambda env: TuningEnv(env, law, MOVED), TuningVectorEnv(many(arm), law, MOVED)),
        "base_torque": (lambda env: ResidualEnv(env, law), ResidualVectorEnv(many(arm), law)),
    }
    for name, (wrap, ours) in one.items():
        theirs = gymnasium.vector.SyncVectorEnv([lambda wrap=wrap: wrap(single(arm))] * 3)
        for env in (ours, theirs):
            env.reset(seed=0)
        action = np.full(ours.action_space.shape, 0.25, np.float32)
        found, expected = (env.step(action)[-1] for env in (ours, theirs))
        keys = (name, f"_{name}")
        assert flat({key: found[key] for key in keys}) == flat({key: expected[key] for key in keys})


def test_the_largest_gains_are_those_that_the_period_carries(arm: adaptctl.Mechanism, law: SlotineLi) -> None:
    found = TuningEnv(single(arm), law, MOVED, max_factor=100.0).range
    assert found.lowest == 0.01
    assert 1.0 < found.highest < 100.0
    largest = {name: law.numbers[name] * found.highest for name in MOVED}
    law.tuned(largest)
    with pytest.raises(InputError, match="control period"):
        law.tuned({name: 1.003 * number for name, number in largest.items()})


def test_what_is_refused(arm: adaptctl.Mechanism, law: SlotineLi) -> None:
    inner = single(arm)
    with pytest.raises(NotFoundError, match="no number 'dampin' to tune"):
        TuningEnv(inner, law, ["dampin"])
    with pytest.raises(NotFoundError, match="expected at least one of bandwidth, damping"):
        TuningEnv(inner, law, [])
    with pytest.raises(InputError, match="max_factor: expected a number above 1, got 1"):
        TuningEnv(inner, law, MOVED, max_factor=1.0)
    with pytest.raises(InputError, match="expected a tracking environment of adaptctl"):
        LearningEnv(gymnasium.make("CartPole-v1"))
    with pytest.raises(InputError, match="expected a vector environment of adaptctl"):
        ResidualVectorEnv(gymnasium.make_vec("CartPole-v1"), law)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="has 6 joints, but the controller has 2"):
        ResidualVectorEnv(gymnasium.make_vec("adaptctl/Puma560Tracking-v0"), law)  # type: ignore[arg-type]
    learning = LearningEnv(inner)
    for wrap in (lambda: ResidualEnv(learning, law), lambda: TuningEnv(learning, law, MOVED)):
        with pytest.raises(InputError, match="expected observations and torques in SI units"):
            wrap()
    for again in (lambda: LearningEnv(learning), lambda: LearningVectorEnv(LearningVectorEnv(many(arm)))):
        with pytest.raises(InputError, match="but a wrapper has changed them"):
            again()
    wrong: Any = 3
    for none in (
        lambda: ResidualEnv(inner, wrong),
        lambda: ResidualVectorEnv(many(arm), wrong),
        lambda: TuningVectorEnv(many(arm), wrong, MOVED),
    ):
        with pytest.raises((InputError), match="expected a Controller, got"):
            none()
    with pytest.raises(InputError, match="x: expected a tracking environment of adaptctl"):
        baselines("x")
    env = TuningVectorEnv(many(arm), law, MOVED)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros((3, 5)))
    env.reset(seed=0)
    with pytest.raises(InputError, match=r"action: expected shape \(3, 5\), got \(5,\)"):
        env.step(np.zeros(5))
    with pytest.raises(NonFiniteError, match="got nan for number 2 of arm 1"):
        env.step(np.where(np.arange(15).reshape(3, 5) == 7, np.nan, 0.0))
    for gains in (3, [3], [["damping"]]):
        for tuned in (lambda: TuningEnv(inner, law, gains), lambda: TuningVectorEnv(many(arm), law, gains)):  # type: ignore[arg-type]  # noqa: B023
            with pytest.raises(InputError, match="gains: expected names, such as"):
                tuned()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"episodes": 0}, "episodes: expected a whole number of at least 1, got 0"),
        ({"episodes": True}, "episodes: expected a whole number of at least 1, got True"),
        ({"seed": 1.5}, "seed: expected a whole number of at least 0, got 1.5"),
        ({"seed": -1}, "seed: expected a whole number of at least 0, got -1"),
        ({"seed": None}, "seed: expected a whole number of at least 0, got None"),
    ],
)
def test_bad_seeds_and_counts_of_baselines_are_refused(
    arm: adaptctl.Mechanism, settings: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        baselines(single(arm), **settings)


def test_baselines_are_returns_of_the_environment(arm: adaptctl.Mechanism) -> None:
    env = LearningEnv(single(arm, reference=None, duration=1.0))
    env.reset(seed=7)
    before = env.unwrapped._episode  # type: ignore[attr-defined]
    found = baselines(env, episodes=2, seed=3)
    assert env.unwrapped._episode is before  # type: ignore[attr-defined]
    assert found == baselines(LearningVectorEnv(many(arm, reference=None, duration=1.0)), episodes=2, seed=3)
    assert found["computed torque"] > found["PD with gravity"] > found["PD"] > found["zero torque"]
    totals = []
    for seed in (3, 4):
        env.reset(seed=seed)
        total, over = 0.0, False
        while not over:
            _, reward, terminated, truncated, _ = env.step(np.zeros(2))
            total, over = total + reward, terminated or truncated
        totals.append(total)
    assert found["zero torque"] == pytest.approx(np.mean(totals), rel=1e-12)


def test_they_are_copied_and_sent(arm: adaptctl.Mechanism, law: SlotineLi) -> None:
    for env in (
        LearningEnv(TuningEnv(single(arm), law, MOVED)),
        LearningVectorEnv(TuningVectorEnv(many(arm), law, MOVED)),
    ):
        env.reset(seed=1)
        action = np.full(env.action_space.shape, 0.3, dtype=np.float32)
        env.step(action)
        others = copy.deepcopy(env), pickle.loads(pickle.dumps(env))
        expected = env.step(action)[0]
        for other in others:
            np.testing.assert_array_equal(other.step(action)[0], expected)
