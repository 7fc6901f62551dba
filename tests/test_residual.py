"""Residual learning's environment: the base alone, what actions add, and what is refused."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

import adaptctl
from adaptctl.control import ReferencePoint
from adaptctl.envs import ResidualEnv
from adaptctl.errors import InputError, NonFiniteError


@pytest.fixture(scope="module")
def arm() -> adaptctl.Mechanism:
    return adaptctl.load("two_link")


def residual(arm: adaptctl.Mechanism, share: float = 0.2) -> ResidualEnv:
    env = gymnasium.make("adaptctl.envs:adaptctl/Tracking-v0", robot=arm, reference=2, duration=0.3, initial_error=0.05)
    return ResidualEnv(env, adaptctl.ComputedTorque(arm, 8.0), share)


def test_an_action_of_zero_is_the_controller_alone(arm: adaptctl.Mechanism) -> None:
    env = residual(arm)
    observations = [env.reset(seed=0)[0]]
    over = False
    while not over:
        observation, _, terminated, truncated, _ = env.step(np.zeros(2, dtype=np.float32))
        observations.append(observation)
        over = terminated or truncated
    alone = adaptctl.rollout(env.env, env.controller, seed=0)
    np.testing.assert_array_equal(np.array(observations)[:-1, :2], alone.p)


def test_actions_are_shares_added_to_the_controllers_torque(arm: adaptctl.Mechanism) -> None:
    env = residual(arm, 0.1)
    _, before = env.reset(seed=0)
    _, _, _, _, info = env.step(np.array([1.0, -0.5], dtype=np.float32))
    limits = env.env.action_space.high  # type: ignore[attr-defined]
    expected = before["base_torque"] + 0.1 * limits * np.array([1.0, -0.5])
    np.testing.assert_allclose(info["applied_torque"], np.clip(expected, -limits, limits))
    np.testing.assert_array_equal(info["base_torque"], before["base_torque"])


def test_each_step_tells_the_controllers_torque_of_its_own_period(arm: adaptctl.Mechanism) -> None:
    env = residual(arm, 0.1)
    observation, _ = env.reset(seed=0)
    slices = env.unwrapped.observation_slices  # type: ignore[attr-defined]
    names = ("p", "v", "reference_p", "reference_v", "reference_a")
    memory: Any = None
    for action in np.random.default_rng(1).uniform(-1.0, 1.0, (6, 2)):
        p, v, *reference = (observation[slices[name]] for name in names)
        memory = env.controller.init(p, v) if memory is None else memory
        base, memory = env.controller.step(memory, p, v, ReferencePoint(*reference))
        observation, _, _, _, info = env.step(action)
        np.testing.assert_allclose(info["base_torque"], base, rtol=1e-12)
        limits = env.env.action_space.high  # type: ignore[attr-defined]
        np.testing.assert_allclose(info["applied_torque"], np.clip(base + 0.1 * limits * action, -limits, limits))


def test_it_keeps_gymnasiums_rules(arm: adaptctl.Mechanism) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings(
            "ignore", message=".*is not within the observation space|.*different from the unwrapped"
        )
        check_env(residual(arm), skip_render_check=True)


def test_what_is_refused(arm: adaptctl.Mechanism) -> None:
    for share in (0.0, 1.5, float("nan")):
        with pytest.raises(InputError, match="residual_scale"):
            residual(arm, share)
    with pytest.raises(InputError, match="has 2 joints, but the controller has 6"):
        ResidualEnv(residual(arm).env, adaptctl.ComputedTorque(adaptctl.load("puma560_measured"), 8.0))
    env = residual(arm)
    env.env.reset(seed=0)
    with pytest.raises(ResetNeeded, match=r"call env\.reset\(\) first"):
        env.step(np.zeros(2))
    env.reset(seed=0)
    with pytest.raises(NonFiniteError):
        env.step(np.array([np.nan, 0.0], dtype=np.float32))
    for action in (np.zeros(1), np.zeros(3), 0.5):
        with pytest.raises(InputError, match=r"action: expected shape \(2,\)"):
            env.step(action)  # type: ignore[arg-type]  # what a learner may do
