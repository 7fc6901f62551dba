"""What learners see of many arms, and what they are told without stable-baselines3."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Any

import numpy as np
import pytest

from adaptctl.envs import Puma560VectorTrackingEnv
from adaptctl.envs.many.learner_view import LearnerView
from adaptctl.errors import InputError, MissingExtraError, NonFiniteError

NOTHING: list[dict[str, Any]] = [{}, {}, {}]


def view(**settings: Any) -> LearnerView:
    settings = {"duration": 0.04, "error_bound": 0.12, "autoreset_mode": "SameStep"} | settings
    return LearnerView(Puma560VectorTrackingEnv(3, **settings))


def test_a_step_is_the_environments_in_other_words() -> None:
    ours, plain = view(), view().env
    start = ours.reset([4, 5, None], NOTHING)
    np.testing.assert_array_equal(start, plain.reset(seed=[4, 5, None])[0])
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (150, 3, 6)).astype(np.float32)
    ends = {True: 0, False: 0}
    actions[:75] *= 0.02
    for action in np.repeat(actions[::20], 20, axis=0):
        seen, reward, done, infos = ours.step(action)
        expected, paid, terminated, truncated, info = plain.step(action * plain.single_action_space.high)
        np.testing.assert_array_equal(seen, expected)
        np.testing.assert_array_equal(reward, paid)
        np.testing.assert_array_equal(done, terminated | truncated)
        for arm in range(3):
            assert set(infos[arm]) == ({"terminal_observation", "TimeLimit.truncated"} if done[arm] else set())
            if done[arm]:
                np.testing.assert_array_equal(infos[arm]["terminal_observation"], info["final_obs"][arm])
                assert infos[arm]["TimeLimit.truncated"] == (truncated[arm] and not terminated[arm])
                ends[infos[arm]["TimeLimit.truncated"]] += 1
    assert all(ends.values())


def test_actions_are_shares_of_the_limits() -> None:
    ours = view()
    assert (ours.action_space.low.min(), ours.action_space.high.max()) == (-1.0, 1.0)
    ours.reset([None] * 3, NOTHING)
    ours.step(np.full((3, 6), 0.25))
    torque = ours.env.single_action_space.high * 0.25  # type: ignore[attr-defined]
    np.testing.assert_array_equal(ours.env._arms._lanes.held["torque"], np.tile(torque, (3, 1)))


def test_options_are_each_arms() -> None:
    ours = view()
    options = [{"payload": float(k), "initial_error": 0.01 * k} for k in range(3)]
    seen = ours.reset([None] * 3, options)
    where = ours.env.observation_slices
    off = seen[:, where["p"]] - seen[:, where["reference_p"]]
    np.testing.assert_allclose(off, 0.01 * np.arange(3)[:, None] * np.ones(6), atol=1e-15)
    with pytest.raises(InputError, match="options: expected the same ones for all arms, such as payload"):
        ours.reset([None] * 3, [{"payload": 1.0}, {}, {}])


@pytest.mark.parametrize("options", [[], [{}], [{}] * 4, 3, [3, 3, 3]])
def test_every_arm_needs_options(options: Any) -> None:
    with pytest.raises(InputError, match="options: expected a mapping for each of 3 arms, got"):
        view().reset([None] * 3, options)


@pytest.mark.parametrize(
    ("off", "error", "message"),
    [
        ([1.0, 2.0], InputError, "of arm 1: expected a number or 6 of them, got shape"),
        ("far", InputError, "of arm 1: expected numbers, got 'far'"),
        (np.nan, NonFiniteError, "of arm 1: expected numbers, got nan"),
        (np.inf, NonFiniteError, ": expected finite numbers, got inf for arm 1"),
    ],
)
def test_bad_initial_errors_are_refused(off: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=f"initial_error{message}" if message[0] == ":" else f"initial_error {message}"):
        view().reset([None] * 3, [{"initial_error": own} for own in (0.1, off, 0.1)])


def test_bad_actions_are_refused() -> None:
    ours = view()
    ours.reset([None] * 3, NOTHING)
    with pytest.raises(InputError, match=r"action: expected shape \(3, 6\), got \(6,\)"):
        ours.step(np.zeros(6))
    with pytest.raises(InputError, match=r"action: expected numbers of shape \(3, 6\), got 'left'"):
        ours.step("left")  # type: ignore[arg-type]
    with pytest.raises(NonFiniteError, match="got nan for number 2 of arm 1"):
        ours.step(np.where(np.arange(18).reshape(3, 6) == 8, np.nan, 0.0))


def test_arms_must_begin_again_in_the_same_step() -> None:
    with pytest.raises(InputError, match="use autoreset_mode='SameStep', not 'NextStep'"):
        view(autoreset_mode="NextStep")


def test_the_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.delitem(sys.modules, "adaptctl.envs.sb3", raising=False)
    with pytest.raises(MissingExtraError, match=r"pip install 'adaptctl\[rl\]'"):
        import_module("adaptctl.envs.sb3")
